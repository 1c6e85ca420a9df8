# SPDX-License-Identifier: Apache-2.0
"""Simulated machines and what is launched on them, on the launch files that real ones use: a fleet of one machine per
vehicle and the control PC. Tellos before a tracker, all on one machine, are in ``tellos.py``."""

import json
import os
import re
import shlex
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

from fcsv_geometry.programs.writing import whole_file, write_whole
from fcsv_sim.autopilot.ground import READY_S
from fcsv_sim.demo.autopilots import rc_port
from fcsv_sim.demo.own_camera import OwnCamera
from fcsv_sim.demo.site import PairSite
from fcsv_sim.demo.window import OperatorWindow, arguments
from fcsv_sim.machines.machines import (
    Machine,
    MachineError,
    Process,
    free_port,
    start_together,
    stop_together,
)
from fcsv_sim.machines.slow_motion import shared_time
from fcsv_sim.world.movers import Mover

CONTROL = "control"
_TOLD_LINES = 6
MONITORED_HZ = 5.0  # pictures a second that are sent for monitoring
# and to watch a robot: all that cameras take, so that both vehicles send those of one instant
WATCHED_HZ, _WATCHING_CAMERA_HZ = 5.0, 2.5
_SLOW_NOTE = (
    "LD_PRELOAD and FCSV_SLOW_MOTION make a program share the flight's clock, which may be slower than real time: "
    "set them for one command (run/on_NAME COMMAND does), not for a shell"
)
_ON = """#!/bin/sh
# A command on the simulated machine {name}, with its ROS master and the flight's clock: on_{name} rostopic list
# It brings the workspace's environment along: it works from any shell.
[ $# -gt 0 ] || {{ echo "usage: $0 COMMAND..., such as: $0 rostopic list" >&2; exit 2; }}
exec env {words} "$@"
"""
_WORKSPACE = (
    "PATH",
    "PYTHONPATH",
    "LD_LIBRARY_PATH",
    "CMAKE_PREFIX_PATH",
    "PKG_CONFIG_PATH",
    "ROS_DISTRO",
    "ROS_ETC_DIR",
    "ROS_PACKAGE_PATH",
    "ROS_PYTHON_VERSION",
    "ROS_ROOT",
    "ROS_VERSION",
)


@dataclass(frozen=True)
class FleetPlan:
    """What flies, where it starts, and where its records go."""

    folder: Path  # out/demo: run/ holds the machines' logs, session/ the bags
    mission_file: Path
    seed: int = 1
    world: str = "street"
    vehicles: Tuple[str, ...] = ("uav1", "uav2")
    column_spacing_m: float = 3.5
    rviz: bool = False
    live: bool = False
    monitor: bool = False  # instead of the map in flight: depth of the newest instant
    movers: Tuple[Mover, ...] = ()  # what moves through the town
    # a robot is guided in flight, while the vehicles watch; a crate closes its way
    watch: bool = False
    follower: str = ""  # the vehicle that follows that robot and reads its tags; empty: none does
    robot_file: Optional[Path] = None  # of that robot
    # of vehicles that gimbals on a robot follow, which is guided by them
    robot_site: Optional[PairSite] = None
    start_xy_m: Tuple[float, float] = (0.0, 0.0)  # of the first vehicle, in the world
    looks: str = ""  # where it looks from, in words, where that was chosen
    near: bool = False  # depth cameras are recorded
    gps: bool = False  # autopilots have a receiver: the map knows where on the earth it lies
    flight_link: str = "mavlink"  # or mavros: as flight_link of uav.launch
    ready_s: float = READY_S  # until a simulated autopilot may be armed
    # tcp:HOST:PORT of ArduCopters that fly in place of the simulated ones
    autopilots: Tuple[str, ...] = ()
    camera: Optional[OwnCamera] = None  # that all vehicles carry; none: as the thesis's
    buttons: bool = True  # a simulated operator presses them; else somebody does in the window
    window: Optional[OperatorWindow] = None  # where there is a screen; it outlives the machines

    @property
    def run_folder(self) -> Path:
        return self.folder / "run"

    @property
    def session_folder(self) -> Path:
        return self.folder / "session"

    @property
    def guide_folder(self) -> Path:
        """The drive of a robot that was guided over the map."""
        return self.folder / "guide"

    @property
    def monitor_folder(self) -> Path:
        """Depth images of live monitoring."""
        return self.folder / "monitor"

    @property
    def captures_hz(self) -> Optional[float]:
        """Pictures a second that are sent while recording; None: as the launch file says."""
        return MONITORED_HZ if self.monitor else WATCHED_HZ if self.watch else None

    @property
    def sim_folder(self) -> Path:
        return self.run_folder / "sim"

    @property
    def window_arguments(self) -> List[str]:
        """Gives the arguments of the operator's window."""
        return arguments(self.vehicles, self.mission_file, self.session_folder)

    def start_xyz_yaw(self, index: int) -> List[float]:
        """Places the vehicle on the ground, in a column, facing the town (world frame, m and rad)."""
        x, y = self.start_xy_m
        return [x - index * self.column_spacing_m, y, 0.0, 0.0]


def workspace() -> Dict[str, str]:
    """The variables by which this process finds the workspace's programs: a printed command sets them itself."""
    return {name: os.environ[name] for name in _WORKSPACE if name in os.environ}


def assignments(variables: Dict[str, str]) -> str:
    """The words that ``env`` takes."""
    return " ".join(f"{name}={shlex.quote(value)}" for name, value in variables.items())


class Machines:
    """Starts and stops all machines of a plan; ports are free ones, so that demos run side by side."""

    def __init__(self, plan: FleetPlan, names: Sequence[str]):
        self.plan = plan
        for folder in (plan.sim_folder, plan.session_folder):
            folder.mkdir(parents=True, exist_ok=True)
        self.machines: Dict[str, Machine] = {n: Machine(n, plan.run_folder) for n in names}
        self.launches: Dict[str, Process] = {}

    @property
    def control(self) -> Machine:
        return self.machines[CONTROL]

    def start(self) -> None:
        """Masters first, then the launch files. Raises MachineError."""
        start_together(self.machines.values())
        self._write_description()
        self._launch()
        if self.plan.window is not None:
            self.plan.window.open(self.control, self.plan.window_arguments)

    def _launch(self) -> None:
        raise NotImplementedError

    def meanwhile(self, phase: Optional[int]) -> None:
        """What is still to be started, at a phase of the mission (None: not heard yet)."""

    def stop(self) -> None:
        """Interrupt every launch, then end the masters; recorders close their bags on the way."""
        stop_together(self.machines.values())

    def dead_launches(self) -> List[str]:
        """Those whose launch has ended by itself."""
        return [name for name, process in self.launches.items() if process.returncode is not None]

    def require_begun(self, launch: str, node: str) -> None:
        """Raises MachineError with what roslaunch wrote where a node that it starts again and again ended already."""
        said, log = self.launches[launch].log.read_text(errors="replace"), self.launches[launch].log
        end = re.search(rf"\[{node}-\d+\] process has (died|finished)", said)
        if end:
            words = [line for line in said[: end.start()].splitlines() if line.strip(" \x1b[0m31")][
                -_TOLD_LINES:
            ]
            raise MachineError("\n".join([f"the {node} node ended at its start: {log}", *words]))

    def require_alive(self) -> None:
        """Raises MachineError with the end of the log of a launch that ended by itself."""
        for name in self.dead_launches():
            raise MachineError(
                f"{name} stopped by itself: {self.launches[name].log}\n{self.launches[name].tail(5)}"
            )

    def _write_description(self) -> None:
        """How to look into a machine while it runs: run/on_NAME COMMAND runs one there; run/fleet.json is for programs.

        The variables of a slow flight slow every program that has them, a shell too: so they are set for one command.
        """
        time = shared_time(dict(os.environ))
        description = {}
        for name, machine in self.machines.items():
            variables = {"ROS_MASTER_URI": machine.master_uri, **time}
            description[name] = {
                **variables,
                "folder": str(machine.folder),
                **({"note": _SLOW_NOTE} if time else {}),
            }
            with whole_file(self.plan.run_folder / f"on_{name}") as script:
                script.write_text(
                    _ON.format(name=name, words=assignments({**workspace(), **variables}))
                )
                script.chmod(0o755)
        write_whole(self.plan.run_folder / "fleet.json", json.dumps(description, indent=1))


class SimulatedFleet(Machines):
    """A machine per vehicle and the control PC."""

    def __init__(self, plan: FleetPlan):
        super().__init__(plan, (*plan.vehicles, CONTROL))
        self._endpoints = {n: f"127.0.0.1:{free_port()}/{free_port()}" for n in self.machines}
        self._mavlink_ports = {v: free_port(socket.SOCK_DGRAM) for v in plan.vehicles}
        self.rc_ports = {v: free_port(socket.SOCK_DGRAM) for v in plan.vehicles}
        self.rc_ports.update(zip(plan.vehicles, map(rc_port, plan.autopilots)))

    def _launch(self) -> None:
        for index, vehicle in enumerate(self.plan.vehicles):
            self.launches[vehicle] = self.machines[vehicle].launch(
                "fcsv_bringup", "uav.launch", **self._vehicle_args(vehicle, index)
            )
        self.launches[CONTROL] = self.control.launch(
            "fcsv_bringup", "control.launch", **self._control_args()
        )

    def common_args(self, name: str) -> Dict[str, object]:
        return {
            "sim": True,
            "sim_dir": self.plan.sim_folder,
            "seed": self.plan.seed,
            "vehicles": ",".join(self.plan.vehicles),
            "record_dir": self.plan.session_folder,
            "listen": self._endpoints[name],
            "peers": ",".join(f"{n}={e}" for n, e in self._endpoints.items() if n != name),
        }

    def _vehicle_args(self, vehicle: str, index: int) -> Dict[str, object]:
        return {
            **self.common_args(vehicle),
            "uav": vehicle,
            "world": self.plan.world,
            "near": self.plan.near,
            "sim_gps": self.plan.gps,
            "sim_movers": bool(self.plan.movers) or self.plan.watch,
            **({"captures_hz": self.plan.captures_hz} if self.plan.captures_hz else {}),
            **self._robot_args(vehicle),
            **self._camera_args(),
            "flight_link": self.plan.flight_link,
            "fcu_url": f"udpin:127.0.0.1:{self._mavlink_ports[vehicle]}",
            "sim_mavlink_port": self._mavlink_ports[vehicle],
            "sim_rc_port": self.rc_ports[vehicle],
            "sim_ready_s": self.plan.ready_s,
            **({"sim_autopilot": self.plan.autopilots[index]} if self.plan.autopilots else {}),
            "sim_start": ",".join(map(str, self.plan.start_xyz_yaw(index))),
        }

    def _robot_args(self, vehicle: str) -> Dict[str, object]:
        """Where a robot is watched all see its tags, and who does not follow it sends pictures though
        nothing is recorded."""
        if not self.plan.follower:
            return {}
        return {"robot": self.plan.robot_file, "monitored": vehicle != self.plan.follower}

    def _camera_args(self) -> Dict[str, object]:
        own = self.plan.camera
        if own is not None:
            return {"sim_camera": own.file, "camera_rate_hz": own.rate_hz}
        return {"camera_rate_hz": _WATCHING_CAMERA_HZ} if self.plan.watch else {}

    def _control_args(self) -> Dict[str, object]:
        return {
            **self.common_args(CONTROL),
            "mission": self.plan.mission_file,
            "sim_rc_ports": ",".join(str(p) for p in self.rc_ports.values()),
            "rviz": self.plan.rviz,
            "console": False,  # the demo's own stays when this launch is stopped
            "live": self.plan.live,
            "monitor": self.plan.monitor,
            "watch": self.plan.watch,
            "rviz_config": "monitor" if self.plan.monitor else "map",
            "sim_buttons": self.plan.buttons,
            "sim_start_xy": ", ".join(map(str, self.plan.start_xy_m)),
        }

# SPDX-License-Identifier: Apache-2.0
"""Simulated Tellos that speak their own protocol, flown as real ones are: a flight link for each,
agents, guardians, recorders, a tracker on the ground and the mission, all on one machine (thesis 4
and 5: one PC, Wi-Fi)."""

import os
from typing import Dict, List, Mapping, Optional

from fcsv_geometry.bags.reading import messages
from fcsv_geometry.camera_file import write_camera
from fcsv_geometry.messages import seconds
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.missions.phases import PHASES
from fcsv_sim.demo.fleet import CONTROL, FleetPlan, Machines
from fcsv_sim.demo.site import PairSite
from fcsv_sim.tello.pictures import SimulatedVideoParameters
from fcsv_sim.tello.places import TelloPlace
from fcsv_stereo.sessions.files import bags_of

_COLUMN = PHASES.index("COLUMN")
# a picture takes 0.2 s of a core, more where others want it, too
_VIDEO = {"video_hz": 2.0, "video_delay_s": 0.4}


class SimulatedTellos(Machines):
    """``places``: where each Tello is, which must outlive this object."""

    def __init__(self, plan: FleetPlan, site: PairSite, places: Mapping[str, TelloPlace]):
        super().__init__(plan, [CONTROL])
        self._site, self._places = site, places

    def _launch(self) -> None:
        plan, launch = self.plan, self.control.launch
        starts = self._site.starts(load_mission(plan.mission_file), plan.vehicles)
        for number, name in enumerate(plan.vehicles):
            place = self._places[name]
            start = ",".join(map(str, starts[name]))
            self.launches[f"Tello {name}"] = launch(
                "fcsv_bringup",
                "sim_tello_drone.launch",
                **self._common,
                uav=name,
                start=start,
                **_VIDEO,
                seed=10 * plan.seed + number,
                world=plan.world,
                world_seed=plan.seed,
                # roslaunch takes an empty argument for none, and its default
                **{**place.drone, "network": place.network or "none"},
            )
            self.launches[name] = launch(
                "fcsv_bringup",
                "tello.launch",
                uav=name,
                vehicles=self._vehicles,
                record_dir=plan.session_folder,
                calibration=self._calibration(name),
                video_delay_s=_VIDEO["video_delay_s"],
                **place.link,
            )
        if not self._site.late:
            self._launch_tracker()
        self.launches[CONTROL] = launch(
            "fcsv_bringup",
            "control.launch",
            **self._common,
            ground=True,
            sim=True,
            mission=plan.mission_file,
            record_dir=plan.session_folder,
            seed=plan.seed,
            live=plan.live,
            console=False,
            sim_sway_m=self._site.sway_m,
            sim_heading_deg=self._site.heading_deg,
        )

    def meanwhile(self, phase: Optional[int]) -> None:
        """Once they hover before it a tracker that starts late is started."""
        if phase == _COLUMN and "tracker" not in self.launches:
            self._launch_tracker()

    def _launch_tracker(self) -> None:
        plan, site = self.plan, self._site
        arguments = {
            **self._common,
            "sim": True,
            "seed": plan.seed,
            "rviz": plan.rviz,
            **site.launch_args,
        }
        self.launches["tracker"] = self.control.launch(
            "fcsv_bringup", site.launch_file, **arguments
        )

    @property
    def _vehicles(self) -> str:
        return ",".join(self.plan.vehicles)

    @property
    def _common(self) -> Dict[str, object]:
        return {"sim_dir": self.plan.sim_folder, "vehicles": self._vehicles}

    def _calibration(self, name: str) -> str:
        """The file that ``calibrate_camera`` would write of its camera."""
        path = self.plan.run_folder / f"camera_{name}.yaml"
        write_camera(path, name, SimulatedVideoParameters().camera.model)
        return os.fspath(path)


def received_stamps(plan: FleetPlan) -> Dict[str, List[float]]:
    """Gives, by vehicle the stamps (s) that its recorded pictures got: a Tello's video has none of
    its own."""
    found: Dict[str, List[float]] = {name: [] for name in plan.vehicles}
    topics = {f"/{name}/camera/color/camera_info": name for name in plan.vehicles}
    for bag in bags_of(plan.session_folder, []):
        for topic, message in messages(bag, lambda topic, _kind: topic in topics):
            found[topics[topic]].append(seconds(message.header.stamp))
    return found

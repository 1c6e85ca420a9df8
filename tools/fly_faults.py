#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Flies the whole system on ArduCopter's own simulation with one fault in each flight, and says
what happened.

Three masters, relays, nodes, simulated people and pictures, as `make demo AUTOPILOT=...`; each
flight ends with a row of a table. Start the two simulations as docs/user/simulation.md says, on a
quiet machine.

    . devel/setup.sh; python tools/fly_faults.py tcp:127.0.0.1:5760,tcp:127.0.0.1:5770 --speed 0.4
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Callable, Dict, List, Optional

import numpy as np
import psutil

from fcsv_control.flight.mavlink.transport import Transport
from fcsv_geometry.errors import FcsvError
from fcsv_sim.demo.autopilots import addresses, rc_port, require_there
from fcsv_sim.demo.fleet import CONTROL, FleetPlan, SimulatedFleet
from fcsv_sim.machines import slow_motion
from fcsv_sim.machines.machines import MachineError, node_process
from fcsv_sim.people.rc import RcSender
from fcsv_sim.truth import TruthReader

MISSION = """name: faults
limits: {pause_s: 20}
configurations:
  - {axis: horizontal, baseline_m: 5.0, record_s: 6.0}
  - {axis: horizontal, baseline_m: 8.0, record_s: 3.0}
"""
VICTIM, OTHER = "uav2", "uav1"
_FLICK_S = 0.5  # the switch was at LOITER: ArduCopter takes a position that stays for 0.2 s
_BESIDE_PORT = 3  # of a ground station: SERIAL2
_FROZEN = """
import copy, sys, time, rospy
from nav_msgs.msg import Odometry
from fcsv_geometry.ros import node
node.begin("frozen", anonymous=True)
last = rospy.wait_for_message("/{v}/t265/odom/sample", Odometry, 10.0)
out = rospy.Publisher("/{v}/t265/odom/sample", Odometry, queue_size=5)
print("ready", flush=True)
rate = 1.0 / 200.0
while not rospy.is_shutdown():
    m = copy.deepcopy(last)
    m.header.stamp = rospy.Time.from_sec(time.time() - 0.01)
    out.publish(m)
    time.sleep(rate)
"""
_SHIFTED = """
import time, numpy as np, rospy
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger
from fcsv_geometry.messages import pose_to_transform
from fcsv_geometry.ros import conversions, node
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.truth import TruthReader
node.begin("shifted", anonymous=True)
own = lambda name: rospy.get_param("/{v}/t265/" + name)
truth = TruthReader(own("sim_dir"), "{v}")
T_body_t265 = load_vehicles(own("vehicles_dir"), ["{v}"])["{v}"].T_body_t265
last = rospy.wait_for_message("/{v}/t265/odom/sample", Odometry, 10.0)
T_world_t265 = truth.wait_for(last.header.stamp.to_sec()) @ T_body_t265
T_odom_world = pose_to_transform(last.pose.pose) @ np.linalg.inv(T_world_t265)
T_odom_world[1, 3] += 1.0
out = rospy.Publisher("/{v}/t265/odom/sample", Odometry, queue_size=5)
noise, sent_s = np.random.default_rng(1), 0.0
print("ready", flush=True)
open("{go}").read()
rospy.ServiceProxy("/{v}/flight_link/odometry_reset", Trigger)()
print("announced", flush=True)
while not rospy.is_shutdown():
    time.sleep(1.0 / 200.0)
    stamp_s, T_world_body = truth.latest()
    if stamp_s <= sent_s:
        continue
    sent_s = stamp_s
    T_odom_t265 = T_odom_world @ T_world_body @ T_body_t265
    T_odom_t265[:3, 3] += noise.normal(0.0, 1e-3, 3)
    last.header.stamp = rospy.Time.from_sec(stamp_s)
    last.pose.pose = conversions.transform_to_pose(T_odom_t265)
    v = (T_world_body @ T_body_t265)[:3, :3].T @ truth.velocity()
    last.twist.twist.linear.x, last.twist.twist.linear.y, last.twist.twist.linear.z = v
    out.publish(last)
"""


class Flight:
    """One flight, and what was heard in it: (time, topic, words) by the flight's own clock."""

    def __init__(self, out: Path, autopilots, speed: float):
        out.mkdir(parents=True)
        (out / "mission.yaml").write_text(MISSION)
        self.plan = FleetPlan(out, out / "mission.yaml", world="plain", autopilots=autopilots)
        require_there(autopilots, self.plan.vehicles, speed)
        self.fleet = SimulatedFleet(self.plan)
        self.truth = {v: TruthReader(self.plan.sim_folder, v) for v in self.plan.vehicles}
        self.heard: List[tuple] = []
        self._said: List[str] = []
        self.watch = None

    def begin(self) -> None:
        """Masters, nodes, and ears on every machine."""
        from fcsv_sim.demo.ros.mission_watch import MissionWatch

        self.fleet.start()
        for vehicle in self.plan.vehicles:
            ear = self.fleet.machines[vehicle].run(
                [sys.executable, __file__, "--ear", vehicle], "ear"
            )
            threading.Thread(target=self._listen, args=(vehicle, ear.log), daemon=True).start()
        self.watch = MissionWatch(self.fleet.control, self.plan.vehicles, self._say)

    def _listen(self, vehicle: str, log: Path) -> None:
        with open(log) as file:
            while True:
                line = file.readline()
                if line.endswith("}\n") and line.startswith("{"):
                    m = json.loads(line)
                    self.heard.append((m.pop("t"), vehicle, m.pop("what"), m))
                elif not line:
                    time.sleep(0.02)

    def _say(self, line: str) -> None:
        self._said.append(line)
        self.heard.append((time.monotonic(), CONTROL, "said", {"line": line}))
        print(f"    {time.monotonic():.1f} {line}", flush=True)

    def until(self, condition: Callable[[], bool], limit_s: float, otherwise: str) -> None:
        """Raises AssertionError."""
        deadline_s = time.monotonic() + limit_s
        while not condition():
            self.fleet.require_alive()
            if time.monotonic() > deadline_s:
                raise AssertionError(otherwise)
            time.sleep(0.02)

    def said(self, words: str, limit_s: float = 240.0) -> float:
        """Waits for a line of the mission."""
        self.until(
            lambda: any(words in s for s in list(self._said)), limit_s, f"'{words}' was not said"
        )
        return time.monotonic()

    def first(self, who: str, what: str, since_s: float, right: Callable[[dict], bool]) -> float:
        """When it was heard first since a moment (s after it); infinity where it never was."""
        found = (
            t - since_s
            for t, w, h, m in list(self.heard)
            if w == who and h == what and t >= since_s and right(m)
        )
        return next(found, float("inf"))

    def ended(self, limit_s: float = 240.0) -> str:
        """Waits for the mission's end; its last words."""
        self.until(
            lambda: self.watch.over and self.watch.landed, limit_s, "the mission did not end"
        )
        return self._said[-1]

    def process(self, machine: str, node: str) -> psutil.Process:
        """Of a node. Raises MachineError."""
        return node_process(self.fleet.machines[machine].folder, node)

    def place(self, vehicle: str) -> np.ndarray:
        return self.truth[vehicle].latest()[1][:3, 3]


def _moves(flight: Flight, mps: float) -> None:
    flight.until(
        lambda: np.linalg.norm(flight.truth[VICTIM].velocity()) > mps, 60.0, f"no {mps} m/s"
    )


def pilot(flight: Flight) -> Dict[str, str]:
    """The pilot flicks his switch to LOITER, holds for six seconds; the operator resumes."""
    flight.said("on its way to horizontal 8")
    _moves(flight, 1.0)
    people = flight.process(CONTROL, "operator")
    radio = RcSender(rc_port(flight.plan.autopilots[1]))
    people.suspend()
    at_s = time.monotonic()
    while time.monotonic() < at_s + 6.0:
        radio.send(0, 0, 0, 0, "ALT_HOLD" if time.monotonic() < at_s + _FLICK_S else "LOITER")
        time.sleep(0.02)
    obeyed_s = flight.first(VICTIM, "mode", at_s, lambda m: m["mode"] != "GUIDED")
    asked = [
        m
        for t, w, h, m in flight.heard
        if w == VICTIM and h == "asked" and at_s + 0.6 < t < at_s + 6.0
    ]
    people.resume()
    end = flight.ended()
    return {
        "pilot obeyed after": f"{obeyed_s:.2f} s",
        "modes asked for while he flew": str(len(asked)),
        "end": end,
    }


def link(flight: Flight) -> Dict[str, str]:
    """The flight link dies on the way."""
    flight.said("on its way to horizontal 8")
    _moves(flight, 1.0)
    at_s = time.monotonic()
    flight.process(VICTIM, "flight_link").kill()
    flight.until(
        lambda: flight.first(VICTIM, "health", at_s + 0.2, lambda m: m["feed_hz"] > 5) < 99,
        20.0,
        "no feed",
    )
    back_s = flight.first(VICTIM, "health", at_s + 0.2, lambda m: m["feed_hz"] > 5) + 0.2
    end = flight.ended()
    landed = [
        m
        for t, w, h, m in flight.heard
        if w == VICTIM and h == "guardian" and t > at_s and m["action"] == "land"
    ]
    return {
        "fed again after": f"{back_s:.1f} s",
        "guardian landed it": "yes" if landed else "no",
        "end": end,
    }


def freeze(flight: Flight) -> Dict[str, str]:
    """The tracker repeats its last pose while the vehicle moves."""
    script = flight.plan.folder / "frozen.py"
    script.write_text(_FROZEN.replace("{v}", VICTIM))
    flight.said("on its way to horizontal 8")
    _moves(flight, 1.3)
    frozen = flight.fleet.machines[VICTIM].run([sys.executable, str(script)], "frozen")
    flight.until(
        lambda: "ready" in frozen.log.read_text(), 15.0, "the frozen tracker did not start"
    )
    flight.process(VICTIM, "t265").suspend()
    at_s, began = time.monotonic(), flight.place(VICTIM)
    speed = float(np.linalg.norm(flight.truth[VICTIM].velocity()))
    flight.until(lambda: flight.watch.over, 120.0, "the mission did not end")
    land_s = flight.first(VICTIM, "mode", at_s, lambda m: m["mode"] == "LAND")
    aside_s = flight.first(OTHER, "guardian", at_s, lambda m: m["action"] not in ("none", ""))
    end = flight.ended(120.0)
    way_m = float(np.linalg.norm((flight.place(VICTIM) - began)[:2]))
    aside = f"{aside_s:.2f} s" if aside_s < 99.0 else "nothing to do"
    return {
        "speed": f"{speed:.1f} m/s",
        "LAND shown after": f"{land_s:.2f} s",
        "way to the ground": f"{way_m:.1f} m",
        "the other's guardian after": aside,
        "end": end,
    }


def reset(flight: Flight) -> Dict[str, str]:
    """The tracker goes on 1 m elsewhere on the way, and says so; the operator ends the mission."""
    script = flight.plan.folder / "shifted.py"
    go = flight.plan.folder / "go"
    os.mkfifo(go)
    script.write_text(_SHIFTED.replace("{v}", VICTIM).replace("{go}", str(go)))
    flight.said("on its way to horizontal 8")
    shifted = flight.fleet.machines[VICTIM].run([sys.executable, str(script)], "shifted")
    flight.until(
        lambda: "ready" in shifted.log.read_text(), 15.0, "the shifted tracker did not start"
    )
    _moves(flight, 1.0)
    flight.process(VICTIM, "t265").suspend()
    go.write_text("")
    flight.until(lambda: "announced" in shifted.log.read_text(), 5.0, "the reset was not announced")
    at_s, began = time.monotonic(), flight.place(VICTIM)
    flight.said("began anew", 15.0)
    said_s = time.monotonic() - at_s
    flight.until(
        lambda: np.linalg.norm(flight.truth[VICTIM].velocity()) < 0.1, 20.0, "it does not stand"
    )
    stood_s, way_m = time.monotonic() - at_s, float(np.linalg.norm(flight.place(VICTIM) - began))
    held_until_s = time.monotonic() + 5.0
    flight.until(lambda: time.monotonic() > held_until_s, 6.0, "")
    off_m = float(np.linalg.norm(flight.place(VICTIM) - began))
    landed = flight.first(VICTIM, "mode", at_s, lambda m: m["mode"] == "LAND") < 99
    flight.watch.abort()
    end = flight.ended(150.0)
    return {
        "said after": f"{said_s:.1f} s",
        "stands after": f"{stood_s:.1f} s, {way_m:.1f} m further",
        "5 s later": f"{off_m:.2f} m off its place",
        "landed": "yes" if landed else "no",
        "end": end,
    }


def restart(flight: Flight) -> Dict[str, str]:
    """After the calibration its pilot lands; its autopilot restarts on the ground."""
    flight.said("MOVE_HOME")
    people = flight.process(CONTROL, "operator")
    people.suspend()
    radios = {v: RcSender(rc_port(a)) for v, a in zip(flight.plan.vehicles, flight.plan.autopilots)}
    began_s = time.monotonic()
    while flight.watch.states[VICTIM].armed:
        assert time.monotonic() < began_s + 60.0, "it was not landed"
        radios[VICTIM].send(0, 0, 0, 0, "LAND")
        radios[OTHER].send(0, 0, 0, 0, "LOITER")
        time.sleep(0.02)
    kind, host, port = flight.plan.autopilots[1].split(":")
    beside = Transport(f"{kind}:{host}:{int(port) + _BESIDE_PORT}")
    from pymavlink import mavutil

    reboot = mavutil.mavlink.MAVLink(None).command_long_encode(2, 1, 246, 0, 1, 0, 0, 0, 0, 0, 0)
    reboot.get_header().srcSystem, reboot.get_header().srcComponent = 255, 190
    at_s = time.monotonic()
    while time.monotonic() < at_s + 2.0:  # a line of it that was just opened is not read at once
        beside.send(reboot)
        radios[OTHER].send(0, 0, 0, 0, "LOITER")
        time.sleep(0.25)
    beside.close()
    ready_s: Optional[float] = None
    while time.monotonic() < at_s + 60.0 and ready_s is None:
        radios[VICTIM].send(0, 0, 0, 0, "LOITER")
        radios[OTHER].send(0, 0, 0, 0, "LOITER")
        time.sleep(0.02)
        found = flight.first(
            VICTIM, "health", at_s + 5.0, lambda m: m["prearm"] == 1 and m["origin"]
        )
        ready_s = found + 5.0 if found < 99 else None
    gone_s = flight.first(VICTIM, "health", at_s, lambda m: not m["origin"])
    back = flight.first(VICTIM, "health", at_s, lambda m: m["connected"] and m["status"] in (0, 1))
    health = [m for t, w, h, m in flight.heard if w == VICTIM and h == "health" and t > at_s]
    believed = any(m["status"] == 1 and m["origin"] for m in health)
    flight.watch.abort()
    people.resume()
    end = flight.ended(150.0)
    return {
        "origin unknown after": f"{gone_s:.1f} s",
        "first heard (booting) after": f"{back:.1f} s",
        "origin believed while it boots": "yes" if believed else "no",
        "ready to arm after": "never" if ready_s is None else f"{ready_s:.1f} s",
        "end": end,
    }


FAULTS = {"pilot": pilot, "link": link, "freeze": freeze, "reset": reset, "restart": restart}


def listen(vehicle: str) -> None:
    """On a vehicle's own master: mode, guardian, the link's health and modes that are asked for, as
    lines of JSON."""
    import rospy

    from fcsv_geometry.ros import node
    from fcsv_msgs.msg import GuardianState, LinkHealth, ModeAsked
    from mavros_msgs.msg import State

    def tell(what: str, **more) -> None:
        sys.stdout.write(json.dumps({"t": time.monotonic(), "what": what, **more}) + "\n")
        sys.stdout.flush()

    node.begin("ear", anonymous=True)
    on = lambda topic, kind, call: rospy.Subscriber(  # noqa: E731
        f"/{vehicle}/{topic}", kind, call, queue_size=20
    )
    on("mavros/state", State, lambda m: tell("mode", mode=m.mode, armed=m.armed))
    on("guardian/state", GuardianState, lambda m: tell("guardian", action=m.action, why=m.reasons))
    on("flight_link/mode_asked", ModeAsked, lambda m: tell("asked", mode=m.mode))
    on(
        "flight_link/health",
        LinkHealth,
        lambda m: tell(
            "health",
            connected=m.connected,
            origin=m.origin_set,
            status=m.system_status,
            feed_hz=m.feed_rate_hz,
            prearm=m.prearm,
        ),
    )
    rospy.spin()


def fly(name: str, out: Path, autopilots, speed: float) -> Dict[str, str]:
    """One flight; what happened."""
    flight = Flight(out, autopilots, speed)
    try:
        flight.begin()
        return FAULTS[name](flight)
    finally:
        for machine, node in ((CONTROL, "operator"), (VICTIM, "t265")):
            try:
                flight.process(machine, node).send_signal(signal.SIGCONT)
            except MachineError:
                pass
        flight.fleet.stop()


def main() -> int:
    """Exit status 1 where a flight did not come to its end."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "autopilots", nargs="?", default="", help="tcp:127.0.0.1:5760,tcp:127.0.0.1:5770"
    )
    parser.add_argument(
        "--fault", action="append", choices=list(FAULTS), help="which; default: each"
    )
    parser.add_argument(
        "--speed", default="1.0", help="share of real time, as the simulations' --speedup"
    )
    parser.add_argument(
        "-o", "--out", default="out/faults", help="folder for logs; each flight needs a new one"
    )
    parser.add_argument("--ear", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.ear:
        listen(args.ear)
        return 0
    faults = args.fault or list(FAULTS)
    if len(faults) > 1:  # a process has one ROS master
        command = [sys.executable, __file__, args.autopilots, "--speed", args.speed, "-o", args.out]
        return max(subprocess.run([*command, "--fault", name]).returncode for name in faults)
    rate, name = slow_motion.parse_rate(args.speed) or 1.0, faults[0]
    slow_motion.begin_again_in(rate)
    print(f"{name}: {FAULTS[name].__doc__}", flush=True)
    bad = ""
    try:
        told = fly(name, Path(args.out).resolve() / name, addresses(args.autopilots), rate)
    except (AssertionError, FcsvError) as error:
        told, bad = {}, f"did not come to its end: {error}"
    print(f"| {name} | {bad or '; '.join(f'{k} {v}' for k, v in told.items())} |")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

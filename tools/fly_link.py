#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Flies an ArduCopter in software with the nodes of a vehicle, through either flight link, and says
how well it went.

Flight link (or MAVROS and its companion), guardian and agent on a master of their own. The feed is
made of the true pose that the simulation tells as SIM_STATE at a second address. Give it external
navigation as in README, no GPS, no compass.

    python tools/fly_link.py --flight-link mavros --autopilot tcp:127.0.0.1:5760 --truth tcp:127.0.0.1:5762
"""

import argparse
import contextlib
import math
import os
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

os.environ.setdefault("MAVLINK20", "1")

import numpy as np
import psutil
from pymavlink import mavutil

M = mavutil.mavlink
NAME, FEED_Z_M = "uav1", 0.05
SQUARE = ((4.0, 0.0, 0.3), (4.0, 4.0, 1.8), (0.0, 4.0, -2.5), (0.0, 0.0, 0.3))
ROOT = Path(__file__).resolve().parents[1]
LAUNCH = {  # as launch/uav.launch has them
    "mavlink": """<launch><group ns="{uav}">
        <node pkg="fcsv_control" type="flight_link" name="flight_link" respawn="true" output="screen">
          <param name="vehicle" value="{uav}"/><param name="vehicles_dir" value="{vehicles}"/>
          <param name="fcu_url" value="{fcu_url}"/>
          <param name="autopilot_profile" value="{profile}"/></node></group></launch>""",
    "mavros": """<launch><group ns="{uav}">
        <include file="$(find fcsv_bringup)/launch/flight_link_mavros.launch">
          <arg name="uav" value="{uav}"/><arg name="vehicles_dir" value="{vehicles}"/>
          <arg name="fcu_url" value="{fcu_url}"/>
          <arg name="autopilot_profile" value="{profile}"/></include></group></launch>""",
}
sys.path.insert(0, str(ROOT / "tools/bench_link"))


class Truth:
    """The simulation's true pose, ENU from where it was first; and a transmitter whose sticks are
    in the middle."""

    def __init__(self, address: str):
        from fcsv_control.flight.mavlink.transport import Transport

        self.T, self.on_pose, self._first, self._line = (
            None,
            lambda T, stamp_s: None,
            None,
            Transport(address),
        )
        threading.Thread(target=self._hear, daemon=True).start()

    def _hear(self):
        asked_s = sticks_s = -math.inf
        while True:
            if time.monotonic() > asked_s + 2.0:
                asked_s = time.monotonic()
                values = (
                    1,
                    1,
                    M.MAV_CMD_SET_MESSAGE_INTERVAL,
                    0,
                    M.MAVLINK_MSG_ID_SIM_STATE,
                    1e4,
                    0,
                    0,
                    0,
                    0,
                    0,
                )
                ask = M.MAVLink(None).command_long_encode(*values)
                ask.get_header().srcSystem, ask.get_header().srcComponent = 1, 195
                self._line.send(ask)
            if time.monotonic() > sticks_s + 0.2:
                sticks_s = time.monotonic()
                sticks = M.MAVLink(None).rc_channels_override_encode(
                    1, 1, *[1500] * 4, *[65535] * 4
                )
                sticks.get_header().srcSystem, sticks.get_header().srcComponent = 255, 190
                self._line.send(sticks)
            m = self._line.receive(0.05)
            if m is not None and m.get_type() == "SIM_STATE":
                self._take(m)

    def _take(self, m):
        from fcsv_sim.autopilot.elsewhere import rounded_pose

        self._first = self._first or m
        self.T = rounded_pose(m, self._first)
        self.on_pose(self.T, time.time())

    @property
    def p_m(self):
        return self.T[:3, 3] + [0, 0, FEED_Z_M]


class Pilotless:
    """The feed, what is heard of the vehicle, and commands to its agent."""

    def __init__(self, truth: Truth):
        import rospy
        from geometry_msgs.msg import PoseStamped

        from fcsv_geometry.streams.flow import RateGate
        from fcsv_msgs.msg import Command, CommandAck, Heartbeat, LinkHealth
        from mavros_msgs.msg import State, StatusText

        self.truth, self.state, self.health, self.acks, self.number = truth, State(), None, {}, 0
        self.rates, self.said, self.modes, self.fed_s = [], [], {}, -math.inf
        hear = lambda topic, kind, do: rospy.Subscriber(f"/{NAME}/{topic}", kind, do, queue_size=50)  # noqa: E731
        hear("mavros/state", State, self._on_state)
        hear("flight_link/health", LinkHealth, self._on_health)
        hear("mavros/statustext/recv", StatusText, lambda m: self.said.append(m.text))
        hear("guardian/said", StatusText, lambda m: self.said.append(m.text))
        hear("command_ack", CommandAck, lambda m: self.acks.setdefault(m.number, m))
        self._pose = rospy.Publisher(
            f"/{NAME}/mavros/vision_pose/pose", PoseStamped, queue_size=1, tcp_nodelay=True
        )
        self._commands = rospy.Publisher(f"/{NAME}/command", Command, queue_size=10)
        self._alive = rospy.Publisher("/mission/alive", Heartbeat, queue_size=2)
        self._sender = f"fly-{os.getpid()}"
        threading.Thread(target=self._live, daemon=True).start()
        self._random, self._gate = np.random.default_rng(5), RateGate(30.0, 0.3)
        truth.on_pose = self._feed

    def _feed(self, T, stamp_s):
        """30 of the simulation's 100 poses a second; as a T265 that hovers: noise of 1.5 mm and
        0.03 deg."""
        from fcsv_geometry import transforms
        from fcsv_geometry.ros import conversions

        if not self._gate.passes(time.monotonic()):
            return
        noise = self._random.normal(0, 0.0015, 3), np.radians(self._random.normal(0, 0.03, 3))
        T = T @ transforms.from_xyz_rpy(*noise)
        T[2, 3] += FEED_Z_M
        self._pose.publish(conversions.pose_stamped(T, stamp_s, f"{NAME}/odom"))

    def _live(self):
        import rospy

        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import Heartbeat

        while not rospy.is_shutdown():
            header = conversions.header(time.time(), "")
            self._alive.publish(Heartbeat(header, self._sender, 0.0, time.monotonic(), "", ""))
            time.sleep(0.2)

    def _on_state(self, m):
        self.state = m
        self.modes.setdefault(m.mode, time.monotonic())

    def _on_health(self, m):
        self.health = m
        if m.feed_rate_hz > 0:
            self.rates.append(m.feed_rate_hz)
            self.fed_s = time.monotonic()

    def command(self, kind, must=True, **fields):
        """Seconds until it was done; the reason where it was refused, unless it ``must`` be
        done."""
        import rospy

        from fcsv_msgs.msg import Command

        self.number += 1
        c = Command(
            vehicle=NAME,
            sender=self._sender,
            number=self.number,
            kind=getattr(Command, kind),
            **fields,
        )
        c.header.stamp, c.lifetime_s = rospy.Time.now(), 8.0
        c.ordered_s = c.sent_s = asked_s = time.monotonic()
        for _ in range(10):
            self._commands.publish(c)
            if within(lambda: self.number in self.acks, 1.0):
                break
        ack = self.acks[self.number]
        if ack.result != 0:
            if must:
                raise SystemExit(f"{kind} was refused: {ack.reason}")
            return ack.reason
        return time.monotonic() - asked_s

    def furthest_m(self, seconds, place):
        """From a place, by the truth, at most."""
        until_s, most = time.monotonic() + seconds, 0.0
        while time.monotonic() < until_s:
            most = max(most, float(np.linalg.norm(self.truth.p_m - place)))
            time.sleep(0.02)
        return most


def within(condition, seconds):
    until_s = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.005)
    return True


def require(condition, seconds, what):
    if not within(condition, seconds):
        raise SystemExit(f"did not come within {seconds:g} s: {what}")


def processes(word):
    """Of this vehicle's nodes, whose command line has ``word``."""
    own = os.environ["ROS_MASTER_URI"]
    found = []
    for p in psutil.process_iter(["cmdline", "environ"]):
        line = p.info["cmdline"] or []
        if word in line and (p.info["environ"] or {}).get("ROS_MASTER_URI") == own:
            found.append(p)
    return found


def fly(pc: Pilotless, link: str, tell):
    """The whole flight."""
    from fcsv_geometry import transforms
    from fcsv_geometry.ros import conversions

    def at(p, yaw):
        return conversions.pose_stamped(
            transforms.from_xyz_yaw(p, yaw), time.time(), f"{NAME}/odom"
        )

    began_s = time.monotonic()
    require(lambda: pc.state.connected, 60.0, "a heartbeat")
    require(
        lambda: pc.health is not None and pc.health.origin_set and pc.health.parameters_ok,
        90.0,
        "the origin",
    )
    tell("connected, origin set, parameters read", f"{time.monotonic() - began_s:.1f} s")
    asked_s, reason, seen = time.monotonic(), "never asked", []
    while time.monotonic() < asked_s + 90.0:
        reason = pc.command("SET_MODE", must=False, mode="GUIDED")
        reason = pc.command("ARM", must=False, flag=True) if not isinstance(reason, str) else reason
        if not isinstance(reason, str):
            break
        if isinstance(reason, str) and reason not in seen:
            seen.append(reason)
        time.sleep(0.5)
    if isinstance(reason, str):
        raise SystemExit(f"it is not armed: {reason}")
    tell(
        "GUIDED and armed after",
        f"{time.monotonic() - began_s:.1f} s; refused before: {'; '.join(seen) or 'never'}",
    )
    tell("arming, asked until armed", f"{1e3 * reason:.0f} ms")
    pc.command("TAKEOFF", altitude_m=3.0)
    require(lambda: pc.truth.p_m[2] > 2.8, 25.0, f"3 m; it is at {pc.truth.p_m[2]:.2f}")
    time.sleep(4.0)
    tell("height after a take-off to 3 m", f"{pc.truth.p_m[2]:.2f} m")
    x0, y0, _ = pc.truth.p_m
    over_m = 0.0
    for x, y, yaw in SQUARE:
        goal = np.array([x0 + x, y0 + y, 3.0])
        pc.command("GOTO", target=at(goal, yaw))
        require(lambda goal=goal: np.linalg.norm(pc.truth.p_m - goal) < 0.15, 25.0, f"{goal}")
        over_m = max(over_m, pc.furthest_m(4.0, goal))
    tell("4 m square with yaw: furthest from a corner in 4 s after 0.15 m", f"{over_m:.2f} m")
    tell("hold for 20 s: furthest from the target", f"{pc.furthest_m(20.0, goal):.3f} m")
    tell(
        "feed to the autopilot",
        f"{np.median(pc.rates):.1f} Hz (median), {np.min(pc.rates[25:]):.1f} Hz (least)",
    )
    for mode in ("BRAKE", "GUIDED"):
        pc.modes.clear()
        asked_s = time.monotonic()
        pc.command("SET_MODE", mode=mode)
        tell(f"{mode}, asked until it shows", f"{1e3 * (pc.modes[mode] - asked_s):.0f} ms")
    goal = pc.truth.p_m.copy()
    names = {"mavros": ["__name:=flight_link", "__name:=mavros"]}.get(link, ["__name:=flight_link"])
    for name in names:
        spent = sum(sum(p.cpu_times()[:2]) for p in processes(name))
        since_s = time.monotonic()
        time.sleep(10.0)
        spent = sum(sum(p.cpu_times()[:2]) for p in processes(name)) - spent
        tell(f"processor time of {name[8:]}", f"{spent / (time.monotonic() - since_s):.1%}")
    for name in names:
        killed(pc, name, tell)
    tell(
        "furthest from the place after that",
        f"{pc.furthest_m(3.0, goal):.2f} m; mode {pc.state.mode}",
    )
    pc.modes.clear()
    asked_s = time.monotonic()
    pc.command("LAND")
    require(lambda: not pc.state.armed, 60.0, "the ground")
    off_m = np.linalg.norm((pc.truth.p_m - goal)[:2])
    tell("LAND at 3 m until disarmed", f"{time.monotonic() - asked_s:.1f} s; {off_m:.2f} m off")


def killed(pc, name, tell):
    """SIGKILL in hover; roslaunch starts it again. Our part says that it feeds; MAVROS does not say
    so."""
    place, before = pc.truth.p_m.copy(), {p.pid for p in processes(name)}
    for pid in before:
        os.kill(pid, signal.SIGKILL)
    at_s = time.monotonic()
    pc.fed_s = -math.inf
    require(
        lambda: pc.fed_s > at_s and {p.pid for p in processes(name)} - before, 20.0, f"{name} again"
    )
    feeds_s = time.monotonic() - at_s
    off_m = pc.furthest_m(6.0, place)
    what = "its process is there again" if name.endswith("mavros") else "feeds again"
    tell(
        f"{name[8:]} killed in hover",
        f"{what} after {feeds_s:.1f} s, {off_m:.2f} m off, mode {pc.state.mode}",
    )


def main() -> int:
    """The exit status: 0 where it flew."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flight-link", choices=["mavlink", "mavros"], default="mavlink")
    parser.add_argument(
        "--autopilot", default=os.environ.get("FCSV_AUTOPILOT", "tcp:127.0.0.1:5760")
    )
    parser.add_argument(
        "--truth", default=os.environ.get("FCSV_AUTOPILOT_TRUTH", "tcp:127.0.0.1:5762")
    )
    arguments = parser.parse_args()
    import ending

    # as launch/uav.launch starts what a flight depends on; needs root
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    from fcsv_sim.machines.machines import Machine

    with ending.clean_end(), tempfile.TemporaryDirectory(prefix="fly-link-") as folder:
        with Machine("uav1", Path(folder)) as machine:
            os.environ.update({k: v for k, v in machine.env.items() if k.startswith("ROS_")})
            return measure(arguments, machine, Path(folder))


def measure(arguments, machine, folder: Path) -> int:
    """Start the nodes and fly."""
    import rospy

    from fcsv_geometry.ros import node

    node.begin("fly_link", disable_signals=True)
    truth = Truth(arguments.truth)
    require(lambda: truth.T is not None, 30.0, f"SIM_STATE at {arguments.truth}")
    path = folder / "link.launch"
    path.write_text(
        LAUNCH[arguments.flight_link].format(
            uav=NAME,
            vehicles=ROOT / "config/vehicles",
            fcu_url=arguments.autopilot,
            profile=ROOT / "config/autopilot/arducopter-4.3-t265.param",
        )
    )
    machine.run(["roslaunch", "--wait", str(path)], "link")
    for name, more in (("guardian", [f"_vehicles:=[{NAME}]"]), ("agent", [])):
        machine.run(
            ["rosrun", "fcsv_control", name, f"__ns:={NAME}", f"_vehicle:={NAME}", *more], name
        )
    pc = Pilotless(truth)
    try:
        fly(
            pc,
            arguments.flight_link,
            lambda what, value: print(f"| {what} | {value} |", flush=True),
        )
    except SystemExit:
        print(
            "\n".join(pc.said[-15:]),
            *(f.read_text()[-1500:] for f in folder.glob("*.log")),
            sep="\n--- ",
        )
        raise
    finally:
        rospy.signal_shutdown("flown")
    return 0


if __name__ == "__main__":
    sys.exit(main())

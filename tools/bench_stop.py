#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long /stop_all takes: from the call on the control PC to the MAVLink command that leaves the
vehicle.

Two machines in network namespaces with masters, relays and keys; stop_all on one, agent and flight
link on the other, and an autopilot that notes when it is told to BRAKE. No mission runs. Needs
root, as make bench-link.

    python tools/bench_stop.py [--calls 60] [--loss 0 0.3] [--slow-motion]
"""

import argparse
import contextlib
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE / "bench_link"))
BOUNDS_MS = {0.0: 150.0, 0.3: 300.0}
BRAKE_S = 2.0  # so long the autopilot stays in BRAKE, then its pilot gives it back in GUIDED


def main() -> int:
    """Measure, or be one of the machines' parts; the exit status."""
    if sys.argv[1:2] == ["autopilot"]:
        return autopilot(sys.argv[2], int(sys.argv[3]))
    if sys.argv[1:2] == ["caller"]:
        return caller(sys.argv[2], int(sys.argv[3]))
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--calls", type=int, default=60, help="of each loss")
    parser.add_argument(
        "--loss",
        type=float,
        nargs="+",
        default=sorted(BOUNDS_MS),
        help="shares of packets, each way",
    )
    parser.add_argument(
        "--delay-s", type=float, default=0.005, help="of the radio, and as much jitter"
    )
    parser.add_argument(
        "--slow-motion", action="store_true", help="a time that a busy machine slows"
    )
    arguments = parser.parse_args()
    import ending

    with ending.clean_end(), tempfile.TemporaryDirectory(prefix="bench-stop-") as folder:
        return measure(arguments, Path(folder))


def measure(arguments, folder: Path) -> int:
    """A line for each loss; 1 where a bound was not kept."""
    from machines import Net
    from radio import Conditions

    from fcsv_sim.machines.slow_motion import slow_motion

    kept = True
    with contextlib.ExitStack() as stack:
        clock = (
            stack.enter_context(slow_motion()).now_s if arguments.slow_motion else time.monotonic
        )
        conditions = Conditions(delay_s=arguments.delay_s, jitter_s=arguments.delay_s)
        net = stack.enter_context(
            Net(folder, ROOT / "config/links/default.yaml", conditions=conditions, clock=clock)
        )
        begin(net, folder)
        for loss in arguments.loss:
            net.radio.set(loss=loss)
            time.sleep(4.0)  # the relays have their measure of it
            times_ms = calls(net, folder, arguments.calls)
            p50, p95, most = np.percentile(times_ms, [50, 95, 100])
            bound_ms = BOUNDS_MS.get(loss)
            kept &= bound_ms is None or p95 <= bound_ms
            bound = "" if bound_ms is None else f", bound {bound_ms:.0f} ms"
            print(
                f"loss {loss:.0%}: p50 {p50:.0f} ms, p95 {p95:.0f} ms{bound}, most {most:.0f} ms, "
                f"{len(times_ms)} calls",
                flush=True,
            )
    return 0 if kept else 1


def begin(net, folder: Path) -> None:
    """The nodes on both machines."""
    vehicle, control = net.machines["uav1"], net.machines["control"]
    run = lambda machine, package, node, *more: machine.run(["rosrun", package, node, *more], node)  # noqa: E731
    vehicle.run(
        [sys.executable, __file__, "autopilot", str(folder / "heard.jsonl"), "14550"], "autopilot"
    )
    profile = Path(__file__).resolve().parents[1] / "config/autopilot/arducopter-4.3-t265.param"
    run(
        vehicle,
        "fcsv_control",
        "flight_link",
        "__ns:=uav1",
        "_vehicle:=uav1",
        "_fcu_url:=udpin:127.0.0.1:14550",
        f"_autopilot_profile:={profile}",
    )
    run(vehicle, "fcsv_control", "agent", "__ns:=uav1", "_vehicle:=uav1", "_guardian:=false")
    run(control, "fcsv_control", "stop_all", "_vehicles:=[uav1]")


def calls(net, folder: Path, count: int) -> np.ndarray:
    """Milliseconds from each call to the first BRAKE after it."""
    called = folder / f"called-{time.monotonic()}.jsonl"
    process = net.machines["control"].run(
        [sys.executable, __file__, "caller", str(called), str(count)], called.stem
    )
    while process.returncode is None:
        time.sleep(0.2)
    if process.returncode != 0:
        raise SystemExit(f"the caller ended with {process.returncode}: {process.tail(8)}")
    called_s = [json.loads(line) for line in called.read_text().splitlines()]
    heard_s = np.array(
        [json.loads(line) for line in (folder / "heard.jsonl").read_text().splitlines()]
    )
    return np.array([1e3 * (heard_s[heard_s >= at_s].min() - at_s) for at_s in called_s])


def caller(path: str, count: int) -> int:
    """Calls again and again, whenever the vehicle shows GUIDED."""
    import rospy
    from std_msgs.msg import String
    from std_srvs.srv import Trigger

    from fcsv_geometry.ros import node
    from mavros_msgs.msg import State

    node.begin("caller")
    modes = []
    rospy.Subscriber("/uav1/mavros/state", State, lambda m: modes.append(m.mode))
    over = rospy.Publisher("/stop_all/over", String, queue_size=1)
    rospy.wait_for_service("/stop_all", 60.0)
    stop = rospy.ServiceProxy("/stop_all", Trigger, persistent=True)
    random, called = np.random.default_rng(1), []

    def shown(mode: str, timeout_s: float, must: bool = True) -> None:
        deadline = time.time() + timeout_s
        while (not modes or modes[-1] != mode) and time.time() < deadline:
            time.sleep(0.01)
        if must and modes[-1:] != [mode]:
            raise SystemExit(f"{mode} does not show; {modes[-3:]}")

    for _ in range(count):
        shown("GUIDED", 60.0)
        time.sleep(0.3 + 0.5 * random.random())
        called.append(time.time())
        stop()  # each is called once, in GUIDED as far as the control PC knows
        shown("BRAKE", BRAKE_S, must=False)  # the radio may lose what tells of it
        over.publish(String("bench"))
    with open(path, "w") as file:
        file.writelines(json.dumps(at_s) + "\n" for at_s in called)
    return 0


def autopilot(path: str, port: int) -> int:
    """An armed autopilot in GUIDED with a pose feed; notes when BRAKE was asked for."""
    import rospy
    from geometry_msgs.msg import PoseStamped
    from pymavlink import mavutil

    from fcsv_control.flight.state import MODES

    m = mavutil.mavlink
    from fcsv_geometry.ros import node

    node.begin("autopilot")
    feed = rospy.Publisher(
        "/uav1/mavros/vision_pose/pose", PoseStamped, queue_size=1, tcp_nodelay=True
    )
    pose = PoseStamped()
    pose.header.frame_id, pose.pose.orientation.w = "uav1/odom", 1.0
    link = mavutil.mavlink_connection(
        f"udpout:127.0.0.1:{port}", source_system=1, source_component=1
    )
    guided, brake = MODES["GUIDED"], MODES["BRAKE"]
    mode, since_s, beat_s, slow_s = guided, time.time(), 0.0, 0.0

    def heartbeat() -> None:
        flags = m.MAV_MODE_FLAG_SAFETY_ARMED | m.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        link.mav.heartbeat_send(m.MAV_TYPE_QUADROTOR, m.MAV_AUTOPILOT_ARDUPILOTMEGA, flags, mode, 3)

    with open(path, "a", buffering=1) as file:
        while not rospy.is_shutdown():
            with contextlib.suppress(ConnectionRefusedError):
                asked = link.recv_match(blocking=True, timeout=0.005)
                now_s = time.time()
                if asked is not None and asked.get_type() == "COMMAND_LONG":
                    to = asked.get_srcSystem(), asked.get_srcComponent()
                    if (
                        asked.command == m.MAV_CMD_DO_SET_MODE
                        and int(asked.param2) == brake
                        and mode != brake
                    ):
                        file.write(json.dumps(now_s) + "\n")
                        mode, since_s, beat_s = brake, now_s, 0.0
                    link.mav.command_ack_send(asked.command, 0, 0, 0, *to)
                if mode == brake and now_s - since_s > BRAKE_S:
                    mode, beat_s = guided, 0.0
                if now_s - beat_s > 0.5:
                    beat_s = now_s
                    heartbeat()
                if now_s - slow_s > 0.05:
                    slow_s = now_s
                    boot_ms = int(1e3 * time.monotonic()) % 2**31
                    link.mav.attitude_send(boot_ms, 0, 0, 0, 0, 0, 0)
                    link.mav.local_position_ned_send(boot_ms, 0, 0, -3.0, 0, 0, 0)
                    pose.header.stamp = rospy.Time.from_sec(now_s)
                    feed.publish(pose)
    return 0


if __name__ == "__main__":
    sys.exit(main())

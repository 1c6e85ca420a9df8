#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long the autopilot is without poses when its flight link is killed and roslaunch starts it
again.

    python tools/bench_link_restart.py --times 10 --busy 4

A simulated autopilot over UDP, poses at 30 Hz, the link killed (SIGKILL) again and again, beside so
many processes that take what they get of the processor. Exit status 1 where a gap is longer than
--bound.
"""

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
_LAUNCH = """<launch><group ns="uav1">
  <node pkg="fcsv_control" type="flight_link" name="flight_link" respawn="true" output="screen"
        launch-prefix="$(find fcsv_bringup)/scripts/priority -10">
    <param name="vehicle" value="uav1"/>
    <param name="fcu_url" value="udpin:127.0.0.1:{port}"/>
    <param name="link/target_system" value="1"/>
    <param name="autopilot_profile" value="$(find fcsv_bringup)/config/autopilot/arducopter-4.3-t265.param"/>
  </node>
</group></launch>
"""


class Autopilot:
    """The simulated one at the end of a UDP line; ``came_s`` are the times at which poses came."""

    def __init__(self, port: int):
        from fcsv_sim.autopilot.core import Autopilot as Pilot
        from fcsv_sim.autopilot.mavlink_server import MavlinkServer
        from fcsv_sim.autopilot.udp import UdpLine

        self.came_s, outer = [], self

        class Counting(MavlinkServer):
            def take(self, now_s, message):
                if message.get_type() == "VISION_POSITION_ESTIMATE":
                    outer.came_s.append(now_s)
                super().take(now_s, message)

        self._line = UdpLine(Counting(Pilot(0.3, 1), 1), f"127.0.0.1:{port}", 1)
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while True:
            self._line.step(time.monotonic(), (0.0, 0.0, 0.0))
            time.sleep(0.005)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--busy", type=int, default=0, help="processes that take what they get")
    parser.add_argument("--bound", type=float, default=2.0, help="seconds (default %(default)s)")
    arguments = parser.parse_args()
    from fcsv_sim.machines.machines import free_port

    master, port = free_port(), free_port(socket.SOCK_DGRAM)
    os.environ.update(ROS_MASTER_URI=f"http://127.0.0.1:{master}", ROS_IP="127.0.0.1")
    with tempfile.TemporaryDirectory() as folder:
        launch = Path(folder) / "link.launch"
        launch.write_text(_LAUNCH.format(port=port))
        os.environ["ROS_LOG_DIR"] = folder
        started = [
            subprocess.Popen(
                ["roslaunch", "-p", str(master), str(launch)], stdout=subprocess.DEVNULL
            )
        ]
        started += [
            subprocess.Popen([sys.executable, "-c", "while True: pass"])
            for _ in range(arguments.busy)
        ]
        try:
            gaps_s = measured(Autopilot(port), arguments.times)
        finally:
            for process in started[1:]:
                process.kill()
            started[0].send_signal(signal.SIGINT)
            started[0].wait(20.0)
    load = os.getloadavg()[0]
    beside = f"{arguments.busy} busy processes, load {load:.1f} on {os.cpu_count()} cores"
    median_s, worst_s = np.median(gaps_s), max(gaps_s)
    print(
        f"{len(gaps_s)} kills, {beside}: without poses {median_s:.2f} s (median), {worst_s:.2f} s (worst)"
    )
    return 1 if max(gaps_s) > arguments.bound else 0


def measured(autopilot: Autopilot, times: int):
    """Seconds without poses, kill by kill."""
    import rospy
    from geometry_msgs.msg import PoseStamped

    from fcsv_geometry.ros import node
    from fcsv_msgs.msg import LinkHealth

    node.begin("bench_link_restart", disable_signals=True)
    health = []
    rospy.Subscriber("/uav1/flight_link/health", LinkHealth, lambda m: health.append(m))
    poses = rospy.Publisher(
        "/uav1/mavros/vision_pose/pose", PoseStamped, queue_size=1, tcp_nodelay=True
    )

    def pose(_event):
        message = PoseStamped()
        message.header.stamp, message.header.frame_id = rospy.Time.now(), "uav1/odom"
        message.pose.orientation.w = 1.0
        poses.publish(message)

    rospy.Timer(rospy.Duration(1 / 30), pose)
    gaps_s = []
    for _ in range(times):
        until(
            lambda: autopilot.came_s and time.monotonic() - autopilot.came_s[-1] < 0.2 and health,
            60.0,
        )
        time.sleep(3.0)
        pid = health[-1].pid
        health.clear()
        killed_s = time.monotonic()
        os.kill(pid, signal.SIGKILL)
        until(
            lambda k=killed_s, p=pid: (
                autopilot.came_s[-1] > k + 0.1 and health and health[-1].pid != p
            ),
            60.0,
        )
        came_s = [at_s for at_s in autopilot.came_s if at_s > killed_s - 0.5]
        gaps_s.append(max(np.diff(came_s)))
        print(f"without poses for {gaps_s[-1]:.2f} s", flush=True)
    return gaps_s


def until(condition, timeout_s: float) -> None:
    end_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > end_s:
            raise SystemExit("the flight link did not come back")
        time.sleep(0.02)


if __name__ == "__main__":
    sys.exit(main())

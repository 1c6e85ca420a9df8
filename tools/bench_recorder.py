#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What a killed recorder costs: seconds of data that its repaired bag lacks, and seconds until the
next one records.

Starts a ROS master of its own: python tools/bench_recorder.py --kills 10 A recorder is fed 30
pictures of 640x480 and 200 odometry messages a second and gets SIGKILL at a random moment.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import List, NamedTuple, Optional

from tqdm import tqdm

from fcsv_geometry.bags.repair import repaired
from fcsv_sim.machines.machines import Machine

NAME = "uav1"


class Killed(NamedTuple):
    """Of one kill: data lost (s), from the kill to the first message of the next part (s)."""

    lost_s: float
    again_s: float


class Feed:
    """Publishes numbered messages, and remembers when."""

    def __init__(self):
        import rospy
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import Image

        self._odometry = rospy.Publisher(f"/{NAME}/odometry/body", Odometry, queue_size=200)
        self._pictures = rospy.Publisher(f"/{NAME}/camera/color/image_raw", Image, queue_size=5)
        self._image = Image(
            height=480, width=640, encoding="rgb8", step=1920, data=os.urandom(480 * 1920)
        )
        self._message, self._number = Odometry(), 0

    def ready(self) -> bool:
        return bool(self._odometry.get_num_connections() and self._pictures.get_num_connections())

    def run(self, seconds: float) -> None:
        """200 odometry messages a second, stamped by the wall clock; every seventh with a
        picture."""
        import rospy

        end_s = next_s = time.monotonic()
        end_s += seconds
        while next_s < end_s:
            self._message.header.stamp = self._image.header.stamp = rospy.Time.from_sec(time.time())
            self._odometry.publish(self._message)
            if self._number % 7 == 0:
                self._pictures.publish(self._image)
            self._number += 1
            next_s += 0.005
            time.sleep(max(next_s - time.monotonic(), 0.0))


def stamps_s(bag: Path) -> List[float]:
    """Of its odometry."""
    import rosbag

    with rosbag.Bag(str(bag)) as opened:
        return [
            m.header.stamp.to_sec() for _, m, _ in opened.read_messages(f"/{NAME}/odometry/body")
        ]


def kill_once(machine: Machine, feed: Feed, folder: Path, seconds: float) -> Killed:
    """Record, kill, start the next one as roslaunch does, repair."""

    def start():
        params = ["_role:=vehicle", f"_name:={NAME}", f"_folder:={folder}", "_pictures_on:=true"]
        return machine.run(
            ["rosrun", "fcsv_control", "recorder", f"__ns:={NAME}", *params], "recorder"
        )

    first = start()
    until(feed.ready)
    feed.run(seconds)
    os.killpg(first.pid, signal.SIGKILL)
    killed_s = time.time()
    again = start()
    feed.run(6.0)
    again.stop()
    bag, _ = repaired(folder / f"{NAME}.bag.active")
    return Killed(
        max(killed_s - stamps_s(bag)[-1], 0.0), stamps_s(folder / f"{NAME}.1.bag")[0] - killed_s
    )


def until(condition, limit_s: float = 20.0) -> None:
    end_s = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end_s:
            raise SystemExit("bench_recorder: the recorder does not start")
        time.sleep(0.02)


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 1 where a kill cost more than a second, or the next recorder took more than
    three."""
    parser = argparse.ArgumentParser(prog="bench_recorder", description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=10)
    args = parser.parse_args(argv)
    moments, results = random.Random(1), []
    with tempfile.TemporaryDirectory() as folder:
        with Machine("bench_recorder", Path(folder)) as machine:
            os.environ.update({k: v for k, v in machine.env.items() if k.startswith("ROS_")})
            import rospy

            from fcsv_geometry.ros import node

            node.begin("bench_recorder", disable_signals=True)
            feed = Feed()
            for i in tqdm(range(args.kills), desc="kills"):
                place = Path(folder) / f"session{i}"
                results.append(kill_once(machine, feed, place, moments.uniform(2.0, 4.0)))
            rospy.signal_shutdown("done")
    for name, values in zip(("lost", "recording again after"), zip(*results)):
        print(f"{name}: median {sorted(values)[len(values) // 2]:.2f} s, most {max(values):.2f} s")
    return int(max(r.lost_s for r in results) > 1.0 or max(r.again_s for r in results) > 3.0)


if __name__ == "__main__":
    sys.exit(main())

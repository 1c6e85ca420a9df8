#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What a flight with live mapping sends over the radio, and how good the live map is beside the map
from the bags.

It flies the demo once, without a screen: python tools/live_flight.py
Rates are per second of the flight's own time, of what the control PC receives.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Callable, Dict, List

import numpy as np

# over the radio, for two vehicles; between the maps, of pixels within 10 %
MOST_MBIT_S, MOST_POINTS = 10.0, 2.0
CONFIGURATIONS = 7  # of fcsv_msgs/MissionState
ROOT = Path(__file__).resolve().parent.parent


class Heard:
    """What the control PC's relay and its live map said."""

    def __init__(self, vehicles: List[str]):
        import rospy
        from diagnostic_msgs.msg import DiagnosticArray
        from sensor_msgs.msg import CameraInfo, Image

        # needs this fleet's master in the environment
        from fcsv_sim.demo.ros.mission_watch import MissionWatch

        self.watch = MissionWatch(SimpleNamespace(env=os.environ), vehicles, lambda _line: None)
        self.mbit_s: List[float] = []
        self.depth = self.info = None
        rospy.Subscriber("/relay/links", DiagnosticArray, self._on_links)
        rospy.Subscriber("/map/depth", Image, lambda m: setattr(self, "depth", m))
        rospy.Subscriber("/map/camera_info", CameraInfo, lambda m: setattr(self, "info", m))

    def _on_links(self, message) -> None:
        if self.watch.phase == CONFIGURATIONS:
            links = [{kv.key: kv.value for kv in s.values} for s in message.status]
            self.mbit_s.append(
                sum(float(v["in_kbit_s"]) for v in links if "in_kbit_s" in v) / 1000.0
            )


def live_share(heard: Heard, truth_folder: Path, vehicle: str) -> float:
    """Share of the live map's pixels, up to 400 m, that are within 10 % of the truth."""
    from fcsv_geometry.ros import conversions
    from fcsv_stereo.evaluating.evaluation import band
    from fcsv_stereo.evaluating.truth import load_truth

    m = heard.depth
    depth = np.frombuffer(m.data, np.float32).reshape(m.height, m.width)
    camera = conversions.camera_from_info(heard.info)
    reference = SimpleNamespace(vehicle=vehicle, stamp_s=m.header.stamp.to_sec(), camera=camera)
    return band(depth, load_truth(truth_folder).depth(reference), (0.0, 400.0)).within_10_percent


def wait(condition: Callable[[], bool], deadline_s: float, otherwise: str) -> None:
    """Raises SystemExit with ``otherwise`` once it is too late."""
    while not condition():
        if time.monotonic() > deadline_s:
            raise SystemExit(f"live_flight: {otherwise}")
        time.sleep(0.2)


def fly(folder: Path, mission: str, limit_s: float) -> Dict[str, float]:
    """The figures of a demo that flies into ``folder``; it is stopped where it is not over in
    time."""
    wanted = {"LIVE": "1", "RVIZ": "0", "OUT": str(folder), "MISSION": mission, "OVERWRITE": "1"}
    demo = subprocess.Popen([str(ROOT / "tools" / "run"), "demo"], env={**os.environ, **wanted})
    try:
        return measure(folder, limit_s, lambda: demo.poll() is None)
    finally:
        if demo.poll() is None:
            demo.send_signal(signal.SIGINT)  # it lands the vehicles
        demo.wait()


def measure(folder: Path, limit_s: float, flies: Callable[[], bool]) -> Dict[str, float]:
    """The figures. Raises SystemExit where no demo flies, or none is live."""
    deadline_s, description = time.monotonic() + limit_s, folder / "run" / "fleet.json"
    begun = time.time()
    fresh = lambda path: path.exists() and path.stat().st_mtime > begun  # noqa: E731
    wait(lambda: fresh(description) or not flies(), deadline_s, "no demo began")
    wait(lambda: fresh(description), time.monotonic() + 1.0, f"no demo flies in {folder}")
    fleet = json.loads(description.read_text())
    os.environ["ROS_MASTER_URI"] = fleet["control"]["ROS_MASTER_URI"]
    heard = Heard([n for n in fleet if n != "control"])
    wait(lambda: heard.watch.over or not flies(), deadline_s, "the mission did not end")
    report = folder / "map" / "report.json"
    wait(lambda: fresh(report) or not flies(), deadline_s, "no map was made from the bags")
    if not fresh(report):
        raise SystemExit("live_flight: the demo made no map from the bags")
    if heard.depth is None or not heard.mbit_s:
        raise SystemExit("live_flight: there was no live map; start the demo with LIVE=1")
    document = json.loads(report.read_text())
    live = live_share(
        heard, folder / "session" / "truth", document["reference"]["image"].split("/")[0]
    )
    return {
        "mean_mbit_s": float(np.mean(heard.mbit_s)),
        "most_mbit_s": max(heard.mbit_s),
        "live_percent": 100 * live,
        "bags_percent": 100 * document["truth"]["within_10_percent"],
    }


def main() -> int:
    """Exit status 1 where more is sent, or the maps differ by more, than wanted."""
    parser = argparse.ArgumentParser(prog="live_flight", description=__doc__.split("\n")[0])
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path("out/live_flight"), help="the demo's OUT"
    )
    parser.add_argument("--mission", default="short", help="as MISSION of the demo")
    parser.add_argument(
        "--limit", type=float, default=1200.0, help="seconds to wait for the flight and its map"
    )
    args = parser.parse_args()
    f = fly(args.folder.resolve(), args.mission, args.limit)
    print(
        f"radio, all vehicles together: {f['mean_mbit_s']:.1f} Mbit/s, at most {f['most_mbit_s']:.1f} Mbit/s"
    )
    print(
        f"within 10 %: live map {f['live_percent']:.1f} %, map from the bags {f['bags_percent']:.1f} %"
    )
    return int(
        f["most_mbit_s"] > MOST_MBIT_S or f["bags_percent"] - f["live_percent"] > MOST_POINTS
    )


if __name__ == "__main__":
    sys.exit(main())

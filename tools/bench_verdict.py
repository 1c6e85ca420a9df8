#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The window's GO / NO-GO over flights that were recorded, beside what their maps say of the same
pairs.

    python tools/bench_verdict.py SESSION=MAP ...
    python tools/bench_verdict.py --spoil OUT SESSION ...

SESSION is a flight's folder of bags, MAP the folder of its map. The bags are played into the
window's model by their own times. A verdict flips where GO and NO-GO change places while one
configuration is recorded. The map accepts a pair whose refined pictures miss their epipolar lines
by no more than the report's bound.

With --spoil copies of the flights are written to OUT, in each of which something is wrong with the
last vehicle's camera (tools/spoil.py), and mapped.
"""

import argparse
import heapq
import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

import rosbag
import rospy
from spoil import SPOILS, spoilt
from tqdm import tqdm

from fcsv_console.model.console import Console
from fcsv_console.model.epipolar import EpipolarWatch
from fcsv_console.ros import messages
from fcsv_control.mission.activities import stages
from fcsv_geometry.config import read_yaml
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_stereo import pipeline
from fcsv_stereo.errors import StereoError
from fcsv_stereo.report.plain_words import MOST_EPIPOLAR_PX

_ROOT = Path(__file__).resolve().parents[1]
_LOOK_S = 0.2  # between two looks at the window
_MEASURE_S = 1.0  # as the window measures the epipolar error
_OF_VEHICLE = {**messages.OF_VEHICLE, **messages.RECORDED}


@dataclass
class Recording:
    """Holds what the window said while one configuration was recorded."""

    name: str
    verdicts: List[bool]
    words: str = ""

    @property
    def flips(self) -> int:
        return sum(a != b for a, b in zip(self.verdicts, self.verdicts[1:]))


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Exit status 1 where a verdict flipped."""
    parser = argparse.ArgumentParser(prog="bench_verdict", description=__doc__.split("\n\n")[0])
    parser.add_argument("flights", nargs="+", metavar="SESSION=MAP")
    parser.add_argument("--spoil", type=Path, metavar="OUT", help="folder for spoilt copies")
    args = parser.parse_args(argv)
    if args.spoil:
        flights = (f for s in args.flights for f in spoilt_flights(Path(s), args.spoil))
    else:
        flights = (_flight(words) for words in args.flights)
    flips = agreeing = compared = 0
    print("| flight | configuration | verdicts | flips | window at its end | map |")
    print("|---" * 6 + "|")
    for title, session, folder in flights:
        accepted = of_map(folder) if folder else {}
        for k, recording in enumerate(recordings(session)):
            if not recording.verdicts:
                continue
            go, of_pair = recording.verdicts[-1], accepted.get(recording.name)
            flips += recording.flips
            if of_pair is not None:
                compared, agreeing = compared + 1, agreeing + (of_pair == go)
            cells = (
                title,
                f"{k + 1} {recording.name}",
                len(recording.verdicts),
                recording.flips,
                recording.words,
                {None: "not mapped", True: "accepted", False: "doubted"}[of_pair],
            )
            print("| " + " | ".join(map(str, cells)) + " |", flush=True)
    share = f"{agreeing / compared:.0%}" if compared else "-"
    print(f"\nflips: {flips}; the map agrees with {agreeing} of {compared} ({share})")
    return 1 if flips else 0


def _flight(words: str) -> Tuple[str, Path, Optional[Path]]:
    """Title, session and map of SESSION=MAP."""
    session, _, folder = words.partition("=")
    return Path(session).parent.name, Path(session), Path(folder) if folder else None


def spoilt_flights(session: Path, out: Path) -> Iterator[Tuple[str, Path, Optional[Path]]]:
    """Title, session and map of each way to spoil a flight; without a map where none could be
    made."""
    vehicle = read_yaml(session / "session.yaml")["vehicles"][-1]
    for what in SPOILS:
        folder = out / f"{session.parent.name} {what}".replace(" ", "-").replace("%", "percent")
        copy = folder / "session"
        if not copy.exists():
            spoilt(session, vehicle, what, copy)
        try:
            pipeline.run(pipeline.MapRequest(copy, folder / "map"))
        except StereoError as error:
            print(f"{what}: no map: {error}", file=sys.stderr)
            yield what, copy, None
            continue
        yield what, copy, folder / "map"


def of_map(folder: Path) -> Dict[str, bool]:
    """Gives for each configuration by name whether the map accepted its pair."""
    report = json.loads((folder / "report.json").read_text())
    rms_px = {
        image["name"]: image["epipolar_rms_px"] for image in report["images"] if image["refined"]
    }
    return {
        c["name"]: rms_px.get(c["pair"][1], math.inf) <= MOST_EPIPOLAR_PX
        for c in report["configurations"]
    }


def recordings(session: Path) -> List[Recording]:
    """Plays a session into the window's model; gives its recordings in their order."""
    rospy.rostime.set_rostime_initialized(True)  # conversions ask for the time, no node runs
    names, found = read_yaml(session / "session.yaml")["vehicles"], []
    tags = {n: v.tag_id for n, v in load_vehicles(_ROOT / "config/vehicles", names).items()}
    console, watch = Console(names, tags, recorded=True), EpipolarWatch(names)
    look_s = measure_s = -math.inf
    before = None
    for at_s, name, topic, message in tqdm(
        _played(session, names), session.parent.name, unit=" messages", disable=None
    ):
        _tell(console, watch, at_s, name, topic, message)
        if at_s - look_s < _LOOK_S:
            continue
        look_s, view = at_s, console.view(at_s)
        if at_s - measure_s >= _MEASURE_S and view.stereo.pair[0]:
            measure_s, told = at_s, watch.measure(view.stereo.pair)
            if told is not None:
                console.tell(at_s, told)
        state = view.mission.value
        running = view.running if state is not None and state.stage == stages.RECORDS else None
        if running is not None and running != before:
            found.append(Recording(view.file.rows[running].title, []))
        before = running
        if running is not None and view.stereo.judged:
            found[-1].verdicts.append(view.stereo.go)
            found[-1].words = view.stereo.words
    return found


def _played(session: Path, names: Sequence[str]) -> Iterator[Tuple[float, str, str, Any]]:
    """Messages of all bags by the time at which they were recorded: (time, vehicle, topic under
    its name or whole, message). What of a vehicle crossed to the control PC is not told twice."""
    own = ("tags/detections", "camera/color/image_raw", "camera/color/camera_info")

    def control():
        known = {f"/{n}/{t}": (n, t) for n in names for t in _OF_VEHICLE}
        with rosbag.Bag(str(session / "control.bag")) as bag:
            for topic, message, t in bag.read_messages([*known, *messages.OF_CONTROL]):
                yield (t.to_sec(), *known.get(topic, ("", topic)), message)

    def vehicle(name):
        with rosbag.Bag(str(session / f"{name}.bag")) as bag:
            for topic, message, t in bag.read_messages([f"/{name}/{o}" for o in own]):
                yield t.to_sec(), name, topic[len(name) + 2 :], message

    return heapq.merge(control(), *map(vehicle, names), key=lambda found: found[0])


def _tell(
    console: Console, watch: EpipolarWatch, at_s: float, name: str, topic: str, message: Any
) -> None:
    """Hands a message to the model as the window's subscriptions do."""
    if topic == "camera/color/camera_info":
        watch.tell_camera(name, conversions.camera_from_info(message))
        return
    if topic == "camera_pose":
        T_home_cam = conversions.pose_to_transform(message.pose.pose)
        watch.tell_pose(name, message.header.stamp.to_sec(), T_home_cam)
    table = _OF_VEHICLE if name else messages.OF_CONTROL
    try:
        fact = table[topic][1](name, message)
    except FcsvError as error:
        print(f"{name} {topic}: {error}", file=sys.stderr)
        return
    if topic in messages.RECORDED:
        watch.tell_live(name, fact.stamp_s, fact.data)
    console.tell(at_s, fact)


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""Whether a change leaves the rehearsal's flights as they were, to the last bit.

    tools/run same-flights --write before.json      at the old code
    tools/run same-flights --against before.json    at the new code: exit status 1 where a flight differs

A flight is a mission with its faults and a seed. Compared are, second by second, a SHA-256 sum of
where all vehicles are and how fast they fly, all commands to the autopilots, and how the flight
ended.
"""

import argparse
import hashlib
import json
import os
import sys
from pathlib import Path
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_geometry.missions.mission import load_mission
from fcsv_sim.bringup import mission_file
from fcsv_sim.rehearsal.command import Job, on_all_cores, rehearse
from fcsv_sim.rehearsal.faults import FAULTS, NONE
from fcsv_sim.rehearsal.flight import Flight, Result

_EVERY_S = 1.0
_DIGITS = 12
_PAIRS = ("clock steps+radio holds up", "link dies+tracker gone", "low battery alone+radio loses")
_OF_FIVE = (NONE, "radio cut", "comes down")
_SEED = 3


class Account:
    """What happened in one flight."""

    def __init__(self):
        self._seconds: List[str] = []
        self._next_s = 0.0
        self._flight: Optional[Flight] = None

    def watch(self, flight: Flight) -> None:
        """Before it begins."""
        self._flight, flight.recorder = flight, self._look

    def _look(self, flight: Flight) -> None:
        if flight.now_s >= self._next_s:
            self._next_s += _EVERY_S
            bodies = [v.body for v in flight.fleet.values()]
            moved = np.array([(b.position_m, b.velocity_mps) for b in bodies])
            self._seconds.append(hashlib.sha256(moved.tobytes()).hexdigest()[:_DIGITS])

    def told(self, result: Result) -> Dict:
        """All of it, for a file."""
        commands = [
            f"{at_s:.2f} s: {who} {words}" for at_s, who, words in self._flight.witness.commands
        ]
        broken = [f"{v.at_s:.2f} s: {v.text}" for v in result.violations]
        end = f"{result.phase} ({result.detail}) after {result.flown_s:.2f} s, {result.captures} captures"
        return {"seconds": self._seconds, "commands": commands, "violations": broken, "end": end}


def fly(job: Job) -> Dict:
    """One flight, and what happened in it."""
    account = Account()
    return account.told(rehearse(job, account.watch))


def first_difference(before: Optional[Dict], after: Dict) -> str:
    """In words, where a flight differs from the one before first; empty where it does not.

    >>> was = {"seconds": ["a", "b"], "commands": ["1.00 s: uav1 mode LAND"], "violations": [], "end": "DONE"}
    >>> first_difference(was, was)
    ''
    >>> first_difference(was, {**was, "seconds": ["a", "c"], "commands": []})
    'moves otherwise from second 1; command 1: 1.00 s: uav1 mode LAND, now nothing'
    >>> first_difference(None, was)
    'was not flown before'
    """
    if before is None:
        return "was not flown before"
    said = []
    at = _first(before["seconds"], after["seconds"])
    if at is not None:
        said.append(f"moves otherwise from second {at}")
    for name, what in (("commands", "command"), ("violations", "violation")):
        at = _first(before[name], after[name])
        if at is not None:
            was, now = ((told[name] + ["nothing"] * (at + 1))[at] for told in (before, after))
            said.append(f"{what} {at + 1}: {was}, now {now}")
    if before["end"] != after["end"]:
        said.append(f"ended {before['end']}, now {after['end']}")
    return "; ".join(said)


def _first(before: List[str], after: List[str]) -> Optional[int]:
    """Index of the first item that is not the same."""
    if before == after:
        return None
    same = (a == b for a, b in zip(before, after))
    return next((i for i, equal in enumerate(same) if not equal), min(len(before), len(after)))


def jobs(many: bool) -> List[Tuple[str, Job]]:
    """The flights, by name; ``many``: every fault, else every third of them."""
    short, five = (load_mission(mission_file(name)) for name in ("short", "five"))
    found = [(short, 2, faults) for faults in (NONE, *_PAIRS, *sorted(FAULTS)[:: 1 if many else 3])]
    found += [(five, 5, faults) for faults in _OF_FIVE[: None if many else 1]]
    return [
        (f"{n} | {faults}", Job(mission, n, _SEED + i, faults))
        for i, (mission, n, faults) in enumerate(found)
    ]


def main(argv: Optional[List[str]] = None) -> int:
    """Fly all; write what happened, or compare it with a file."""
    parser = argparse.ArgumentParser(prog="same-flights", description=__doc__)
    parser.add_argument("--write", type=Path, help="file for what happened")
    parser.add_argument("--against", type=Path, help="file that --write made with other code")
    parser.add_argument(
        "--many", action="store_true", help="every fault, and more flights of five vehicles"
    )
    parser.add_argument(
        "--only",
        default="",
        metavar="TEXT",
        help="only flights with this text in their name (commas: or)",
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="flights at a time")
    args = parser.parse_args(argv)
    before = json.loads(args.against.read_text()) if args.against else {}
    wanted = [
        (name, job) for name, job in jobs(args.many) if any(t in name for t in args.only.split(","))
    ]
    if not wanted:
        parser.error(f"no flight has '{args.only}' in its name")
    names, found = zip(*wanted)
    after = dict(zip(names, on_all_cores(fly, list(found), args.jobs)))
    if args.write:
        args.write.write_text(json.dumps(after, indent=0))
    differing = 0
    for name, told in after.items():
        differs = first_difference(before.get(name), told) if args.against else ""
        differing += bool(differs)
        print(f"{name} | {told['end']}" + (f"  DIFFERS: {differs}" if differs else ""))
    if args.against:
        print(f"{len(after)} flights, {differing} differ")
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main())

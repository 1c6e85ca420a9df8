# SPDX-License-Identifier: Apache-2.0
"""`rosrun fcsv_sim rehearse`: many flights of a mission with faults, and what broke."""

import argparse
import multiprocessing
import os
import sys
import zlib
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np
from tqdm import tqdm

from fcsv_control.mission import plan_check
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.mission import Mission, load_mission
from fcsv_sim.bringup import mission_file
from fcsv_sim.errors import SimulationError
from fcsv_sim.rehearsal.faults import FAULTS
from fcsv_sim.rehearsal.flight import Flight, Result

_NONE = "none"
_HELP = """examples:
  rosrun fcsv_sim rehearse short --flights 1000
  rosrun fcsv_sim rehearse short --faults "radio cut" --seed 17 --flights 1
"""


@dataclass(frozen=True)
class Job:
    """One flight to rehearse."""

    mission: Mission
    vehicles: int
    seed: int
    fault: str


def rehearse(job: Job) -> Result:
    """Fly it. The same job gives the same flight."""
    flight = Flight(job.mission, job.vehicles, job.seed)
    if job.fault == _NONE:
        return flight.run()
    random = np.random.default_rng([job.seed, 23, zlib.crc32(job.fault.encode())])
    return flight.run([FAULTS[job.fault](random)])


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 where nothing broke, 1 where something did, 2 for a wrong argument."""
    args = _parse(argv)
    try:
        jobs = _jobs(args)
    except FcsvError as error:
        print(f"rehearse: {error}", file=sys.stderr)
        return 2
    with multiprocessing.Pool(args.jobs) as pool:
        flights = pool.imap(rehearse, jobs)
        results = list(zip(jobs, tqdm(flights, total=len(jobs), unit="flight", disable=None)))
    print("\n".join(table(results)))
    broken = [(job, r) for job, r in results if r.violations]
    for job, r in broken[: args.show]:
        told = "; ".join(f"{v.at_s:.1f} s: {v.text}" for v in r.violations)
        print(f"{job.fault}, seed {job.seed}: {told} ({r.phase}: {r.detail})")
    if len(broken) > args.show:
        print(f"and {len(broken) - args.show} more flights with violations")
    return int(bool(broken))


def table(results: Sequence[Tuple[Job, Result]]) -> List[str]:
    """Lines of a table: per fault, flights, those with a violation of each kind, and the nearest approach."""
    by_fault: Dict[str, List[Result]] = {}
    for job, result in results:
        by_fault.setdefault(job.fault, []).append(result)
    kinds = ("contact", "downwash", "touch-down", "no end")
    lines = ["| fault | flights | " + " | ".join(kinds) + " | nearest (m) | recorded whole |",
             "|---|---|" + "---|" * (len(kinds) + 2)]  # fmt: skip
    for fault, flown in by_fault.items():
        broken = [sum(any(v.kind == k for v in r.violations) for r in flown) for k in kinds]
        nearest = min(r.nearest_m for r in flown)
        done = sum(r.phase == "DONE" for r in flown)
        lines.append(f"| {fault} | {len(flown)} | " + " | ".join(map(str, broken)) + f" | {nearest:.2f} | {done} |")
    return lines


def _jobs(args) -> List[Job]:
    mission = load_mission(mission_file(args.mission))
    names = {"all": [_NONE, *FAULTS], _NONE: [_NONE]}.get(args.faults, args.faults.split(","))
    for name in names:
        if name not in FAULTS and name != _NONE:
            raise SimulationError(f"--faults: '{name}' is not one of {', '.join(FAULTS)}")
    if args.flights < 1 or not 2 <= args.vehicles <= 20:
        raise SimulationError("--flights must be 1 or more, --vehicles 2 to 20")
    fleet = [f"uav{k + 1}" for k in range(args.vehicles)]
    mission.check_vehicles(fleet)
    plan_check.require_flyable(mission, fleet)
    return [Job(mission, args.vehicles, args.seed + i, names[i % len(names)]) for i in range(args.flights)]


def _parse(argv):
    parser = argparse.ArgumentParser(
        prog="rehearse", description=__doc__, epilog=_HELP, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("mission", help="a mission file, or the name of one in config/missions")
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--faults", default="all", help="all, none, or names with commas: " + ", ".join(FAULTS))
    parser.add_argument("--vehicles", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1, help="of the first flight; the next have the next numbers")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="flights at a time")
    parser.add_argument("--show", type=int, default=10, help="so many flights with violations are listed")
    return parser.parse_args(argv)

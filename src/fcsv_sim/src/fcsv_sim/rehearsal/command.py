# SPDX-License-Identifier: Apache-2.0
"""`rosrun fcsv_sim rehearse`: many flights of a mission, calm or with faults, and what broke."""

import argparse
import gc
import json
import logging
import os
import re
import sys
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Callable, Iterable, Iterator, List, Optional, Sequence, Tuple

from fcsv_control.mission.plans import plan_check
from fcsv_geometry.errors import PlanRefused
from fcsv_geometry.missions.mission import Mission, load_mission
from fcsv_geometry.programs import commands
from fcsv_geometry.programs.live_line import Counter
from fcsv_geometry.programs.quiet import quiet
from fcsv_geometry.programs.writing import require_file
from fcsv_sim.bringup import mission_file
from fcsv_sim.errors import SimulationError
from fcsv_sim.rehearsal import takeover, trace
from fcsv_sim.rehearsal.draws import Draws, from_text
from fcsv_sim.rehearsal.faults import ALL, FAULTS, NONE, PAIRS, faults_of, make_faults
from fcsv_sim.rehearsal.flight import LONGEST_S, Flight, Result
from fcsv_sim.rehearsal.search import Found, Varied, found_in, search
from fcsv_sim.rehearsal.search import table as table_of_worst
from fcsv_sim.rehearsal.tables import feeds_lines, speed_line, table, verdict_line

_HELP = """examples:
  rosrun fcsv_sim rehearse five
  rosrun fcsv_sim rehearse short --faults all --flights 1000
  rosrun fcsv_sim rehearse short --faults "radio cut,tracker gone+abort" --flights 50
  rosrun fcsv_sim rehearse short --seed 17 --trace seed17.png
  rosrun fcsv_sim rehearse short --faults takeover-table
  rosrun fcsv_sim rehearse short --search 500 --log out/search.jsonl
"""
_SAYS_RESTARTS = "fcsv_control"  # logger of links
_TAKEOVER_TABLE = "takeover-table"
_UNFLYABLE = 3  # exit status; fcsv_console knows it


@dataclass(frozen=True)
class Job:
    """One flight to rehearse; ``faults`` as --faults takes them, ``draws`` of them that were
    chosen."""

    mission: Mission
    vehicles: int
    seed: int
    faults: str = NONE
    longest_s: float = LONGEST_S
    draws: Tuple[Draws, ...] = ()

    @property
    def name(self) -> str:
        """Gives the names of its faults."""
        return "+".join(faults_of(self.faults, self.seed)) or NONE


def rehearse(job: Job, watched: Optional[Callable[[Flight], None]] = None) -> Result:
    """Fly it. The same job gives the same flight. ``watched`` is told of the flight before it
    begins."""
    faults = make_faults(faults_of(job.faults, job.seed), job.seed, job.draws)
    mission = job.mission
    for fault in faults:
        mission = fault.adapt(mission)
    flight = Flight(mission, job.vehicles, job.seed)
    if all(fault.changes_nothing for fault in faults):
        flight.expect_calm()
    if watched is not None:
        watched(flight)
    return flight.run(faults, job.longest_s)


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 where nothing broke, 1 where something did, 2 for a wrong argument, 3 where
    the mission cannot be flown."""
    return commands.run(_parser(), argv, _rehearse, writes=("trace", "json"))


def _rehearse(args) -> int:
    try:
        jobs = _jobs(args)
    except PlanRefused as error:
        print(f"rehearse: {error}", file=sys.stderr)
        return _UNFLYABLE
    if args.faults == _TAKEOVER_TABLE:
        return _takeover_table(args, jobs[0].mission)
    if args.search is not None:
        return _search(args, jobs[0])
    if args.trace is not None:
        require_file(args.trace)
        return _trace(jobs[0], args.trace)
    if args.json is not None:
        require_file(args.json)
    print(_what_comes(jobs), file=sys.stderr, flush=True)
    results = list(zip(jobs, on_all_cores(rehearse, jobs, args.jobs)))
    if args.json is not None:
        _write(results, args.json)
    print("\n".join(table([(job.name, r) for job, r in results])))
    print("\n".join(feeds_lines([r for _, r in results])))
    print(speed_line([r for _, r in results]))
    broken = [(job, r) for job, r in results if r.violations]
    for job, r in broken[: args.show]:
        print(_sentence(job, r))
    if len(broken) > args.show:
        print(f"and {len(broken) - args.show} more flights with violations (--show {len(broken)})")
    print(verdict_line([(job.name, r) for job, r in results]))
    return int(bool(broken))


def _search(args, job: Job) -> int:
    """Flights that are varied until vehicles come near to each other."""
    every = args.faults in (NONE, ALL, PAIRS)
    kinds = list(FAULTS) if every else [kind.strip() for kind in args.faults.split(",")]

    def fly(varied: List[Varied]) -> List[Found]:
        jobs = [replace(job, faults=v.faults, draws=v.draws) for v in varied]
        results = on_all_cores(rehearse, jobs, args.jobs)
        return [found_in(r.nearest_m, (v.kind for v in r.violations)) for r in results]

    log = None if args.log is None else Path(args.log)
    found = search(kinds, args.search, args.seed, fly, log)
    broken = sum(bool(how.broke) for how in found.values())
    print("\n".join(table_of_worst(found, args.seed, args.show)))
    print(f"{len(found)} flights, {broken} of them broke")
    return int(broken > 0)


def _what_comes(jobs: Sequence[Job]) -> str:
    """One line before the flights."""
    first = jobs[0]
    faults = "calm" if first.faults == NONE else f"faults: {first.faults}"
    many = f"{len(jobs)} flights" if len(jobs) > 1 else "1 flight"
    return (
        f"rehearsing mission '{first.mission.name}': {many} of {first.vehicles} vehicles, {faults}, "
        f"seeds from {first.seed}"
    )


def _write(results: Sequence[Tuple[Job, Result]], path: str) -> None:
    """Writes the results for programs: a list with an object for each flight."""
    told = [
        {
            "seed": job.seed,
            "faults": job.name,
            "phase": r.phase,
            "detail": r.detail,
            "flown_s": round(r.flown_s, 2),
            "captures": r.captures,
            "wanted": r.wanted,
            "nearest_m": r.nearest_m if isfinite(r.nearest_m) else None,
            "silences_s": r.silences_s,
            "violations": [
                {"kind": v.kind, "at_s": round(v.at_s, 2), "text": v.text} for v in r.violations
            ],
        }
        for job, r in results
    ]
    Path(path).write_text(json.dumps(told, indent=1))


def _sentence(job: Job, r: Result) -> str:
    told = "; ".join(f"{v.at_s:.1f} s: {v.text}" for v in r.violations)
    return f"--faults '{job.name}' --seed {job.seed}: {told} ({r.phase}: {r.detail})"


def on_all_cores(work: Callable, jobs: List, processes: int) -> Iterable:
    """work(job) of each job, in their order, with progress.

    Raises SimulationError where a process is killed.
    """
    if not jobs:
        return []
    with quiet(_SAYS_RESTARTS):
        prepare()
        if work is rehearse and len(jobs) == 1:
            return [_one(jobs[0])]
        if processes == 1 or len(jobs) == 1:
            return list(_counted(map(work, jobs), len(jobs)))
        # a Pool waits for ever for a process that died
        with ProcessPoolExecutor(processes, initializer=prepare) as pool:
            try:
                return list(_counted(pool.map(work, jobs), len(jobs)))
            except BrokenProcessPool:
                raise SimulationError(
                    f"one of {processes} processes was killed, as where memory runs out: ask for fewer (--jobs)"
                ) from None


def _counted(results: Iterable, count: int) -> Iterator:
    """Passes on results, and shows how many came."""
    with closing(Counter(count, "flight", "flights")) as counter:
        for k, result in enumerate(results):
            counter.show(k + 1)
            yield result


def _one(job: Job) -> Result:
    """A single flight, of which recorded configurations are shown."""
    total = len(job.mission.recorded)
    with closing(Counter(total, "configuration", "configurations recorded")) as counter:

        def watched(flight: Flight) -> None:
            flight.recorder = lambda of: counter.show(len(of.control.machine.captures))

        return rehearse(job, watched)


def prepare() -> None:
    """A process that is to rehearse many flights. A link that is restarted says so; a thousand of
    them hide the progress. What is loaded now stays: a flight drops so many messages that the
    collector would look through all of it several times a second.
    """
    logging.getLogger(_SAYS_RESTARTS).setLevel(logging.ERROR)
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


def _trace(job: Job, path: str) -> int:
    traced = trace.Trace()
    result = rehearse(job, traced.watch)
    traced.draw(path, f"{job.name}, seed {job.seed}", result)
    print(
        f"{job.name}, seed {job.seed}: {result.phase} ({result.detail}) after {result.flown_s:.1f} s"
    )
    print("\n".join(f"{at_s:7.1f} s  {text}" for at_s, text in traced.events(result)))
    print(f"wrote {os.path.abspath(path)}")
    return int(bool(result.violations))


def _takeover_table(args, mission: Mission) -> int:
    trials = takeover.trials(mission, args.vehicles, args.seed)
    outcomes = list(on_all_cores(takeover.fly, trials, args.jobs))
    print("\n".join(takeover.table(outcomes)))
    return int(any(o.commands for o in outcomes))


def _jobs(args) -> List[Job]:
    mission = load_mission(mission_file(args.mission))
    if args.vehicles is None:
        args.vehicles = _vehicles_of(mission)
    if args.flights < 1 or not 2 <= args.vehicles <= 20:
        raise SimulationError("--flights must be 1 or more, --vehicles 2 to 20")
    fleet = [f"uav{k + 1}" for k in range(args.vehicles)]
    mission.check_vehicles(fleet)
    plan_check.require_flyable(mission, fleet)
    faults = NONE if args.faults == _TAKEOVER_TABLE else args.faults
    for k in range(faults.count(",") + 1):
        faults_of(faults, k)
    chosen = from_text(args.draws)
    named = [] if "," in faults else faults_of(faults, args.seed)
    if chosen and len(chosen) != len(named):
        raise SimulationError(
            f"--draws: numbers of {len(chosen)}, but --faults names {len(named)}; give both as the "
            "table of --search has them"
        )
    return [
        Job(mission, args.vehicles, args.seed + i, faults, args.longest, chosen)
        for i in range(args.flights)
    ]


def _vehicles_of(mission: Mission) -> int:
    """How many a mission flies: up to the last uavN that it names, two at least."""
    named = [re.fullmatch(r"uav([1-9]\d?)", c.vehicle or "") for c in mission.configurations]
    return max([2, *(int(match[1]) for match in named if match)])


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="rehearse",
        description=__doc__,
        epilog=_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("mission", help="a mission file, or the name of one in config/missions")
    parser.add_argument("--flights", type=int, default=20, help="how many, each with its own seed")
    parser.add_argument(
        "--faults",
        default=NONE,
        help="none: calm flights; all (single faults and pairs in turn), pairs, takeover-table, or names with commas, "
        "of which each may be a pair (A+B): " + ", ".join(FAULTS),
    )
    parser.add_argument(
        "--vehicles", type=int, help="how many, uav1 first; by default those that the mission names"
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="of the first flight; the next have the next numbers"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="flights at a time")
    parser.add_argument(
        "--show", type=int, default=10, help="so many flights with violations are listed"
    )
    parser.add_argument(
        "--longest", type=float, default=LONGEST_S, help="s after which a flight has no end"
    )
    parser.add_argument(
        "--trace",
        nargs="?",
        const="rehearsal.png",
        metavar="FILE.png",
        help="fly the flight of --seed and draw it",
    )
    parser.add_argument(
        "--search",
        type=int,
        metavar="N",
        help="vary one or two of --faults (by default of all) in N flights, so that vehicles come near to each other",
    )
    parser.add_argument(
        "--log",
        metavar="FILE",
        help="of --search: keeps each flight; the same search goes on where it was",
    )
    parser.add_argument("--draws", help="of --faults, as a table of --search tells them")
    parser.add_argument("--json", metavar="FILE", help="write how every flight went, for programs")
    return parser

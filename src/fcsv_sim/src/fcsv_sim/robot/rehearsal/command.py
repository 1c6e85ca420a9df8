# SPDX-License-Identifier: Apache-2.0
"""`rosrun fcsv_sim rehearse_robot`: many drives of a robot through mapped places, with faults, and
what broke."""

import argparse
import csv
import os
import tempfile
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Callable, Iterable, Iterator, List, Optional, Tuple

from tqdm import tqdm

from fcsv_geometry.programs import commands
from fcsv_geometry.programs.quiet import quiet
from fcsv_geometry.programs.writing import require_folder
from fcsv_guidance.robot import Robot, load_robot
from fcsv_sim.bringup import robot_file
from fcsv_sim.errors import SimulationError
from fcsv_sim.robot.gimbals.rehearsal import SMALL, gimbal_drive, small_place
from fcsv_sim.robot.places.mapped import MappedPlace, mapped_place
from fcsv_sim.robot.rehearsal.faults import ALL, FAULTS, RobotFault, faults_of
from fcsv_sim.robot.rehearsal.free_ground import FreeGround, free_ground
from fcsv_sim.robot.rehearsal.one_drive import LONGEST_S, DriveResult, PlaceGuides, RobotDrive
from fcsv_sim.robot.rehearsal.picture import draw_drive
from fcsv_sim.robot.rehearsal.table import ground_table, stations_line, table, verdict_line

_HELP = """examples:
  rosrun fcsv_sim rehearse_robot --mazes 10 --rubble 5 --seed 101 -o out/robot
  rosrun fcsv_sim rehearse_robot --mazes 1 --seed 103 --faults "way closes,runs at it" -o out/robot
  rosrun fcsv_sim rehearse_robot --small 10 --seed 101 -o out/small            # System I: gimbals on the robot
A place is drawn and mapped once (some minutes); OUT keeps its maps for the next time, in drives.csv how each drive
went, and in places.csv how much of each place is called free, and how much of that is not. Exit status 1: a robot
touched something, or arrived or said that there is no safe route where the truth has it otherwise.
"""


MODELLED, DRAWN = "modelled", "drawn"
DRIVES, PLACES = "drives.csv", "places.csv"  # in the folder: a row for each drive, for each place


@dataclass(frozen=True)
class PlaceJob:
    """All drives through one place; ``folder`` keeps maps and pictures."""

    world: str
    seed: int
    robot: Robot
    faults: Tuple[RobotFault, ...]
    folder: Path
    longest_s: float = LONGEST_S
    draw_all: bool = False
    draws_watch: bool = False


@dataclass(frozen=True)
class PlaceReport:
    """Where the vehicles looked from, in words, what the ground of the place is worth, and how each
    drive went."""

    stations: str
    ground: FreeGround
    drives: Tuple[DriveResult, ...]


def rehearse_place(job: PlaceJob) -> PlaceReport:
    """Maps the place, and drives through it with each fault. Each drive has the seed of its place
    and fault."""
    maps = job.folder / "maps" / f"{job.world}-{job.seed}"
    if job.world == SMALL:
        place = small_place(job.seed, job.robot, maps)
    else:
        place = mapped_place(job.world, job.seed, job.robot, maps)
    results, said, guides = [], stations_line(place), PlaceGuides(place, job.robot)
    for fault in job.faults:
        drive, line = _drive(job, place, fault, guides)
        said = line if line and fault == job.faults[0] else said
        result = drive.run(job.longest_s)
        results.append(result)
        if result.broke or job.draw_all:
            draw_drive(place, drive.track, result, job.folder / picture_name(result))
    return PlaceReport(said, free_ground(place, job.robot), tuple(results))


def _drive(
    job: PlaceJob, place: MappedPlace, fault: RobotFault, guides: PlaceGuides
) -> Tuple[RobotDrive, str]:
    """The drive, and where vehicles hold meanwhile where gimbals watch them, in words."""
    seed = 100 * job.seed + list(FAULTS).index(fault.name)
    if job.world != SMALL:
        return RobotDrive(place, job.robot, fault, seed, guides=guides, draws=job.draws_watch), ""
    drive, holds = gimbal_drive(place, job.robot, fault, seed, job.longest_s, guides)
    return drive, "" if holds is None else f"{stations_line(place)}; {holds.in_words()}"


def picture_name(result: DriveResult) -> str:
    """Gives the name of the picture of a drive."""
    return f"{result.world}-{result.seed}-{result.fault.replace(' ', '_')}.png"


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 0 where nothing broke, 1 where something did, 2 for a wrong argument."""
    return commands.run(_parser(), argv, _rehearse)


def _rehearse(args: argparse.Namespace) -> int:
    jobs = _jobs(args)
    jobs[0].folder.mkdir(parents=True, exist_ok=True)
    reports: List[PlaceReport] = []
    with tqdm(total=len(jobs), unit="place", disable=None) as bar, _rows(
        jobs[0].folder / DRIVES, DriveResult, "broke"
    ) as drives, _rows(jobs[0].folder / PLACES, FreeGround) as places:
        for report in _all(jobs, args.jobs):
            reports.append(report)
            drives([*astuple(r), r.broke] for r in report.drives)
            places([astuple(report.ground)])
            bar.update()
            bar.set_postfix_str(f"{sum(bool(r.broke) for p in reports for r in p.drives)} broke")
    results = [result for report in reports for result in report.drives]
    print("\n".join([*(report.stations for report in reports), "", *table(results), ""]))
    print("\n".join([*ground_table([report.ground for report in reports]), ""]))
    for r in (r for r in results if r.broke):
        again = f"--{_OPTIONS[r.world]} 1 --seed {r.seed} --faults '{r.fault}'"
        again += f" --watch {DRAWN}" if jobs[0].draws_watch else ""
        print(f"{again}: {r.broke}; {jobs[0].folder / picture_name(r)}")
    print(verdict_line(results))
    return int(any(r.broke for r in results))


@contextmanager
def _rows(file: Path, row: type, *more: str) -> Iterator[Callable[[Iterable], None]]:
    """A file of rows headed by the fields of ``row`` and ``more``; what adds rows, there at once."""
    with open(file, "w", newline="") as opened:
        writer = csv.writer(opened)

        def add(rows: Iterable) -> None:
            writer.writerows(rows)
            opened.flush()

        add([[*(f.name for f in fields(row)), *more]])
        yield add


def _all(jobs: List[PlaceJob], processes: int) -> Iterator[PlaceReport]:
    """Runs all in order. Raises SimulationError where a process is killed."""
    with quiet("fcsv_stereo"):
        if processes == 1 or len(jobs) == 1:
            yield from map(rehearse_place, jobs)
        else:
            yield from _by_processes(jobs, processes)


def _by_processes(jobs: List[PlaceJob], processes: int) -> Iterator[PlaceReport]:
    with ProcessPoolExecutor(processes) as pool:
        try:
            yield from pool.map(rehearse_place, jobs)
        except BrokenProcessPool:
            raise SimulationError(
                f"one of {processes} processes was killed, as where memory runs out: ask for fewer (--jobs)"
            ) from None


_OPTIONS = {"maze": "mazes", "rubble": "rubble", SMALL: "small"}


def _jobs(args: argparse.Namespace) -> List[PlaceJob]:
    mazes = args.mazes if args.mazes is not None else 0 if args.small else 1
    if (
        min(mazes, args.rubble, args.small) < 0
        or args.jobs < 1
        or mazes + args.rubble < (0 if args.small else 1)
    ):
        raise SimulationError(
            "--mazes, --rubble and --small must be 0 or more, one of them 1 or more; --jobs 1 or more"
        )
    if args.seed < 0:
        raise SimulationError(f"--seed must be 0 or more, got {args.seed}")
    if not 0.0 < args.longest:
        raise SimulationError(f"--longest must be above 0 s, got {args.longest:g}")
    if args.small and mazes + args.rubble:
        raise SimulationError("--small has a robot of its own; rehearse it apart from other places")
    robot = load_robot(args.robot or robot_file("small" if args.small else "rescue"))
    faults = tuple(faults_of(args.faults))
    deaf = [fault.name for fault in faults if args.small and not fault.of_gimbals]
    if args.faults == ALL:
        faults = tuple(fault for fault in faults if fault.name not in deaf)
    elif deaf:
        raise SimulationError(
            f"--faults: '{deaf[0]}' does not befall a robot with gimbals (--small)"
        )
    out = (
        Path(args.out)
        if args.out
        else Path(tempfile.gettempdir()) / f"fcsv_rehearse_robot_{os.getuid()}"
    )
    require_folder(out, 200)
    places = [("maze", args.seed + i) for i in range(mazes)]
    places += [(SMALL, args.seed + i) for i in range(args.small)]
    places += [("rubble", args.seed + i) for i in range(args.rubble)]
    return [
        PlaceJob(world, seed, robot, faults, out, args.longest, args.pictures, args.watch == DRAWN)
        for world, seed in places
    ]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="rehearse_robot",
        description=__doc__,
        epilog=_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--mazes", type=int, help="how many, each with its own seed (default 1)")
    add("--rubble", type=int, default=0, help="how many fields of rubble (default 0)")
    small = "how many small mazes, with gimbals on the robot (System I; default 0)"
    add("--small", type=int, default=0, help=small)
    add(
        "--seed",
        type=int,
        default=1,
        help="of the first maze and the first field; the next have the next numbers",
    )
    add(
        "--faults",
        default=ALL,
        help="all, or names with commas, a drive for each: " + ", ".join(FAULTS),
    )
    add("--robot", metavar="FILE", help="default config/robots/rescue.yaml, small.yaml")
    add(
        "-o",
        "--out",
        metavar="OUT",
        help="keeps maps and pictures; default: a folder in the system's temporary one",
    )
    add(
        "--longest",
        type=float,
        default=LONGEST_S,
        help="s of simulated time after which a drive has no end",
    )
    add(
        "--watch",
        choices=(MODELLED, DRAWN),
        default=MODELLED,
        help="depth of vehicles that watch: of a model of its errors, or of drawn pictures by the matching that "
        "flies (more than a second a view)",
    )
    add("--jobs", type=int, default=1, help="places at a time")
    add("--pictures", action="store_true", help="draw every drive, not only those that broke")
    return parser

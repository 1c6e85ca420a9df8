# SPDX-License-Identifier: Apache-2.0
"""A robot guided over maps by the nodes that guide a real one, on a ROS master of its own; what
came of it."""

import csv
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.ground import tuning
from fcsv_guidance.ground.model import ground_from, stand_probability
from fcsv_guidance.ground.views import read_map
from fcsv_guidance.robot import Robot, load_robot
from fcsv_guidance.route.following import Polyline
from fcsv_sim.machines.machines import Machine, MachineError
from fcsv_sim.robot.above_picture import FromAbove, draw_from_above
from fcsv_sim.robot.placed import place_of
from fcsv_sim.robot.sent import ARRIVED, SentDrive
from fcsv_sim.robot.things import Box
from fcsv_sim.world.footing import Footing
from fcsv_sim.world.town import Town

PICTURE, BAG = "drive.png", "guidance.bag"
_DOCUMENT, _TRUTH, _THINGS = "drive.json", "truth_robot.csv", "things.json"
_LAUNCHES_S = 90.0  # for nodes to come up and to end, beside the drive's own longest time
_FOLLOWS_S = 75.0  # for vehicles that come after
_COMES_S = 150.0  # for the vehicle that reads its tags to come near
_WAITS_S = 45.0  # for a way that closed to open again
_MAP_S = 3600.0  # nothing but the robot moves in the place: its map stays true


@dataclass(frozen=True)
class GuidedDrive:
    """What is driven: ``maps`` are folders that map wrote, none where the live map is driven on;
    ``T_world_home`` 4x4 of their home; ``goal_m`` x, y in the world, the place's own where None.
    Where it is watched a crate closes its way once."""

    maps: Tuple[Path, ...]
    world: str
    seed: int
    robot_file: Path
    T_world_home: np.ndarray
    folder: Path
    goal_m: Optional[Tuple[float, float]] = None
    longest_s: float = 300.0
    sim_dir: Optional[Path] = None  # of vehicles that watch it drive; None: nobody does
    gimbals: bool = False  # robot and guidance are there, by whose gimbals it is located
    follower: str = ""  # the vehicle that follows it and reads its tags; empty: modelled fixes

    @property
    def town(self) -> Town:
        """Raises SimulationError where no robot drives in it."""
        town = Town.generate(self.seed, self.world)
        place_of(town)
        return town


@dataclass(frozen=True)
class GuidedResult:
    """``sent``: how it ended; ``way_m`` (N,2) truly driven, world; ``least_room_m`` beside the
    footprint; ``known_share`` of that way was known as free before the robot set out."""

    sent: SentDrive
    way_m: np.ndarray
    least_room_m: float
    known_share: float

    @property
    def touched(self) -> bool:
        """Whether the footprint touched something."""
        return self.least_room_m < 0.0

    @property
    def is_sound(self) -> bool:
        """Whether it touched nothing, and arrived or said why it did not."""
        return not self.touched and self.sent.says_why

    @property
    def length_m(self) -> float:
        return float(np.hypot(*np.diff(self.way_m, axis=0).T).sum())


def drive_guided(drive: GuidedDrive, machine: Machine, say: Callable[[str], None]) -> GuidedResult:
    """Launches guidance and the simulated robot on ``machine``, which has a master, until the drive
    is over; writes a picture from above into the drive's folder. Raises MachineError where a launch
    does not come up."""
    run = DriveRun(drive, machine)
    while not run.over:
        run.wait(0.5)
    return drive_result(drive, drive.maps, say)


class DriveRun:
    """The nodes of a drive, launched on ``machine``."""

    def __init__(self, drive: GuidedDrive, machine: Machine):
        self._drive = drive
        town, watched = drive.town, drive.sim_dir is not None
        drive.folder.mkdir(parents=True, exist_ok=True)
        T_home_world = transforms.invert(transforms.level(drive.T_world_home))
        goal = transforms.apply(T_home_world, np.array([*(drive.goal_m or town.plan.goal_m), 0.0]))
        home = [*drive.T_world_home[:3, 3], transforms.yaw(drive.T_world_home)]
        ages = {"watch": True, "live": True} if watched else {"oldest_map_s": _MAP_S}
        shown = {"sim_dir": drive.sim_dir, "closes": True, "waits_s": _WAITS_S} if watched else {}
        sent = {"part": "sent", "waits_s": _FOLLOWS_S} if drive.gimbals else {}
        located = {"fixes": "/robot_fix"}
        if drive.follower:
            located = {"robot_tags": drive.follower, "follower": drive.follower}
            sent = {"tag": False, "starts_s": _COMES_S, "waits_s": _FOLLOWS_S}
            shown.pop("waits_s", None)
        self._guidance = (
            None
            if drive.gimbals
            else machine.launch(
                "fcsv_bringup",
                "guidance.launch",
                maps=",".join(f"'{folder}'" for folder in drive.maps),
                robot=drive.robot_file,
                drive="cmd_vel",
                fresh=True,
                **located,
                **ages,
            )
        )
        self._simulated = machine.launch(
            "fcsv_bringup",
            "sim_robot.launch",
            robot=drive.robot_file,
            world=drive.world,
            seed=drive.seed,
            home=_listed(home),
            goal=_listed(goal[:2]),
            folder=drive.folder,
            longest_s=drive.longest_s,
            **shown,
            **sent,
        )
        comes_s = _COMES_S if drive.follower else 0.0
        self._over_s = time.monotonic() + comes_s + drive.longest_s + _LAUNCHES_S

    def wait(self, most_s: float) -> None:
        """Waits for the drive's end."""
        self._simulated.wait(most_s)

    @property
    def over(self) -> bool:
        """Whether the drive is over. Raises MachineError where it has no end."""
        if self._simulated.returncode is None:
            guidance = self._guidance or self._simulated
            if guidance.returncode is not None or time.monotonic() > self._over_s:
                raise MachineError(
                    f"guidance did not run to its end: {guidance.log}\n{guidance.tail()}"
                )
            return False
        if not (self._drive.folder / _DOCUMENT).is_file():
            log, tail = self._simulated.log, self._simulated.tail()
            raise MachineError(f"the drive has no end: {log}\n{tail}")
        return True


def drive_result(
    drive: GuidedDrive, maps: Sequence[Path], say: Callable[[str], None]
) -> GuidedResult:
    """What came of a drive that is over, with its picture from above over folders ``maps``."""
    known = KnownPlace(drive, maps, load_robot(drive.robot_file))
    result = _result(drive, known)
    _draw(drive, known, result)
    say(f"the robot's drive from above: {drive.folder / PICTURE}")
    return result


def in_words(result: GuidedResult) -> List[str]:
    """A table of the drive, and why it ended."""
    sent = result.sent
    rows = [
        ("arrived", "yes" if sent.ended == ARRIVED else f"no: {sent.ended}"),
        ("contacts", str(int(result.touched))),
        ("least clearance (m)", f"{result.least_room_m:.2f}"),
        ("way driven (m)", f"{result.length_m:.1f}"),
        ("time (s)", f"{sent.drove_s:.0f}"),
        ("of the way, known free beforehand", f"{result.known_share:.0%}"),
        ("routes planned", str(len(sent.routes))),
    ]
    closed = sent.way_closed
    if closed is not None:
        answer = "none" if closed.answer_s is None else f"{closed.answer_s:.2f} s"
        rows += [
            ("a way closed, since then", closed.in_words()),
            ("from its picture to the answer", answer),
        ]
    wide = max(len(name) for name, _ in rows)
    return [f"{name:<{wide}}  {value}" for name, value in rows] + [f"guidance: {sent.text}"]


def _listed(values: Sequence[float]) -> str:
    return ",".join(f"{v:.6f}" for v in values)


def _result(drive: GuidedDrive, known: "KnownPlace") -> GuidedResult:
    sent = SentDrive(**json.loads((drive.folder / _DOCUMENT).read_text()))
    with open(drive.folder / _TRUTH, newline="") as file:
        rows = [list(map(float, row)) for row in list(csv.reader(file))[1:] if len(row) == 5]
    truth = np.array(rows).reshape(-1, 5)
    way = truth[truth[:, 0] >= sent.began_s, 1:3]
    room_m = float(truth[:, 4].min()) if len(truth) else float("nan")
    return GuidedResult(sent, way, room_m, known.share(way))


class KnownPlace:
    """What the maps of a drive show beforehand: ``stands`` (rows, columns) of ``grid``, in home."""

    def __init__(self, drive: GuidedDrive, maps: Sequence[Path], robot: Robot):
        self.robot = robot
        ground = ground_from([read_map(folder) for folder in maps])
        self.grid, self.stands = ground.grid, stand_probability(ground, robot)
        self._T_world_home = transforms.level(drive.T_world_home)

    def in_home(self, points_m) -> np.ndarray:
        """(N,2) of places (N,2) in the world."""
        flat = np.pad(np.asarray(points_m, float).reshape(-1, 2), ((0, 0), (0, 1)))
        return transforms.apply(transforms.invert(self._T_world_home), flat)[:, :2]

    def in_world(self) -> np.ndarray:
        """(rows, columns, 2): middles of the cells."""
        xy = self.grid.middle_of(*np.indices(self.grid.shape))
        return transforms.apply(self._T_world_home, np.pad(xy, ((0, 0), (0, 0), (0, 1))))[..., :2]

    def boxes_in_home(self, file: Path) -> List[Box]:
        """What came into the way, of a file that the simulated robot wrote; none without one."""
        if not file.is_file():
            return []
        boxes = [Box(**dict(b, half_m=tuple(b["half_m"]))) for b in json.loads(file.read_text())]
        yaw_rad = transforms.yaw(self._T_world_home)
        at = [self.in_home([(b.x_m, b.y_m)])[0] for b in boxes]
        return [
            replace(b, x_m=float(x), y_m=float(y), yaw_rad=b.yaw_rad - yaw_rad)
            for b, (x, y) in zip(boxes, at)
        ]

    def share(self, way_m: np.ndarray) -> float:
        """Share of a way (N,2), world, that is known as free; NaN where nothing was driven."""
        if len(way_m) < 2:
            return float("nan")
        line = Polyline.of(self.in_home(way_m))
        along = line.at(np.arange(0.0, max(line.length_m, 0.1), 0.1))
        row, column, inside = self.grid.cells_of(*along.T)
        return float((inside & (self.stands[row, column] >= tuning.FREE_P)).mean())


def _draw(drive: GuidedDrive, known: KnownPlace, result: GuidedResult) -> None:
    town = drive.town
    clear, world = Footing.of(town.plan).clearance(known.robot), known.in_world()
    way, sent = known.in_home(result.way_m), result.sent
    x0, x1, y0, y1 = town.plan.area_m
    corners = known.in_home([(x0, y0), (x0, y1), (x1, y0), (x1, y1)])
    (low_x, low_y), (high_x, high_y) = corners.min(0), corners.max(0)
    shown = FromAbove(
        known.grid,
        known.stands,
        clear.stopped(world[..., 0], world[..., 1], known.grid.cell_m),
        [np.array(route) for route in sent.routes],
        way,
        known.in_home(town.plan.start_m)[0],
        sent.goal_m,
        known.boxes_in_home(drive.folder / _THINGS),
        contact_m=way[-1] if result.touched and len(way) else None,
        within_m=(low_x, high_x, low_y, high_y),
    )
    title = f"{drive.world} {drive.seed}: {sent.ended} after {sent.drove_s:.0f} s"
    draw_from_above(shown, title, drive.folder / PICTURE)

# SPDX-License-Identifier: Apache-2.0
"""Shows things that come into drawn places to cameras that watch, matches their pictures as in
flight, and counts what is closed; the table of docs/lab/guidance.md.

python tools/bench_watch.py [--world low_maze] [--seeds 51 52] [--heights 10 5] [--things 3]
"""

import argparse
import sys
from dataclasses import dataclass
from typing import Dict, Iterator, List, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_guidance.errors import GroundError
from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.known import GroundSeen, KnownGround, watch_seen
from fcsv_guidance.ground.model import ground_from
from fcsv_guidance.ground.tuning import FREE_P
from fcsv_guidance.robot import Robot, load_robot
from fcsv_sim.render.bodies import BoxedThing
from fcsv_sim.robot.drawn_watch import DrawnWatch
from fcsv_sim.robot.places.looking import first_look
from fcsv_sim.robot.places.survey import survey
from fcsv_sim.robot.things import Box
from fcsv_sim.world.footing import Footing
from fcsv_sim.world.movers import CRATE, ball_radius_m, placed_boxes
from fcsv_sim.world.town import Town
from harness import ROOT, show

SIZES = {"crate": 1.0, "half as large": 0.5}  # of 0.6 x 2.0 x 1.1 m
BEFORE, DURING, AFTER = 3, 4, 6  # views


@dataclass(frozen=True)
class Told:
    """Of one thing: views until its ground was closed and until it was free again (None: never),
    and the shares of free cells that were lost elsewhere, a view each."""

    size: str
    far_m: float
    closed_by: Optional[int]
    views_closed: int
    freed_by: Optional[int]
    lost: Tuple[float, ...]


def thing_of(box: Box, scale: float) -> BoxedThing:
    """The crate of the simulation at a box's place."""
    boxes = placed_boxes()[CRATE].copy()
    boxes[:, :6] *= scale
    T_world_thing = transforms.from_xyz_yaw([box.x_m, box.y_m, box.z_m], box.yaw_rad)
    return BoxedThing(boxes, T_world_thing, ball_radius_m(boxes))


def told_of(place: "WatchedPlace", box: Box, size: str, cameras: DrawnWatch) -> Told:
    """What the views before, with and after the thing do to the ground that is known."""
    known, free = place.known(), place.free
    xy = place.grid.middle_of(*np.indices(place.grid.shape))
    gap = box.gap_m(xy[..., 0], xy[..., 1])
    on_it, around = free & (gap < 0.0), gap < place.robot.radius_m + 1.0
    lost, closed = [], []
    for number in range(BEFORE + DURING + AFTER):
        is_there = BEFORE <= number < BEFORE + DURING
        view = cameras.look(100.0 + number, [thing_of(box, SIZES[size])] if is_there else [])
        if view is not None:
            try:
                known.receive(watch_seen(view, [place.view], place.grid), None)
            except GroundError:
                pass
        now = known.stands >= FREE_P
        elsewhere = free & ~(around if number >= BEFORE else np.zeros_like(around))
        lost.append(float((elsewhere & ~now).sum() / elsewhere.sum()))
        closed.append(bool((on_it & ~now).sum() >= 0.5 * on_it.sum()))
    during, after = closed[BEFORE : BEFORE + DURING], closed[BEFORE + DURING :]
    closed_by = during.index(True) + 1 if True in during else None
    freed_by = after.index(False) + 1 if False in after else None
    far_m = float(np.hypot(*(np.array([box.x_m, box.y_m]) - place.view.T_home_cam[:2, 3])))
    return Told(size, far_m, closed_by, sum(during), freed_by, tuple(lost))


class WatchedPlace:
    """A drawn place with the map of the station that watches it."""

    def __init__(self, world: str, seed: int, height_m: float, robot: Robot):
        self.town, self.robot = Town.generate(seed, world), robot
        clear = Footing.of(self.town.plan).clearance(robot)
        self.station, _ = first_look(self.town, clear, height_m)
        (self.view,) = survey(self.town, [self.station], seed)
        self._ground = ground_from([self.view])
        self.grid: Grid = self._ground.grid
        self.free = self.known().stands >= FREE_P

    def known(self) -> KnownGround:
        """What the map alone shows."""
        known = KnownGround(self.robot)
        known.receive(GroundSeen(0.0, "map", self._ground), None)
        return known

    def spots(self, count: int, nearer_m: float, random: np.random.Generator) -> np.ndarray:
        """(N,2) free places nearer than that to the camera."""
        xy = self.grid.middle_of(*np.nonzero(self.free))
        far = np.hypot(*(xy - self.view.T_home_cam[:2, 3]).T)
        plan = self.town.plan
        x0, x1, y0, y1 = plan.area_m
        inside = (xy[:, 0] > x0) & (xy[:, 0] < x1) & (xy[:, 1] > y0) & (xy[:, 1] < y1)
        xy = xy[inside & (far < nearer_m)]
        return xy[random.permutation(len(xy))[:count]]


_TITLES = (
    "place",
    "thing",
    "m away",
    "things",
    "closed by view 1 / 2 / later / never",
    "of the views with it: closed",
    "free again after views (median, worst)",
    "free cells lost elsewhere, a view: median, worst",
)


def rows_of(told: Dict[str, List[Told]]) -> Iterator[Tuple]:
    """A row for each place and size of thing."""
    for place, each in told.items():
        for size in SIZES:
            of = [t for t in each if t.size == size]
            if not of:
                continue
            by = [t.closed_by or 99 for t in of]
            counts = [sum(b == 1 for b in by), sum(b == 2 for b in by)]
            counts += [sum(2 < b < 99 for b in by), sum(b == 99 for b in by)]
            freed = sorted(AFTER + 1 if t.freed_by is None else t.freed_by for t in of)
            lost = np.concatenate([t.lost for t in of])
            share = sum(t.views_closed for t in of) / (DURING * len(of))
            yield (
                place,
                size,
                f"{min(t.far_m for t in of):.0f} to {max(t.far_m for t in of):.0f}",
                len(of),
                " / ".join(map(str, counts)),
                f"{share:.0%}",
                f"{freed[len(freed) // 2]}, {freed[-1]}",
                f"{np.median(lost):.2%}, {lost.max():.2%}",
            )


def main() -> int:
    """Exit status 1 where a crate of full size was never closed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--world", default="low_maze")
    parser.add_argument("--seeds", type=int, nargs="+", default=[51, 52])
    parser.add_argument("--heights", type=float, nargs="+", default=[10.0, 5.0])
    parser.add_argument("--things", type=int, default=3)
    parser.add_argument("--nearer", type=float, default=45.0)
    parser.add_argument("--robot", default=ROOT / "config" / "robots" / "rescue.yaml")
    args = parser.parse_args()
    robot, told = load_robot(args.robot), {}
    for seed in args.seeds:
        for height_m in args.heights:
            place = WatchedPlace(args.world, seed, height_m, robot)
            random = np.random.default_rng([seed, 43])
            name = f"{args.world} {seed}, from {height_m:g} m"
            told[name] = []
            cameras = DrawnWatch(place.town, place.station, 1000 * seed)
            for number, (x, y) in enumerate(place.spots(args.things, args.nearer, random)):
                size = list(SIZES)[number % len(SIZES)]
                half = tuple(SIZES[size] * np.array([0.3, 1.0]))
                z = float(place.town.plan.drawn_height(np.array(x), np.array(y)))
                yaw = float(random.uniform(-np.pi, np.pi))
                box = Box(float(x), float(y), z, half, 1.1 * SIZES[size], yaw)
                told[name].append(told_of(place, box, size, cameras))
                print(name, told[name][-1], file=sys.stderr, flush=True)
    show(_TITLES, rows_of(told))
    crates = [t for each in told.values() for t in each if t.size == "crate"]
    return int(any(t.closed_by is None for t in crates))


if __name__ == "__main__":
    sys.exit(main())

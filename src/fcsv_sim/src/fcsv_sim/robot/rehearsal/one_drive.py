# SPDX-License-Identifier: Apache-2.0
"""One drive of a robot through a mapped place in simulated time: the product's nodes, the true
wheels, one fault."""

import time
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_guidance.grid import Grid
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.messages import Goal, StopRobot
from fcsv_guidance.place.tracker import PlaceFix
from fcsv_guidance.robot import Robot
from fcsv_guidance.route.ground_server import GroundRules
from fcsv_guidance.route.planning import plan_over
from fcsv_guidance.route.search import Route
from fcsv_sim.robot.contact import TrueGround
from fcsv_sim.robot.drawn_watch import DrawnWatch, drawn_box
from fcsv_sim.robot.drive import SimulatedRobot, WheelFlaws
from fcsv_sim.robot.places.mapped import PLANNED_SIGMA_M, MappedPlace
from fcsv_sim.robot.rehearsal.faults import NONE, FixFault, RobotFault
from fcsv_sim.robot.rehearsal.guidance_bus import (
    ARRIVED,
    DRIVING,
    NO_ROUTE,
    WAITING,
    Guidance,
    GuidanceBus,
)
from fcsv_sim.robot.rehearsal.locator import RADIO_S, STEP_S, RobotLocator, TagFixes, every
from fcsv_sim.robot.things import Box, Closer, Runner, Watcher

LONGEST_S = 400.0
LOOK_EVERY_S, LOOK_DELAY_S = 1.0, 0.5  # from picture to ground
MOVES_MPS = 0.05  # a robot that is hit while it drives no faster stands
# of standing without a route; where it waits for its place: fixes that tell its yaw come seldom
_GIVES_UP_S = {NO_ROUTE: 15.0, WAITING: 40.0}
_OPERATOR_LOOKS_S, _BESIDE_M = 5.0, 1.0
ARRIVES, SAYS_NONE, EITHER = "arrives", "says none", "either"


@dataclass(frozen=True)
class DriveResult:
    """How a drive went. ``expected`` by the truth: ARRIVES, SAYS_NONE or EITHER. ``contact``: empty
    where the footprint touched nothing. ``reaction_s``: simulated time from the first picture that
    shows the thing in the way to another route or to none; ``slowest_s``: processor time of the
    nodes' slowest step. ``honest``: share of the time in which the place was within two of its
    sigma."""

    world: str
    seed: int
    fault: str
    ended: str
    expected: str
    contact: str
    befell: bool
    said_none: bool
    least_room_m: float
    time_s: float
    way_m: float
    place_rms_m: float
    honest: float
    reaction_s: Optional[float]
    slowest_s: float
    text: str

    @property
    def broke(self) -> str:
        """What must never be; empty where nothing was."""
        if self.contact:
            return self.contact
        if self.expected == SAYS_NONE and self.ended == ARRIVED:
            return "arrived where the truth has no way"
        if self.expected == SAYS_NONE and not self.said_none:
            return f"did not say that there is no safe route ({self.ended}: {self.text})"
        return ""


@dataclass
class DriveRecord:
    """Holds, for a picture: the true way (N,2), routes (N,2) that were planned, boxes, where the
    contact was, and what was free."""

    way: List[Tuple[float, float]] = field(default_factory=list)
    routes: List[np.ndarray] = field(default_factory=list)
    boxes: List[Box] = field(default_factory=list)
    contact: Optional[Tuple[float, float]] = None
    stands: Optional[np.ndarray] = None
    grid: Optional[Grid] = None


class PlaceGuides:
    """What guides ``robot`` through ``place``, whose maps are laid once: each drive gets a copy."""

    def __init__(self, place: MappedPlace, robot: Robot):
        self._place, self._robot = place, robot
        self._laid: Dict[bool, GuidanceBus] = {}

    def of(self, fault: RobotFault) -> GuidanceBus:
        """One of its own for a drive with a fault."""
        if fault.watched not in self._laid:
            place = self._place
            cell_m = next(g.grid.cell_m for g in place.grounds if g is not None)
            area_m = place.town.plan.area_m
            rules = GroundRules(cell_m=cell_m, area_m=area_m, watched=fault.watched)
            maps = [v for v in place.views if v is not None]
            self._laid[fault.watched] = GuidanceBus(self._robot, rules, maps)
        return deepcopy(self._laid[fault.watched])


class RobotDrive:
    """Drives from the place's start to its goal. The same place, fault and seed give the same
    drive. ``places``: where it gets its place from, a vehicle that reads its tag where None;
    ``yaw_rad``: how it stands, anyhow where None; ``guides``: what guides it, of this place;
    ``draws``: vehicles that watch do so with drawn pictures and the matching that flies."""

    def __init__(
        self,
        place: MappedPlace,
        robot: Robot,
        fault: RobotFault,
        seed: int,
        places: Optional[RobotLocator] = None,
        yaw_rad: Optional[float] = None,
        guides: Optional[PlaceGuides] = None,
        draws: bool = False,
    ):
        self._draws = draws
        self._place, self._robot, self._fault, self._seed = place, robot, fault, seed
        self._random = np.random.default_rng([seed, 24])
        plan = place.town.plan
        self._goal = Goal(*map(float, plan.goal_m))
        self._true = TrueGround(place.footing, place.clear)
        anyhow_rad = self._random.uniform(-np.pi, np.pi)
        at = (*plan.start_m, anyhow_rad if yaw_rad is None else yaw_rad)
        flaws = WheelFlaws.drawn(self._random)
        self.machine = SimulatedRobot(robot, at, flaws, seed, self._spins)
        self._places: RobotLocator = TagFixes(seed) if places is None else places
        self._guide = (guides or PlaceGuides(place, robot)).of(fault)
        self.track = DriveRecord()
        self._post: List[tuple] = []  # (when it arrives, what)
        self._thing, self._watcher, self._watched_by = None, None, 0
        self._share = self._random.uniform(0.2, 0.6)
        self._begins_s, self._ends_s = np.inf, np.inf
        self._fixes: Optional[FixFault] = None
        self._shown_s, self._reacted_s = None, None
        self._first_m, self._way_m, self._room_m = None, 0.0, np.inf
        self._asked_s = 0.0  # since then the operator looks
        self._errors, self._within = [], []
        self._slowest_s, self._said_none, self._blocked, self._held = 0.0, False, None, False

    def run(self, longest_s: float = LONGEST_S) -> DriveResult:
        """Drives to the goal, to a contact, or to where nothing more can come."""
        self._post.append((self._places.settle_s, self._goal))
        self._prepare_watch()
        now_s, stood_s, contact, guidance, ended = 0.0, 0.0, "", None, "time"
        while now_s < longest_s:
            now_s = round(now_s + STEP_S, 6)
            self._move(now_s)
            contact = self._touched(now_s)
            self._sense(now_s)
            guidance = self._guided(now_s)
            drives = guidance.state == DRIVING or not self.machine.stands or self._held
            waits = guidance.asks or not self._errors  # for the operator; for its first place
            stood_s = 0.0 if drives or waits else stood_s + STEP_S
            self._operate(now_s, guidance)
            if contact:
                ended = "contact"
                break
            if guidance.state == ARRIVED and self.machine.stands:
                ended = ARRIVED
                break
            over = (
                self._begins_s == np.inf
                or now_s > min(self._ends_s, self._begins_s + 60.0) + _GIVES_UP_S[NO_ROUTE]
            )
            if over and stood_s > _GIVES_UP_S.get(guidance.state, np.inf):
                ended = guidance.state
                break
        known = self._guide.server.known
        self.track.stands, self.track.grid = known.stands, known.grid
        return self._result(ended, contact, now_s, guidance)

    def _operate(self, now_s: float, guidance: Guidance) -> None:
        """An operator looks where he is asked to; where nobody stands beside the robot, he gives
        the goal again."""
        box = None if self._thing is None else self._thing.box
        off_m = np.inf if box is None else float(box.gap_m(self.machine.x_m, self.machine.y_m))
        if not guidance.asks or off_m - self._robot.radius_m < _BESIDE_M:
            self._asked_s = now_s
        elif now_s - self._asked_s > _OPERATOR_LOOKS_S:
            self._post.append((now_s, self._goal))
            self._asked_s = now_s

    def _result(self, ended: str, contact: str, now_s: float, guidance: Guidance) -> DriveResult:
        errors = np.array(self._errors or [np.nan])
        far_m = float(
            np.hypot(self.machine.x_m - self._goal.x_m, self.machine.y_m - self._goal.y_m)
        )
        if ended == ARRIVED and far_m > 1.0:
            ended = f"arrived {far_m:.1f} m beside"
        reaction_s = None if self._reacted_s is None else self._reacted_s - self._shown_s
        return DriveResult(
            self._place.world,
            self._place.town.seed,
            self._fault.name,
            ended,
            self._expected(),
            contact,
            np.isfinite(self._begins_s),
            self._said_none,
            self._room_m,
            now_s,
            self._way_m,
            float(np.sqrt(np.mean(errors**2))),
            float(np.mean(self._within or [np.nan])),
            reaction_s,
            self._slowest_s,
            guidance.text,
        )

    def _expected(self) -> str:
        place, plan = self._place, self._place.town.plan
        margin_m = place.looked.way_margin_m
        if not place.clear.leads(plan.start_m, plan.goal_m):
            return SAYS_NONE
        if self._fault.name == "pose lost for good" and np.isfinite(self._begins_s):
            return EITHER  # by its wheels it may come as far as it is allowed to
        if self._blocked is None:
            return (
                ARRIVES
                if place.looked.leads(place.clear, plan.start_m, plan.goal_m, margin_m)
                else EITHER
            )
        at, box = self._blocked
        xy = place.looked.grid.middle_of(*np.indices(place.looked.grid.shape))
        closed = box.gap_m(xy[..., 0], xy[..., 1]) < self._robot.radius_m + margin_m
        leads = place.looked.leads(place.clear, at, plan.goal_m, margin_m, closed)
        return ARRIVES if leads else EITHER

    def _spins(self, now_s: float, x_m: float, y_m: float) -> bool:
        return self._fault.name == "wheels slip" and self._begins_s <= now_s < self._ends_s

    def _during(self, name: str, now_s: float) -> bool:
        return self._fault.name == name and self._begins_s <= now_s < self._ends_s

    def _move(self, now_s: float) -> None:
        before = self.machine.x_m, self.machine.y_m
        self.machine.step(now_s)
        at = self.machine.x_m, self.machine.y_m
        self._way_m += float(np.hypot(at[0] - before[0], at[1] - before[1]))
        self.track.way.append(at)
        if self._thing is not None:
            self._thing.step(now_s, *at, self._robot.radius_m)

    def _touched(self, now_s: float) -> str:
        at = self.machine.x_m, self.machine.y_m
        room = self._true.room_m(*at)
        self._room_m = min(self._room_m, room)
        box = None if self._thing is None else self._thing.box
        if box is not None:
            gap = float(box.gap_m(*at)) - self._robot.radius_m
            if gap <= 0.0 and not self.machine.stands:
                self.track.contact = at
                return f"touches what came into its way after {now_s:.1f} s"
            if (
                isinstance(self._thing, Runner)
                and self._thing.halted_s == now_s
                and gap <= Runner.SHY_M + 0.1
            ):
                if abs(self.machine.speed_mps) > MOVES_MPS:
                    self.track.contact = at
                    return f"still drives as the walker reaches it after {now_s:.1f} s"
        if room < 0.0:
            self.track.contact = at
            return (
                f"touches the ground's obstacle at ({at[0]:.1f}, {at[1]:.1f}) m after {now_s:.1f} s"
            )
        return ""

    def _sense(self, now_s: float) -> None:
        """What the robot, the vehicles and the watch send; it arrives later."""
        machine, cut = self.machine, self._during("radio cut", now_s)
        if not cut:
            self._post.append((now_s + RADIO_S, machine.odometry()))
        for arrival_s, message in self._places.sense(now_s, machine):
            if isinstance(message, PlaceFix) and self._fixes is not None:
                message = self._fixes.passed(message)
            if message is not None:
                self._post.append((arrival_s, message))
        if (
            self._watcher is not None
            and every(now_s, LOOK_EVERY_S)
            and not self._during("map stale", now_s)
        ):
            view = self._seen_now(now_s)
            if view is not None:
                self._post.append((now_s + LOOK_DELAY_S, view))
        if self._during("stop all", now_s - STEP_S) and not self._during("stop all", now_s):
            self._post.append((now_s, self._goal))

    def _guided(self, now_s: float) -> Guidance:
        arrived = [what for at_s, what in self._post if at_s <= now_s]
        self._post = [item for item in self._post if item[0] > now_s]
        began = time.process_time()
        for what in arrived:
            to = self._guide if isinstance(what, (DepthView, Goal, StopRobot)) else self._places
            to.receive(now_s, what)
        state = self._places.step(now_s)
        self._held = bool(state.hold)
        self._guide.receive(now_s, state)
        guidance = self._guide.step(now_s)
        self._slowest_s = max(self._slowest_s, time.process_time() - began)
        if state.place is not None and now_s - state.place.stamp_s < 2 * RADIO_S:
            off = float(
                np.hypot(state.place.x_m - self.machine.x_m, state.place.y_m - self.machine.y_m)
            )
            self._errors.append(off)
            self._within.append(off <= 2 * state.place.sigma_m + RADIO_S * self._robot.speed_mps)
        if not self._during("radio cut", now_s):
            self.machine.command(now_s, guidance.command)
        self._note(now_s, guidance)
        return guidance

    def _note(self, now_s: float, guidance: Guidance) -> None:
        self._said_none = self._said_none or guidance.state == NO_ROUTE
        route = guidance.route_m
        new = route is not None and (not self.track.routes or route is not self.track.routes[-1])
        if new:
            self.track.routes.append(route)
            self._first_m = self._first_m or float(np.hypot(*np.diff(route, axis=0).T).sum())
        if (
            self._shown_s is not None
            and self._reacted_s is None
            and (new or guidance.state == NO_ROUTE)
        ):
            self._reacted_s = now_s
        waits = self._begins_s == np.inf and self._fault.name != NONE and self._first_m is not None
        if waits and self._way_m > self._share * self._first_m and guidance.state == DRIVING:
            self._begin(now_s, route)

    def _begin(self, now_s: float, route: np.ndarray) -> None:
        """The fault befalls the drive."""
        fault, random = self._fault, self._random
        lasts_s = (
            fault.lasts_s
            if not np.isfinite(fault.lasts_s)
            else fault.lasts_s * random.uniform(0.4, 1.0)
        )
        if fault.name in ("way closes", "runs at it") and not self._enter(now_s, route):
            return  # nothing of the way ahead is watched now; perhaps later
        self._begins_s, self._ends_s = now_s, now_s + lasts_s
        self._fixes = FixFault(fault, now_s, lasts_s, random)
        if fault.name == "stop all":
            self._post.append((now_s, StopRobot()))

    def _enter(self, now_s: float, route: np.ndarray) -> bool:
        """Something comes into the way, where the watch sees it; whether it does."""
        ahead = _ahead_of(route, (self.machine.x_m, self.machine.y_m))
        run = np.arange(len(ahead)) * 0.1
        looked = self._place.looked
        row, column, inside = looked.grid.cells_of(*ahead.T)
        seen = inside & looked.sights[self._watched_by][row, column]
        random = self._random
        if self._fault.name == "way closes":
            spots = np.flatnonzero(seen & (run > 4.5) & (run < 7.5) & (run < run[-1] - 3.0))
            if not len(spots):
                return False
            k = int(spots[random.integers(len(spots))])
            dx, dy = ahead[min(k + 3, len(ahead) - 1)] - ahead[k - 3]
            x, y = map(float, ahead[k])
            half = (random.uniform(0.2, 0.4), random.uniform(0.5, 2.2))
            z = float(self._place.town.plan.drawn_height(np.array(x), np.array(y)))
            box = Box(x, y, z, half, random.uniform(0.5, 1.5), float(np.arctan2(dy, dx)))
            stays_s = np.inf if random.random() < 0.5 else random.uniform(10.0, 30.0)
            self._thing = Closer(box, now_s, now_s + stays_s)
            if not np.isfinite(stays_s):
                self._blocked = ((self.machine.x_m, self.machine.y_m), box)
        else:
            far = min(len(seen) - 1, 85)
            if far < 70 or not seen[10:far].all():
                return False
            z = float(self._place.town.plan.drawn_height(*np.array(ahead[40])[:, None])[0])
            self._thing = Runner(ahead[far::-1], random.uniform(0.6, 1.5), now_s, z)
        return True

    def _prepare_watch(self) -> None:
        """The watch is held at the station that sees most of the first route; without a route at
        the first one."""
        if not self._fault.watched:
            return
        looked, plan = self._place.looked, self._place.town.plan
        ways = looked.sights.sum((1, 2))
        known = self._guide.server.known
        route = plan_over(known.grid, known.stands, plan.start_m, plan.goal_m, PLANNED_SIGMA_M)
        if isinstance(route, Route):
            ahead = _ahead_of(route.points_home_m, plan.start_m)
            row, column, inside = looked.grid.cells_of(*ahead.T)
            ways = (looked.sights[:, row, column] & inside).sum(1)
        has = np.array([ground is not None for ground in self._place.grounds])
        self._watched_by = int(np.argmax(np.where(has, ways, -1)))
        town, station = self._place.town, looked.stations[self._watched_by]
        if self._draws:
            self._watcher = DrawnWatch(town, station, self._seed)
        else:
            self._watcher = Watcher(town, self._place.views[self._watched_by], self._seed)

    def _seen_now(self, now_s: float) -> Optional[DepthView]:
        """What the watch shows; None where nothing is matched."""
        box = None if self._thing is None else self._thing.box
        machine = self.machine
        own = 0.7 * self._robot.radius_m
        z = float(self._true.T_world_robot(machine.x_m, machine.y_m, 0.0)[2, 3])
        itself = Box(machine.x_m, machine.y_m, z, (own, own), self._robot.height_m, machine.yaw_rad)
        if box is not None:
            self.track.boxes.append(box)
            self._shown_s = now_s if self._shown_s is None else self._shown_s
        boxes = [itself] if box is None else [box, itself]
        shown = [drawn_box(each) for each in boxes] if self._draws else boxes
        view = self._watcher.look(now_s, shown)
        return None if view is None else replace(view, name="watch")


def _ahead_of(points: np.ndarray, at_m) -> np.ndarray:
    """(N,2): the route of ``points`` (M,2) from its point nearest to a place on, a point every
    0.1 m."""
    run = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    along = np.arange(0.0, run[-1], 0.1)
    fine = np.column_stack([np.interp(along, run, points[:, k]) for k in (0, 1)])
    return fine[int(np.argmin(np.hypot(*(fine - at_m).T))) :]

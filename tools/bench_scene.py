# SPDX-License-Identifier: Apache-2.0
"""Is the scene witness of rehearsals as hard as that on pictures? The table goes into docs/lab/rehearsals.md.

python tools/bench_scene.py [--calm 4] [--drifts 4] [--worlds street,village,field,plain] [--width 640] [--jobs 1]

Flies rehearsals of `short` and looks again at what each vehicle's camera saw: with the points that rehearsals use
(SimulatedScene), and with pictures of a world, drawn from where the vehicle truly was, in which points are followed as
on board (SceneWatch). The drawn pictures have the vibration of the airframe and stamps that are late by 8 ms (standard
deviation), no rolling shutter. Both are held against the same poses by the same rules (SceneCheckRules). The last rows
are other witnesses by the drawn points; their bound is 1.15 times the worst of the flights without a fault.
"""

import argparse
import dataclasses
import itertools
import logging
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple

import cv2
import numpy as np
from tqdm import tqdm

from fcsv_control.flight.scene_check import SceneCheck, SceneCheckRules
from fcsv_geometry import rotations, transforms
from fcsv_geometry.mission import load_mission
from fcsv_sim.bringup import mission_file
from fcsv_sim.rehearsal.command import Job, prepare, rehearse
from fcsv_sim.rehearsal.faults import NONE
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle
from fcsv_sim.render.bodies import Body
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.vehicles.dynamics import Airframe
from fcsv_sim.world.town import WORLDS, Town
from fcsv_tracking import scene_motion
from fcsv_tracking.scene_motion import SceneLook, SceneWatch

STAMP_S = 0.008
FAULT = "tracker drifts slowly"
RULES, MARGIN, SOON_S = SceneCheckRules(), 1.15, 5.0
VARIANTS = ("half of the points", "30 % of them", "half, turned back", "30 %, turned back")  # must be off
CALM_HEAD = (
    "| without a drift | vehicles | looks | say enough | never | off (mrad): median, 99 %, most | doubted |",
    "| --- | --- | --- | --- | --- | --- | --- |",
)
DRIFT_HEAD = (
    f"| tracker drifts slowly | bound (mrad) | seen | within {SOON_S:g} s | after (s) |",
    "| --- | --- | --- | --- | --- |",
)

ONE_WAY_HEAD = (
    f"| along one way over across it, bound {RULES.one_way_ratio:g} | calm vehicles doubted | most without a drift | "
    f"seen | within {SOON_S:g} s | after (s) |",
    "| --- | --- | --- | --- | --- | --- |",
)


@dataclass(frozen=True)
class Moment:
    """When a picture is held against the tracker: truth and tracker (4, 4), turn (rad/s, body), the other vehicles,
    and what the points of the rehearsal say."""

    at_s: float
    T_world_body: np.ndarray
    T_odom_body: np.ndarray
    turns_radps: np.ndarray
    others: List[Body]
    epoch: int
    points: Optional[SceneLook]


@dataclass
class Seen:
    """By one witness of one vehicle's flight. ``looks`` (N, 4 + witnesses): time, seconds between the pictures, turn
    (rad), points, and how far off (rad), the first as on board, the others as VARIANTS."""

    looks: np.ndarray
    one_way: np.ndarray  # (N, 4) time, seconds between the pictures, ratio of one_way, height over the ground
    cpu_s: float = 0.0

    def one_way_s(self, ratio: float, from_s: float = -np.inf) -> Optional[float]:
        """When first points had moved so much one way, as SceneCheck counts looks."""
        check = SceneCheck(dataclasses.replace(RULES, one_way_ratio=ratio))
        return next((row[0] for row in self.one_way.tolist() if check.one_way(*row) and row[0] >= from_s), None)

    @property
    def most_one_way(self) -> float:
        """The least ratio at which nothing would be said."""
        ratios = sorted({1e-6, *self.one_way[self.one_way[:, 2] > 0.0, 2].tolist()})
        return next((r for r in ratios if self.one_way_s(r) is None), float("inf"))

    @property
    def enough(self) -> np.ndarray:
        """(N,) which looks say enough."""
        return (self.looks[:, 1] >= RULES.least_s) & (self.looks[:, 3] >= RULES.least_points)

    def net_rad(self, witness: int = 0) -> np.ndarray:
        """(M,) of the looks that say enough, without what a turn may do."""
        mine = self.looks[self.enough]
        return mine[:, 4 + witness] - RULES.off_share * mine[:, 2]

    def in_a_row(self, witness: int = 0) -> Tuple[np.ndarray, np.ndarray]:
        """Times and the least of as many looks as must be off in a row."""
        at_s, net_rad = self.looks[self.enough, 0], self.net_rad(witness)
        n = RULES.looks
        if len(net_rad) < n:
            return np.empty(0), np.empty(0)
        rows = np.lib.stride_tricks.sliding_window_view(net_rad, n).min(axis=1)
        return at_s[n - 1 :], rows

    def doubted_s(self, bound_rad: float, from_s: float = -np.inf, witness: int = 0) -> Optional[float]:
        """When first as many looks in a row were beyond a bound."""
        at_s, rows = self.in_a_row(witness)
        beyond = at_s[(rows > bound_rad) & (at_s >= from_s)]
        return float(beyond[0]) if len(beyond) else None


class Recorder:
    """Of one flight, while the vehicles fly."""

    def watch(self, flight: Flight) -> None:
        """Note each vehicle's pictures."""
        self.flight, self.moments = flight, {name: [] for name in flight.fleet}
        for vehicle in flight.fleet.values():
            vehicle._pictured = self._noting(vehicle, vehicle._pictured)

    def _noting(self, vehicle: RehearsedVehicle, pictured: Callable) -> Callable:
        def noted(now_s: float, T_world_body: np.ndarray) -> None:
            looks: List[SceneLook] = []
            receive, vehicle.link.receive = vehicle.link.receive, lambda _now_s, seen: looks.append(seen)
            pictured(now_s, T_world_body)
            vehicle.link.receive, state = receive, vehicle.link.port.core.state
            if state.armed and state.in_the_air:
                others = [
                    Body(v.geometry, v.body.T_world_body.copy()) for v in self.flight.fleet.values() if v is not vehicle
                ]
                self.moments[vehicle.name].append(Moment(
                    now_s, T_world_body.copy(), vehicle.T_odom_body.copy(), np.array(vehicle.odometry.angular_radps),
                    others, vehicle.epoch.number, looks[0] if looks else None,
                ))  # fmt: skip

        return noted


def by_points(moments: Sequence[Moment]) -> Seen:
    """What the rehearsal's witness says."""
    looks = [(m.at_s, m.points) for m in moments if m.points is not None]
    one_way = [(m.at_s, m.points.span_s, m.points.one_way, m.T_world_body[2, 3]) for m in moments if m.points]
    return Seen(
        np.array([(t, k.span_s, k.turn_rad, k.points, k.off_rad) for t, k in looks]).reshape(-1, 5),
        np.array(one_way).reshape(-1, 4),
    )


def by_pictures(
    moments: Sequence[Moment], renderer: Renderer, T_body_cam: np.ndarray, seed: int, width_px: int
) -> Seen:
    """What the witness on board says of drawn pictures."""
    random, watch = np.random.default_rng([seed, 9]), SceneWatch()
    camera = SimulatedCamera(renderer, T_body_cam, CameraParameters(width_px, width_px * 3 // 4), seed)
    shake_rad = np.radians(Airframe().vibration_rms_deg)
    looks, one_way, epoch, cpu_s = [], [], None, 0.0
    for m in moments:
        if m.epoch != epoch:
            epoch = m.epoch
            watch.begin_again()
        turn_rad = random.normal(0.0, shake_rad, 3) + random.normal(0.0, STAMP_S) * m.turns_radps
        T = m.T_world_body @ transforms.transform(rotations.exp(turn_rad), np.zeros(3))
        grey = cv2.cvtColor(camera.shoot(m.at_s, T, m.others, samples=1).rgb, cv2.COLOR_RGB2GRAY)
        begun_s = time.process_time()
        LAST.clear()
        seen = watch.see(m.at_s, grey, camera.model, m.T_odom_body @ T_body_cam)
        cpu_s += time.process_time() - begun_s
        if seen is not None:
            looks.append((m.at_s, seen.span_s, seen.turn_rad, seen.points, seen.off_rad, *variants(*LAST)))
            one_way.append((m.at_s, seen.span_s, seen.one_way, m.T_world_body[2, 3]))
    return Seen(np.array(looks).reshape(-1, 5 + len(VARIANTS)), np.array(one_way).reshape(-1, 4), cpu_s)


# ---- other witnesses by the same points ------------------------------------------------------------------------


LAST: List[np.ndarray] = []  # of the last look: points then and now, T_now_then


def _remember(span_s: float, xy_then: np.ndarray, xy_now: np.ndarray, T_now_then: np.ndarray, R_odom_now) -> SceneLook:
    LAST[:] = xy_then, xy_now, T_now_then
    return _look(span_s, xy_then, xy_now, T_now_then, R_odom_now)


_look, scene_motion.look = scene_motion.look, _remember


def variants(xy_then: np.ndarray, xy_now: np.ndarray, T_now_then: np.ndarray) -> Tuple[float, ...]:
    """How far off (rad) by VARIANTS."""
    off_rad = scene_motion.off_lines(xy_then, xy_now, T_now_then)
    still_rad = scene_motion.off_lines(xy_then, _turned_back(xy_then, xy_now, T_now_then), T_now_then)
    return tuple(float(np.quantile(off, share)) for off in (off_rad, still_rad) for share in (0.5, 0.7))


def _turned_back(xy_then: np.ndarray, xy_now: np.ndarray, T_now_then: np.ndarray) -> np.ndarray:
    """Points now without the small turn of the whole picture that explains most of them: vibration, late stamps."""
    x, y = xy_now.T
    turns = np.stack([np.stack([x * y, -(1.0 + x**2), y], axis=1), np.stack([1.0 + y**2, -x * y, -x], axis=1)], axis=1)
    told = xy_then @ T_now_then[:3, :2].T + T_now_then[:3, 2]
    flow = xy_now - told[:, :2] / np.maximum(told[:, 2:], 0.1)
    weights = np.ones(len(flow))
    for _ in range(6):  # least absolute differences: points that are near, or move, count little
        a, b = (weights[:, None, None] * turns).reshape(-1, 3), (weights[:, None] * flow).ravel()
        turn_rad = np.linalg.lstsq(a, b, rcond=None)[0]
        weights = 1.0 / np.sqrt(np.maximum(np.linalg.norm(flow - turns @ turn_rad, axis=1), 1e-4))
    return xy_now - turns @ turn_rad


# ---- tables ----------------------------------------------------------------------------------------------------


def calm_row(name: str, seen: Sequence[Seen]) -> str:
    """Of flights without a drift."""
    net = np.concatenate([s.net_rad() for s in seen])
    looks = sum(len(s.looks) for s in seen)
    figures = ", ".join(f"{1e3 * v:.1f}" for v in (*np.quantile(net, [0.5, 0.99]), net.max())) if len(net) else "–"
    blind = sum(not s.enough.any() for s in seen)
    doubted = sum(s.doubted_s(RULES.off_rad) is not None for s in seen)
    share = 100.0 * len(net) / max(looks, 1)
    return f"| {name} | {len(seen)} | {looks} | {share:.0f} % | {blind} | {figures} | {doubted} |"


def drift_row(name: str, seen: Sequence[Seen], began_s: Sequence[float], bound_rad: float, witness: int = 0) -> str:
    """Of flights with one."""
    told = [s.doubted_s(bound_rad, b, witness) for s, b in zip(seen, began_s)]
    after_s = sorted(t - b for t, b in zip(told, began_s) if t is not None)
    times = f"{np.median(after_s):.1f}, worst {after_s[-1]:.1f}" if after_s else "–"
    soon = sum(a < SOON_S for a in after_s)
    return f"| {name} | {1e3 * bound_rad:.1f} | {len(after_s)} of {len(seen)} | {soon} | {times} |"


def one_way_row(name: str, calm: Sequence[Seen], drifts: Sequence[Seen], began_s: Sequence[float]) -> str:
    """What the rule of points that moved one way says."""
    worst = max((s.most_one_way for s in calm), default=float("nan"))
    doubted = sum(s.one_way_s(RULES.one_way_ratio) is not None for s in calm)
    told = [s.one_way_s(RULES.one_way_ratio, b) for s, b in zip(drifts, began_s)]
    after_s = sorted(t - b for t, b in zip(told, began_s) if t is not None)
    times = f"{np.median(after_s):.1f}, worst {after_s[-1]:.1f}" if after_s else "–"
    soon = sum(a < SOON_S for a in after_s)
    return f"| {name} | {doubted} of {len(calm)} | {worst:.3f} | {len(after_s)} of {len(drifts)} | {soon} | {times} |"


@dataclass(frozen=True)
class Task:
    """One flight and its world."""

    world: str
    fault: str
    seed: int
    width_px: int


def look_again(task: Task) -> List[Tuple[bool, float, Seen, Seen]]:
    """Of each vehicle that is of interest: whether its tracker drifted, since when, by points, by pictures."""
    recorder, out = Recorder(), []
    rehearse(Job(load_mission(mission_file("short")), 2, task.seed, task.fault), recorder.watch)
    renderer = Renderer(Town.generate(task.seed, task.world))
    begun = {who: at_s for at_s, _, who in recorder.flight.witness.begun}
    for name, moments in recorder.moments.items():
        drifts = name in begun
        if moments and drifts == (task.fault != NONE):
            geometry = recorder.flight.fleet[name].geometry
            seed = 10 * task.seed + geometry.system_id
            pictures = by_pictures(moments, renderer, geometry.T_body_cam, seed, task.width_px)
            out.append((drifts, begun.get(name, 0.0), by_points(moments), pictures))
    return out


def tables(flights: Sequence[Tuple[str, bool, float, Seen, Seen]]) -> str:
    """All that was seen until now; world, and as look_again()."""
    worlds = list(dict.fromkeys(s[0] for s in flights))
    calm, drifts = ([s for s in flights if s[1] == drifting] for drifting in (False, True))
    rows = list(CALM_HEAD) if calm else []
    rows += [calm_row("points of the rehearsal", [s[3] for s in calm])] if calm else []
    for world in (w for w in worlds if any(s[0] == w for s in calm)):
        rows.append(calm_row(f"drawn pictures, {world}", [s[4] for s in calm if s[0] == world]))
    rows += ["", *DRIFT_HEAD] if drifts else []
    began_s = [s[2] for s in drifts]
    if drifts:
        rows.append(drift_row("points of the rehearsal", [s[3] for s in drifts], began_s, RULES.off_rad))
    for world in worlds:
        of = [(s[4], s[2]) for s in drifts if s[0] == world]
        rows += [drift_row(f"drawn pictures, {world}", *zip(*of), RULES.off_rad)] if of else []
    for k, name in enumerate(("as on board", *VARIANTS) if calm and drifts else ()):
        worst_rad = max(float(s[4].in_a_row(k)[1].max(initial=0.0)) for s in calm)
        rows.append(drift_row(f"all drawn, {name}", [s[4] for s in drifts], began_s, MARGIN * worst_rad, k))
    rows += ["", *ONE_WAY_HEAD]
    for k, name in ((3, "points of the rehearsal"), (4, "drawn pictures")):
        rows.append(one_way_row(name, [s[k] for s in calm], [s[k] for s in drifts], began_s))
    looks, cpu_s = sum(len(s[4].looks) for s in flights), sum(s[4].cpu_s for s in flights)
    return "\n".join([*rows, "", f"{1e3 * cpu_s / max(looks, 1):.1f} ms of processor time for each look at a picture"])


def begin() -> None:
    """A process that looks."""
    logging.disable(logging.CRITICAL)
    cv2.setNumThreads(1)
    prepare()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calm", type=int, default=4, help="flights without a fault, in each world")
    parser.add_argument("--drifts", type=int, default=4, help="flights with a tracker that drifts slowly, likewise")
    parser.add_argument("--seed", type=int, default=71001)
    parser.add_argument("--worlds", default=",".join(WORLDS))
    parser.add_argument("--width", type=int, default=640, help="of the drawn pictures, pixels")
    parser.add_argument("--jobs", type=int, default=1, help="flights at a time")
    parser.add_argument("--out", help="a file for the table, written again after each flight")
    args = parser.parse_args()
    kinds = [(w, f) for k in range(max(args.calm, args.drifts)) for w in args.worlds.split(",")
             for f in (NONE,) * (k < args.calm) + (FAULT,) * (k < args.drifts)]  # fmt: skip
    tasks = [Task(w, f, args.seed + k, args.width) for k, (w, f) in enumerate(kinds)]
    begin()
    first, seen = look_again(tasks[0]), []  # what is compiled is compiled once
    with ProcessPoolExecutor(args.jobs, initializer=begin) as pool:
        told = pool.map(look_again, tasks[1:])
        for task, flight in zip(tasks, itertools.chain([first], tqdm(told, total=len(tasks) - 1, disable=None))):
            seen += [(task.world, *vehicle) for vehicle in flight]
            if args.out:
                Path(args.out).write_text(f"{len(seen)} vehicles\n\n{tables(seen)}\n")
    print(tables(seen))


if __name__ == "__main__":
    main()

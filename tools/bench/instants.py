# SPDX-License-Identifier: Apache-2.0
"""Whether what moves is mapped where it was: PYTHONPATH=tools python -m bench.instants --instants
20

Three vehicles hold (horizontal 4 m, vertical 8 m) while a car and a walker pass. Each instant is
mapped as in monitoring, from pictures at most 20 ms apart; and once, as a session, from pictures of
different seconds. With --session FOLDER the same of a flown session whose truth tells what moved
(make demo MISSION=at_once); at the end the map of all its recordings, which is to leave out what
moved. With --monitored each instant is mapped as live monitoring does it, and that map is left out.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import List, Tuple

import numpy as np

from bench.scenes import FOV_DEG, R_BODY_CAM, T_WORLD_HOME
from fcsv_geometry import transforms
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world.movers import movers, things
from fcsv_sim.world.town import Town
from fcsv_stereo import pipeline
from fcsv_stereo.evaluating.evaluation import Moving, moving
from fcsv_stereo.evaluating.truth import TrueScene, load_truth
from fcsv_stereo.instants import MOST_SKEW_S, at_once, instants
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, MapResult, Picture
from fcsv_stereo.pipeline import METHODS

MOST_ERROR = 0.05  # of the distance, of the median pixel of what moves
SECONDS_APART_S = 7.0  # between the recordings of a session
PLACES = {"uav1": (0.0, 0.0, 0.0), "uav2": (0.0, -4.0, 0.0), "uav3": (0.0, 0.0, 8.0)}
PAIRS = (("uav2", "horizontal", 4.0), ("uav3", "vertical", 8.0))
NOISE_RAD, NOISE_SHARE = np.radians(0.15), 0.01


class Stage:
    """The town, what moves in it, and a camera on each vehicle."""

    def __init__(self, seed: int):
        town = Town.generate(seed)
        self._movers, self._renderer = movers(town.plan), Renderer(town)
        parameters = CameraParameters(
            horizontal_fov_deg=FOV_DEG, distortion=(0.0,) * 5, mount_deg=0.0
        )
        self._model = parameters.model
        self._cameras = {
            v: SimulatedCamera(self._renderer, R_BODY_CAM, parameters, i)
            for i, v in enumerate(PLACES)
        }
        self._random = np.random.default_rng([seed, 11])

    def take(self, vehicle: str, stamp_s: float) -> Picture:
        """What a vehicle sees, with a pose as tags and odometry tell it; the reference's is
        home's."""
        hover = transforms.from_xyz_rpy(
            self._random.normal(0.0, 0.03, 3) + PLACES[vehicle],
            self._random.normal(0.0, np.radians(1.0), 3),
        )
        shot = self._cameras[vehicle].shoot(
            stamp_s, T_WORLD_HOME @ hover, things(self._movers, stamp_s)
        )
        away = vehicle != "uav1"
        sigma_m = away * NOISE_SHARE * np.linalg.norm(PLACES[vehicle])
        noise = transforms.from_xyz_rpy(
            self._random.normal(0.0, 1.0, 3) * sigma_m,
            self._random.normal(0.0, 1.0, 3) * away * NOISE_RAD,
        )
        T_home_cam = transforms.invert(T_WORLD_HOME) @ shot.T_world_cam @ noise
        return Picture(
            f"{vehicle}/{stamp_s:.3f}", vehicle, stamp_s, shot.rgb, self._model, T_home_cam
        )

    def judge(self, result: MapResult) -> List[Moving]:
        """Movers that stand in the reference picture (its pose is exact), nearest surface of
        all."""
        reference = result.reference
        T_world_cam, stamp_s = T_WORLD_HOME @ reference.T_home_cam, reference.stamp_s
        empty = self._renderer.render(T_world_cam, reference.camera, samples=1)[1]
        seen: List[Moving] = []
        for mover in self._movers:
            depth = self._renderer.render(
                T_world_cam, reference.camera, 1.0, things([mover], stamp_s), 1
            )[1]
            on = np.isfinite(depth) & ~(depth > 0.995 * empty)
            seen += moving(result.depth, depth, {mover.name: on})
        return seen


def instant(stage: Stage, stamp_s: float, skews_s: Tuple[float, float]) -> MapInput:
    """One picture of the reference, and of each other vehicle one that is off by its skew."""
    reference = stage.take("uav1", stamp_s)
    pairs = [
        ConfigurationInput(
            Configuration(axis, b, 0.0, f"{axis} {b:g} m"),
            [reference],
            [stage.take(v, stamp_s + skew)],
        )
        for (v, axis, b), skew in zip(PAIRS, skews_s)
    ]
    return MapInput("session", pairs)


def session(stage: Stage, stamp_s: float) -> MapInput:
    """The same pairs one after the other, and of each other vehicle only the end of its recording:
    nothing was taken with the reference picture, which is from the middle."""
    pairs = []
    for k, (v, axis, b) in enumerate(PAIRS):
        stamps_s = [stamp_s + (2 * k + part) * SECONDS_APART_S for part in (0.0, 0.5, 1.0)]
        pictures = [stage.take("uav1", t) for t in stamps_s], [stage.take(v, stamps_s[-1])]
        pairs.append(ConfigurationInput(Configuration(axis, b, 0.0, f"{axis} {b:g} m"), *pictures))
    return MapInput("session", pairs)


def main() -> int:
    """Exit status 1 where in any instant the median of a mover's answered pixels is off by more
    than is wanted."""
    parser = argparse.ArgumentParser(prog="bench.instants", description=__doc__.split("\n")[0])
    parser.add_argument("--instants", type=int, default=20, help="two seconds apart")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--session",
        type=Path,
        help="a flown session instead: its last recording, instant by instant",
    )
    parser.add_argument(
        "--every", type=int, default=1, help="with --session: of so many instants one"
    )
    parser.add_argument(
        "--monitored", action="store_true", help="with --session: as live monitoring maps it"
    )
    args = parser.parse_args()
    if args.monitored and not args.session:
        parser.error("--monitored needs --session")
    print(f"{'t':>6} {'of':<8} {'m':>5} {'pixels':>7} {'answered':>9} {'error':>7} {'wrong':>6}")
    return flown(args.session, args.every, args.monitored) if args.session else simulated(args)


def flown(path: Path, every: int, monitored: bool) -> int:
    """Each instant of a session's last recording, and, where it is not ``monitored``, the session
    as a whole."""
    joint = METHODS["joint"]
    options = joint.monitor if monitored else joint.options()
    given, scene, off, silent, took_s = (
        pipeline.load(path),
        TrueScene(load_truth(path / "truth")),
        0,
        0,
        [],
    )
    found = [i for i in instants(at_once(given.configurations)[-1]) if i.skew_s <= MOST_SKEW_S][
        ::every
    ]
    begun_s = found[0].reference.stamp_s if found else 0.0
    for i in found:
        begun = time.process_time()
        result = joint.map(replace(given, configurations=i.configurations), options)
        took_s.append(time.process_time() - begun)
        seen = _moving(result, scene)
        off += sum(_print(result.reference.stamp_s - begun_s, s) for s in seen)
        silent += sum(s.median_relative_error is None for s in seen)
    skews = [1e3 * i.skew_s for i in found] or [float("nan")]
    print(
        f"{len(found)} instants, skew at most {max(skews):.0f} ms, {off} answers off by more than {MOST_ERROR:.0%}, "
        f"{silent} things without an answer; median {np.median(took_s or [np.nan]):.2f} s of processor time"
    )
    if monitored:
        return int(off + silent > 0 or not found)
    print("all recordings")
    result = joint.map(given)
    for s in _moving(result, scene):
        _print(result.reference.stamp_s - begun_s, s)
    print("\n".join(result.warnings))
    return int(off > 0 or not found)


def _moving(result: MapResult, scene: TrueScene) -> List[Moving]:
    r = result.reference
    depth, on = scene.look(r.vehicle, r.stamp_s, r.camera)
    return moving(result.depth, depth, on)


def simulated(args) -> int:
    """The vehicles of PLACES."""
    stage, joint, random = Stage(args.seed), METHODS["joint"], np.random.default_rng(args.seed)
    off = 0
    for k in range(args.instants):
        skews_s = tuple(random.uniform(-MOST_SKEW_S, MOST_SKEW_S, 2))
        for s in stage.judge(joint.map(instant(stage, 2.0 * k, skews_s))):
            off += _print(2.0 * k, s)
    print(f"pictures of different seconds ({SECONDS_APART_S:g} s)")
    result = joint.map(session(stage, 0.0))
    for s in stage.judge(result):
        _print(result.reference.stamp_s, s)
    print("\n".join(result.warnings))
    return int(off > 0)


def _print(t_s: float, s: Moving) -> bool:
    """Whether it is off."""
    error = s.median_relative_error
    off = error is not None and error > MOST_ERROR
    words = f"{s.name:<8} {s.distance_m:>5.1f} {s.pixels:>7} {s.answered:>9.0%} "
    words += f"{'-' if error is None else f'{error:.1%}':>7} {s.wrong:>6.0%}"
    print(f"{t_s:>6.1f} {words}{'  off' if off else ''}", flush=True)
    return off


if __name__ == "__main__":
    sys.exit(main())

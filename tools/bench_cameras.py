# SPDX-License-Identifier: Apache-2.0
"""Maps from pictures whose stated camera is wrong: what is sure and wrong, and whether the cause is
named.

.venv/bin/python tools/bench_cameras.py [--places street:61 village:62 field:63] [--only WORDS]
[--words]

A camera at five places turns towards the scene from picture to picture, or keeps still (no turn),
at 320x240. The stated focal length is off by 5, 11 or 20 % in all pictures or in one of five, or
the principal point is. Poses have the noise that they state; in some cases four times it. A pixel
is sure where its sigma is below 3 % of its depth, and wrong where its depth is off by more than 10
%. Seeds 1 to 40 served to choose numbers; docs/lab/refinement.md has a table of others.
"""

import argparse
import re
from dataclasses import dataclass, replace
from typing import Dict, Iterator, List, Sequence

import numpy as np

from bench.scenes import T_WORLD_HOME, PoseNoise, SceneName, camera_in
from fcsv_geometry import transforms
from fcsv_stereo import pipeline
from fcsv_stereo.errors import StereoError
from fcsv_stereo.joint import JointOptions
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, Picture

SIZE = (320, 240)
BASELINES_M = (2.0, 4.0, 6.0, 8.0)
STATED = PoseNoise(np.radians(0.15), 0.01)
SURE, WRONG = 0.03, 0.1
# of the outermost picture, in yaw; half of it in pitch and roll
TURNS_DEG = {"turning": 8.0, "still": 0.0}
ODD = 2  # of the others: the one picture with another camera
CAUSES = {"all": "focal length", "one": "focal length", "centre": "principal point"}


@dataclass(frozen=True)
class Shots:
    """True pictures of one place, the reference first, and the reference's depth (m, NaN sky)."""

    pictures: List[Picture]
    depth: np.ndarray
    seed: int


@dataclass(frozen=True)
class Outcome:
    """Shares of the picture's pixels that have a true depth: ``answered``, ``sure``, sure and
    wrong; ``words`` that were printed, or the error."""

    answered: float
    sure: float
    sure_and_wrong: float
    answered_wrong: float
    words: List[str]


def shots(place: SceneName, turn_deg: float, pictures: int = 1 + len(BASELINES_M)) -> Shots:
    """A camera carried sideways that turns towards the scene, and shakes by a quarter of that."""
    random, camera = np.random.default_rng([*place.words(), 23]), camera_in(place, SIZE)
    taken, depth = [], None
    for k, b in enumerate((0.0, *BASELINES_M)[:pictures]):
        turn = np.radians(turn_deg) * np.array([0.0, 0.0, b / BASELINES_M[-1]])
        turn = turn + np.radians(turn_deg) * random.normal(0.0, 0.25, 3)
        xyz = np.array([0.0, -b, 0.0]) + random.normal(0.0, 0.03, 3)
        shot = camera.shoot(float(k), T_WORLD_HOME @ transforms.from_xyz_rpy(xyz, turn))
        depth = shot.depth if depth is None else depth
        T_home_cam = transforms.invert(T_WORLD_HOME) @ shot.T_world_cam
        taken.append(Picture(f"{k}.png", "camera", float(k), shot.rgb, camera.model, T_home_cam))
    return Shots(taken, depth, place.seed)


def stated(
    found: Shots, focal: float = 1.0, one: float = 1.0, centre: float = 0.0, off: float = 1.0
) -> MapInput:
    """As a user hands them in: focal lengths times ``focal``, that of one picture times ``one``
    besides, principal points ``centre`` of the width to the right, and pose errors ``off`` times as
    large as stated."""
    random = np.random.default_rng([found.seed, 29])
    reference, *others = found.pictures
    given = [reference]
    for other in others:
        b = float(np.linalg.norm(other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]))
        position = off * STATED.prior.position_sigma_m(b) * random.standard_normal(3)
        error = transforms.from_xyz_rpy(
            position, off * STATED.rotation_rad * random.standard_normal(3)
        )
        given.append(replace(other, T_home_cam=other.T_home_cam @ error))
    cameras = []
    for k, p in enumerate(given):
        c, f = p.camera, focal * (one if k == 1 + ODD else 1.0)
        cameras.append(replace(c, fx=c.fx * f, fy=c.fy * f, cx=c.cx + centre * c.width))
    reference, *others = (replace(p, camera=c) for p, c in zip(given, cameras))
    configurations = [
        ConfigurationInput(Configuration("horizontal", b, 0.0, o.name), [reference], [o])
        for b, o in zip(BASELINES_M, others)
    ]
    return MapInput("photographs", configurations, prior=STATED.prior)


def mapped(given: MapInput, depth: np.ndarray) -> Outcome:
    """The map of them, against the truth."""
    try:
        result = pipeline.METHODS["joint"].map(given, JointOptions(), lambda *_: None)
    except StereoError as error:
        return Outcome(0.0, 0.0, 0.0, 0.0, [f"refused: {error}"])
    there = np.isfinite(depth)
    answered = np.isfinite(result.depth)
    sure = answered & (result.sigma < SURE * result.depth)
    wrong = ~(np.abs(result.depth / depth - 1.0) <= WRONG)
    counts = [
        float(a.sum()) / max(there.sum(), 1)
        for a in (answered, sure, sure & wrong, answered & wrong)
    ]
    return Outcome(*counts, [*result.warnings, *result.unseen])


def faults() -> Iterator[tuple]:
    """(kind, words, arguments of ``stated``)."""
    yield "right", "the stated camera is right", {}
    for percent in (-20, -11, -5, 5, 11, 20):
        yield "all", f"focal length {percent:+d} %", {"focal": 1.0 + percent / 100}
    for percent in (-20, -11, -5, 5, 11, 20):
        yield "one", f"one of five, focal length {percent:+d} %", {"one": 1.0 + percent / 100}
    for percent in (-15, -5, 5, 15):
        yield "centre", f"principal point, {percent:+d} % of the width", {"centre": percent / 100}


def named(kind: str, outcome: Outcome) -> bool:
    """Whether what is printed names the cause; of right cameras, that none is blamed."""
    if kind == "right":
        return not [
            w
            for w in outcome.words
            if re.search("focal length|shutter|principal", w)
            and "Whether" not in w
            and "all 4 others" not in w
        ]
    said = [w for w in outcome.words if re.search(CAUSES[kind], w)]
    if kind == "one":
        said = [w for w in said if f"{1 + ODD}.png" in w]
    return bool(said)


def cases(found: Dict[str, Shots], only: str = "") -> Iterator[tuple]:
    """(what is wrong, its kind, Outcome), one by one; a few with poses that are worse than
    stated."""
    for how, of in found.items():
        for kind, words, changes in faults():
            for off in (
                (1.0, 4.0) if kind == "right" or changes.get("focal") in (0.89, 1.11) else (1.0,)
            ):
                name = f"{how}; {words}" + (
                    f"; poses {off:g} times as wrong as stated" if off != 1.0 else ""
                )
                if only in name:
                    yield name, kind, mapped(stated(of, off=off, **changes), of.depth)


def line(name: str, outcomes: Sequence[Outcome], kind: str) -> str:
    """Of the table: means over the scenes."""
    shares = np.mean(
        [[o.answered, o.sure, o.sure_and_wrong, o.answered_wrong] for o in outcomes], axis=0
    )
    of_sure = shares[2] / max(shares[1], 1e-9)
    cells = [f"{100 * x:.0f}" for x in shares[:2]] + [
        f"{100 * shares[2]:.1f}",
        f"{100 * of_sure:.1f}",
    ]
    cells += [
        f"{100 * shares[3]:.0f}",
        f"{sum(named(kind, o) for o in outcomes)} of {len(outcomes)}",
    ]
    return f"| {name} | {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--places", nargs="+", default=["street:61", "village:62", "field:63"], help="WORLD:SEED"
    )
    parser.add_argument("--only", default="", help="cases whose name has this in it")
    parser.add_argument("--words", action="store_true", help="print what was said as well")
    args = parser.parse_args()
    places = [SceneName(w, int(s)) for w, s in (place.split(":") for place in args.places)]
    by_name: Dict[str, tuple] = {}
    for place in places:
        found = {how: shots(place, deg) for how, deg in TURNS_DEG.items()}
        for name, kind, outcome in cases(found, args.only):
            by_name.setdefault(name, (kind, []))[1].append(outcome)
            if args.words:
                print(
                    line(f"{place}: {name}", [outcome], kind),
                    *outcome.words,
                    sep="\n    ",
                    flush=True,
                )
    print(
        "| input | answered, % | sure | sure and wrong | of the sure | answered and wrong | cause named |"
    )
    print("|---|---|---|---|---|---|---|")
    print(*(line(name, outcomes, kind) for name, (kind, outcomes) in by_name.items()), sep="\n")


if __name__ == "__main__":
    main()

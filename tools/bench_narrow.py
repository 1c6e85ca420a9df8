# SPDX-License-Identifier: Apache-2.0
"""Whether the refined rotation of narrow pairs is as good as its covariance says; table: docs/lab/refinement.md.

.venv/bin/python tools/bench_narrow.py [--draws 8] [--seeds 51 52 53] [--photographs FOLDER] [--prior-deg 0.01]

Pairs are drawn 0.5, 1 and 2 m apart in three worlds, through cameras that are not quite what they are said to be. For
the rotation about each axis: the error's rms, what is stated (median), and shares of the errors within 1 and 2 of what
is stated; "without fields" states the noise alone, as until 2026-11-25. --photographs adds each pair of neighbours of a
COLMAP model that has truth_images.txt beside images.txt. --prior-deg gives poses that are known so well (as
--prior-rotation-deg says of photographs; with 0.1 % of the baseline): they should end no worse than they came, and
pictures that keep theirs are counted, too.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, Dict, Iterator, List, Tuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from bench.scenes import ATTITUDE_SIGMA_RAD, NOISES, T_WORLD_HOME, PoseNoise, SceneName, camera_in
from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo import colmap
from fcsv_stereo.model import Picture
from fcsv_stereo.refinement import RefinedPicture, RefineOptions, refine
from fcsv_stereo.refinement.rolling_shutter import straightened

_WORLDS = ("street", "village", "field")
_BASELINES_M = (0.5, 1.0, 2.0)
_READOUT_TURN_RAD = np.radians(6.0) * 0.02  # 20 ms of 6 degrees a second per axis
_BARREL, _OFF_AXIS = np.sqrt(0.8), np.sqrt(0.2)  # shares of a field's variance: radial, tangential
_AXES = ("pitch", "yaw", "roll")
_GOOD_SHARE = 0.001  # of the baseline: how well places are known with --prior-deg

#: A picture made into the one that a worse camera takes.
Fault = Callable[[Picture, np.random.Generator], Picture]


@dataclass(frozen=True)
class Angles:
    """Of one refined picture, camera axes, degrees (3,): error, what noise explains, what is stated."""

    error: np.ndarray
    noise: np.ndarray
    stated: np.ndarray


def lens(rms_px: float) -> Fault:
    """Distortion that a calibration left: radial and tangential, rms so many px over the picture for each of both."""

    def fault(picture: Picture, random: np.random.Generator) -> Picture:
        c = picture.camera
        x, y = c.rays()[..., 0], c.rays()[..., 1]
        square = x * x + y * y
        p1, p2 = random.normal(0.0, 1.0, 2)
        radial = np.stack([x * square, y * square]) * random.normal()
        tangential = np.stack([2 * p1 * x * y + p2 * (square + 2 * x * x), p1 * (square + 2 * y * y) + 2 * p2 * x * y])
        size = [np.sqrt(np.mean(np.square(f))) for f in (np.stack([x, y]) * square, tangential)]
        shift = rms_px * (_BARREL * radial / size[0] + _OFF_AXIS * abs(random.normal()) * tangential / size[1])
        v, u = np.indices(x.shape, np.float32)
        places = (u + shift[0]).astype(np.float32), (v + shift[1]).astype(np.float32)
        return replace(picture, image=cv2.remap(picture.image, *places, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT))

    return fault


def rolling(picture: Picture, random: np.random.Generator) -> Picture:
    """Rows that were read one after the other while the camera turned."""
    return straightened(picture, -random.normal(0.0, _READOUT_TURN_RAD, 3))


CAMERAS: Dict[str, Fault] = {
    "as said": lambda picture, _: picture,
    "distortion of 0.1 px left": lens(0.1),
    "distortion of 0.2 px left": lens(0.2),
    "rolling shutter": rolling,
}


def pairs(place: SceneName, draws: int) -> Iterator[Tuple[Picture, Picture, np.random.Generator]]:
    """(reference, other) with true poses, and what draws their faults."""
    camera = camera_in(place)
    for draw in range(draws):
        random = np.random.default_rng([*place.words(), draw, 19])
        baseline_m = _BASELINES_M[draw % len(_BASELINES_M)]
        taken = []
        for number, y_m in enumerate((0.0, -baseline_m)):
            p = np.array([draw * 1.5, y_m, 0.0]) + random.normal(0.0, 0.02 * baseline_m, 3)
            T_home_body = transforms.from_xyz_rpy(p, random.normal(0.0, ATTITUDE_SIGMA_RAD, 3))
            shot = camera.shoot(float(number), T_WORLD_HOME @ T_home_body)
            T_home_cam = transforms.invert(T_WORLD_HOME) @ shot.T_world_cam
            taken.append(Picture(f"{number}", f"uav{number + 1}", 0.0, shot.rgb, camera.model, T_home_cam))
        yield taken[0], taken[1], random


def with_prior(reference: Picture, other: Picture, noise: PoseNoise, random: np.random.Generator) -> Picture:
    """With noise on its pose."""
    baseline_m = float(np.linalg.norm(other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]))
    off_m = random.normal(0.0, noise.prior.position_sigma_m(baseline_m), 3)
    off = transforms.from_xyz_rpy(off_m, random.normal(0.0, noise.rotation_rad, 3))
    return replace(other, T_home_cam=other.T_home_cam @ off)


def judged(refined: RefinedPicture, T_true: np.ndarray) -> Angles:
    """Against the true T_home_cam."""
    turn = Rotation.from_matrix(T_true[:3, :3].T @ refined.picture.T_home_cam[:3, :3]).as_rotvec()
    variances = [np.diag(c)[:3] for c in (refined.told, refined.covariance)]
    return Angles(*(np.degrees(x) for x in (turn, np.sqrt(variances[0]), np.sqrt(variances[1]))))


def drawn(places: List[SceneName], draws: int, noise: PoseNoise, kept_too: bool) -> Dict[str, List[Angles]]:
    """By camera, of all pairs that are refined; ``kept_too``: and of those that keep their prior."""
    found: Dict[str, List[Angles]] = {name: [] for name in CAMERAS}
    options = RefineOptions(prior=noise.prior)
    for place in places:
        for reference, other, random in pairs(place, draws):
            prior = with_prior(reference, other, noise, random)
            for name, fault in CAMERAS.items():
                result = refine(fault(reference, random), [fault(prior, random)], options)
                found[name] += [judged(r, other.T_home_cam) for r in result.others if r.refined or kept_too]
        print(f"    {place}: {draws} pairs", flush=True)
    return found


def photographs(folder: Path) -> List[Angles]:
    """Of each picture of a COLMAP model with its next one, priors of images.txt, truth of truth_images.txt."""
    cameras: Dict[int, PinholeCamera] = colmap.read_cameras(folder / "cameras.txt")
    true = {p.name: p.T_home_cam for p in colmap.read_images(folder / "truth_images.txt", cameras)}
    given = colmap.read_photographs(folder)
    taken = [given.configurations[0].references[0], *(c.others[0] for c in given.configurations)]
    found = []
    for reference, other in zip(taken, taken[1:]):
        T_true = reference.T_home_cam @ transforms.invert(true[reference.name]) @ true[other.name]
        (refined,) = refine(reference, [other]).others
        if refined.refined:
            found.append(judged(refined, T_true))
    return found


def rows(name: str, found: List[Angles]) -> List[str]:
    """Of the table: one for each axis."""
    error, noise, stated = (np.array([getattr(a, f) for a in found]) for f in ("error", "noise", "stated"))
    lines = []
    for i, axis in enumerate(_AXES):
        shares = [f"{(np.abs(error[:, i]) <= k * s[:, i]).mean():.0%}" for s in (noise, stated) for k in (1, 2)]
        rms, median = np.sqrt(np.mean(error[:, i] ** 2)), np.median(stated[:, i])
        lines.append(f"| {' | '.join([name, axis, str(len(error)), f'{rms:.4f}', f'{median:.4f}', *shares])} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=8, help="pairs of each of three scenes")
    parser.add_argument("--seeds", type=int, nargs=3, default=[51, 52, 53], help="of street, village, field")
    parser.add_argument("--prior-deg", type=float, help="noise of the poses per axis, as it is stated (default: 0.15)")
    parser.add_argument("--photographs", type=Path, help="images/, cameras.txt, images.txt, truth_images.txt")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    good = args.prior_deg is not None
    noise = PoseNoise(np.radians(args.prior_deg), _GOOD_SHARE) if good else NOISES[0]
    found = drawn([SceneName(*p) for p in zip(_WORLDS, args.seeds)], args.draws, noise, kept_too=good)
    if args.photographs:
        found[f"{args.photographs.name}, neighbours"] = photographs(args.photographs)
    print(
        "| camera | axis | pairs | rms error, deg | stated, deg | within 1σ without fields | 2σ | within 1σ | 2σ |\n"
        + "|---" * 9 + "|"
    )  # fmt: skip
    print("\n".join(line for name, angles in found.items() for line in rows(name, angles)))


if __name__ == "__main__":
    main()

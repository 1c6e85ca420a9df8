# SPDX-License-Identifier: Apache-2.0
"""Sets of GPS-tagged photographs drawn at random: is the truth within what import_photos states,
and what is refused?

tools/run gps-sets [--sets 500] [--seed 1]

No pictures: places, angles and a model's poses are drawn, and the fit is that of import_photos.
Refused without need is a set of which an observer who knows what is wrong and how large the errors
are would know scale, level and north to half of the bounds at which import_photos refuses (Cramér
and Rao's bound), from six right places or more that are more than twice as many as the wrong ones.
The table is in docs/lab/photographs.md.
"""

import argparse
import time
from collections import Counter
from dataclasses import dataclass
from typing import Dict, List, NamedTuple, Optional, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_stereo.errors import InputError
from fcsv_stereo.photos.similarity import (
    MOST_LEVEL_SIGMA_RAD,
    MOST_NORTH_SIGMA_RAD,
    MOST_SCALE_SIGMA,
    Similarity,
    fit,
)

LAYOUTS = ("strip", "block", "orbit")
VIEWS_DEG = {"nadir": 90.0, "oblique": 45.0, "level": 5.0}
_SHARED_TILT_RAD, _SHARED_NORTH_RAD = np.radians([1.0, 4.0])
#: A camera that looks north and level: right, down and forward in east, north, up.
_R_NORTH = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class GpsSet:
    """Of N photographs what the fit is given (as ``fit`` has it), and how it was drawn. ``wrong_*``
    (N,) bool."""

    layout: str
    view: str
    p_model: np.ndarray
    p_enu_m: np.ndarray
    said_sigmas_m: np.ndarray
    R_model_cam: np.ndarray
    R_enu_cam: List[Optional[np.ndarray]]
    scale: float
    R_enu_model: np.ndarray
    true_enu_m: np.ndarray
    R_true_cam: np.ndarray
    sigmas_m: np.ndarray
    angle_sigmas_rad: np.ndarray
    wrong_places: np.ndarray
    wrong_angles: np.ndarray

    @property
    def kind(self) -> str:
        return f"{self.layout}, {'angles' if self.R_enu_cam[0] is not None else 'no angles'}"


class Judged(NamedTuple):
    """Errors in stated standard deviations (scale, level about two axes, north), or why it was
    refused."""

    errors: Optional[np.ndarray]
    scale_sigma: float
    refused: str
    needless: bool


def draw(rng: np.random.Generator) -> GpsSet:
    """One set."""
    layout, view = rng.choice(LAYOUTS), rng.choice(list(VIEWS_DEG))
    true_enu, headings = _flown(rng, layout)
    n = len(true_enu)
    gps_m, share = _log_uniform(rng, 0.01, 10.0), rng.uniform(0.0, 0.3, 2)
    angle_sigmas = np.radians([*[_log_uniform(rng, 0.3, 3.0)] * 2, _log_uniform(rng, 0.5, 5.0)])
    R_true = np.array([_camera(h, VIEWS_DEG[view], rng) for h in headings])
    wrong_places, wrong_angles = (rng.permutation(n) < int(s * n) for s in share)
    sigmas = np.tile([gps_m, gps_m, gps_m * rng.uniform(1.0, 2.0)], (n, 1))
    p_enu = true_enu + rng.normal(0.0, 1.0, (n, 3)) * sigmas
    for i in np.flatnonzero(wrong_places):
        p_enu[i] = _wrong_place(p_enu[i], gps_m, rng)
    R_enu_model, scale = (
        Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix(),
        _log_uniform(rng, 0.1, 50),
    )
    extent_m = np.linalg.norm(true_enu.std(axis=0))
    noise_m = extent_m * _log_uniform(rng, 0.0003, 0.005)
    turned = Rotation.from_rotvec(
        np.radians(_log_uniform(rng, 0.02, 0.2)) * rng.normal(0, 1, (n, 3))
    ).as_matrix()
    p_model = (
        (true_enu + rng.normal(0, noise_m, (n, 3)) - rng.normal(0, 100, 3)) @ R_enu_model / scale
    )
    return GpsSet(
        str(layout),
        str(view),
        p_model,
        p_enu,
        _said(sigmas, rng),
        R_enu_model.T @ turned @ R_true,
        _angles(R_true, angle_sigmas, wrong_angles, rng) if rng.random() < 0.7 else [None] * n,
        scale,
        R_enu_model,
        true_enu,
        R_true,
        np.hypot(sigmas, noise_m),
        angle_sigmas,
        wrong_places,
        wrong_angles,
    )


def _flown(rng, layout: str):
    """Places (N, 3) and headings (N,) from north, clockwise."""
    n, step, course = (
        int(_log_uniform(rng, 6, 60)),
        _log_uniform(rng, 4, 30),
        rng.uniform(0, 2 * np.pi),
    )
    along, beside = np.arange(n) * step, np.zeros(n)
    headings = np.full(n, course + rng.choice([0.0, np.pi / 2]))
    if layout == "block":
        columns = max(2, int(np.ceil(n / rng.integers(2, 5))))
        row = np.arange(n) // columns
        along, beside = (np.arange(n) % columns) * step, row * step * rng.uniform(1, 2)
        headings = headings + np.pi * (row % 2)
    if layout == "orbit":
        angle = np.arange(n) / n * rng.uniform(0.7, 2.0) * np.pi
        along, beside, headings = (
            n * step / 6 * np.sin(angle),
            n * step / 6 * np.cos(angle),
            course + angle + np.pi,
        )
    level = along[:, None] * [np.sin(course), np.cos(course)] + beside[:, None] * [
        np.cos(course),
        -np.sin(course),
    ]
    places = np.column_stack([level, 50.0 + 0.0 * along])
    return places + rng.normal(0, 1, (n, 3)) * [
        0.05 * step,
        0.05 * step,
        _log_uniform(rng, 0.1, 3.0),
    ], headings


def _camera(heading: float, down_deg: float, rng) -> np.ndarray:
    yaw, pitch, roll = rng.normal(0, np.radians([3.0, 3.0, 1.5]))
    turns = Rotation.from_euler("ZXY", [-heading + yaw, -np.radians(down_deg) + pitch, roll])
    return turns.as_matrix() @ _R_NORTH


def _wrong_place(place, gps_m: float, rng) -> np.ndarray:
    """Anywhere from ten standard deviations to 100 km off, or with its height's sign changed."""
    if rng.random() < 0.2:
        return place - [0.0, 0.0, 2.0 * rng.uniform(200, 600)]
    direction = rng.normal(0, 1, 3) * [1.0, 1.0, 0.3]
    return place + direction / np.linalg.norm(direction) * _log_uniform(
        rng, max(10 * gps_m, 3.0), 1e5
    )


def _said(sigmas: np.ndarray, rng) -> np.ndarray:
    """What files say of GPS: nearly right; or nothing, where it is an ordinary receiver's."""
    if sigmas[0, 0] > 0.3 and rng.random() < 0.4:
        return np.tile([2.0, 2.0, 4.0], (len(sigmas), 1))
    return sigmas * np.exp(rng.normal(0, 0.3))


def _angles(R_true, sigmas, wrong, rng) -> List[np.ndarray]:
    shared = rng.normal(0, [_SHARED_TILT_RAD, _SHARED_TILT_RAD, _SHARED_NORTH_RAD])
    found = (
        Rotation.from_rotvec(rng.normal(0, 1, (len(R_true), 3)) * sigmas + shared).as_matrix()
        @ R_true
    )
    for i in np.flatnonzero(wrong):
        kind = rng.integers(3)
        if kind == 0:  # roll of 180 degrees
            found[i] = found[i] @ np.diag([-1.0, -1.0, 1.0])
        elif kind == 1:  # a compass that is off
            found[i] = (
                Rotation.from_euler("Z", rng.uniform(0.6, 2 * np.pi - 0.6)).as_matrix() @ found[i]
            )
        else:
            found[i] = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    return list(found)


def judge(drawn: GpsSet) -> Judged:
    """The fit of a set, against its truth."""
    try:
        found = fit(
            drawn.p_model, drawn.p_enu_m, drawn.said_sigmas_m, drawn.R_model_cam, drawn.R_enu_cam
        )
    except InputError as error:
        return Judged(None, np.nan, str(error), is_enough(drawn))
    return Judged(errors_in_sigmas(drawn, found), found.scale_sigma, "", False)


def errors_in_sigmas(drawn: GpsSet, found: Similarity) -> np.ndarray:
    """(4,): scale, level about its two principal axes, north."""
    turn = Rotation.from_matrix(found.R_enu_model @ drawn.R_enu_model.T).as_rotvec()
    variances, axes = np.linalg.eigh(found.covariance[1:3, 1:3])
    level = axes.T @ turn[:2] / np.sqrt(variances)
    scale = np.log(found.scale / drawn.scale) / found.scale_sigma
    return np.abs([scale, *level, turn[2] / found.north_sigma_rad])


def is_enough(drawn: GpsSet) -> bool:
    """Whether who knows what is right would know scale and turn well from it."""
    right, wrong = int((~drawn.wrong_places).sum()), int(drawn.wrong_places.sum())
    if right < 6 or right <= 2 * wrong:
        return False
    scale, level, north = known_to(drawn)
    return bool(
        scale < MOST_SCALE_SIGMA / 2
        and level < MOST_LEVEL_SIGMA_RAD / 2
        and north < MOST_NORTH_SIGMA_RAD / 2
    )


def known_to(drawn: GpsSet) -> Sequence[float]:
    """Least standard deviations of scale, level (its worst axis) and north, from what is right
    alone."""

    def statements(x: np.ndarray) -> np.ndarray:
        """Whitened; x: logarithm of scale, turn, shift, shared turn of angles, shared tilt of
        rows."""
        R = Rotation.from_rotvec(x[1:4]).as_matrix()
        middle = drawn.true_enu_m.mean(axis=0)
        places = (np.exp(x[0]) * (drawn.true_enu_m - middle) @ R.T + x[4:7]) / drawn.sigmas_m
        parts = [
            places[~drawn.wrong_places].ravel(),
            x[7:10] / [*[_SHARED_TILT_RAD] * 2, _SHARED_NORTH_RAD],
        ]
        if drawn.R_enu_cam[0] is not None:
            n = int((~drawn.wrong_angles).sum())
            parts.append(
                (np.tile(x[1:4] - x[7:10], (n, 1)) / np.hypot(drawn.angle_sigmas_rad, 1e-3)).ravel()
            )
        else:
            rows = (R @ drawn.R_true_cam)[:, 2, 0] - x[10]
            parts += [rows / np.sin(np.radians(5.0)), x[10:] / np.sin(np.radians(2.0))]
        return np.concatenate(parts)

    step = 1e-5
    J = np.array(
        [(statements(step * d) - statements(-step * d)) / (2 * step) for d in np.eye(11)]
    ).T
    known = np.linalg.inv(J.T @ J + np.diag([0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1e-3]) * 0.3)
    level = float(np.sqrt(np.linalg.eigvalsh(known[1:3, 1:3])[-1]))
    return float(np.sqrt(known[0, 0])), level, float(np.sqrt(known[3, 3]))


def _log_uniform(rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def run(sets: int, seed: int) -> Dict[str, List[Judged]]:
    """By kind of set."""
    found: Dict[str, List[Judged]] = {}
    for i in range(sets):
        drawn = draw(np.random.default_rng([seed, i]))
        found.setdefault(drawn.kind, []).append(judge(drawn))
    return found


def within(judged: Sequence[Judged], sigmas: float) -> float:
    """Share of the answered sets whose scale, level and north are all within so many stated
    sigmas."""
    errors = [j.errors.max() <= sigmas for j in judged if j.errors is not None]
    return float(np.mean(errors)) if errors else np.nan


def table(found: Dict[str, List[Judged]]) -> str:
    """Markdown."""
    lines = [
        "| sets | drawn | answered | all within 3σ | scale, level, north within 1σ | scale known to, median | "
        "refused | without need |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind, judged in [*sorted(found.items()), ("all", [j for of in found.values() for j in of])]:
        answered = [j for j in judged if j.errors is not None]
        errors = np.array([j.errors for j in answered]).reshape(-1, 4)
        ones = [
            np.mean(e <= 1.0) if e.size else np.nan
            for e in (errors[:, 0], errors[:, 1:3], errors[:, 3])
        ]
        scale = np.median([j.scale_sigma for j in answered]) if answered else np.nan
        lines.append(
            f"| {kind} | {len(judged)} | {len(answered)} | {within(judged, 3.0):.1%} | "
            f"{', '.join(f'{o:.0%}' for o in ones)} | {scale:.2%} | {len(judged) - len(answered)} | "
            f"{sum(j.needless for j in judged)} |"
        )
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    began = time.process_time()
    found = run(args.sets, args.seed)
    print(table(found))
    reasons = Counter(
        j.refused.split(":")[0][:70] for of in found.values() for j in of if j.refused
    )
    print("\n".join(f"refused {count} times: {why}" for why, count in reasons.most_common()))
    print(f"{time.process_time() - began:.0f} s of the processor")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

# SPDX-License-Identifier: Apache-2.0
"""Scale, turn and place of a model whose scale is its own, from GPS and angles; those that
contradict do not count."""

from dataclasses import dataclass, replace
from typing import List, Optional, Sequence

import numpy as np

from fcsv_stereo.errors import InputError
from fcsv_stereo.photos import evidence
from fcsv_stereo.photos.evidence import GpsEvidence, Pose
from fcsv_stereo.photos.solving import Fitted, covariance, solve
from fcsv_stereo.photos.starts import about_the_line, starts

FEWEST, MOST_SCALE_SIGMA = 3, 0.3
#: Of a world that is refused: a map is read by what is level, less by where north is.
MOST_LEVEL_SIGMA_RAD, MOST_NORTH_SIGMA_RAD = np.radians(10.0), np.radians(20.0)
# photographs that starts are scored with; starts that are improved
_SCORED, _REFINED, _TURNED = 60, 6, 2
SAME_COST = 9.0  # two answers that differ by less explain the photographs alike
_RIGHT = 0.5  # of a statement's probability
# share of wrong statements, or sine of how far cameras look up, from which mirror images are tried
_DOUBTFUL = 0.3
_MIRRORS = {"longitude": np.array([-1.0, 1.0, 1.0]), "latitude": np.array([1.0, -1.0, 1.0])}


@dataclass(frozen=True)
class Similarity:
    """p_enu = scale * R_enu_model @ p_model + t_enu; residuals (N, 3) m (GPS less model; NaN where
    there is no GPS).

    By photograph, what contradicts the others and has no say: ``outliers`` (its place),
    ``wrong_heights`` (of these, whose height alone is wrong), ``wrong_angles``. ``covariance`` (7,
    7): logarithm of the scale, turn (rad) and shift (m) in east, north, up, at the middle of the
    photographs. ``gps_factor``: how large GPS's errors are against what is said of them;
    ``model_sigma_m``: the model's own error; ``extent_m``: about the median distance of two
    photographs. ``cost``: how badly all agrees, to be compared with that of the same set.
    """

    scale: float
    R_enu_model: np.ndarray
    t_enu: np.ndarray
    residuals_m: np.ndarray
    outliers: np.ndarray
    wrong_heights: np.ndarray
    wrong_angles: np.ndarray
    covariance: np.ndarray
    gps_factor: float
    model_sigma_m: float
    extent_m: float
    cost: float

    @property
    def scale_sigma(self) -> float:
        """A share of the scale."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def level_sigma_rad(self) -> float:
        """About the level axis that is known worst."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[1:3, 1:3])[-1]))

    @property
    def north_sigma_rad(self) -> float:
        """About up."""
        return float(np.sqrt(self.covariance[3, 3]))

    def pose(self, T_model_cam: np.ndarray) -> np.ndarray:
        """T_enu_cam."""
        T = np.eye(4)
        T[:3, :3] = self.R_enu_model @ T_model_cam[:3, :3]
        T[:3, 3] = self.scale * self.R_enu_model @ T_model_cam[:3, 3] + self.t_enu
        return T


class ContradictionError(InputError):
    """Places contradict the model; ``similarity`` is that of the largest part that agrees, with
    whose outliers."""

    def __init__(self, message: str, similarity: Similarity):
        super().__init__(message)
        self.similarity = similarity


def fit(
    p_model: np.ndarray,
    p_enu_m: np.ndarray,
    sigmas_m: np.ndarray,
    R_model_cam: np.ndarray,
    R_enu_cam: Sequence[Optional[np.ndarray]],
    steps_m: Optional[np.ndarray] = None,
) -> Similarity:
    """Fits a similarity from places (N, 3) in both (NaN where there is no GPS), GPS's standard
    deviations (N, 3), and the cameras' rotations (N, 3, 3). ``R_enu_cam`` are the gimbals', None
    where they are not known: then rows are taken to be level. ``steps_m`` (N, 3): in which places
    are written.

    Raises InputError where these contradict each other, or do not fix scale, level and north.
    """
    gimbals = np.array([np.full((3, 3), np.nan) if R is None else R for R in R_enu_cam]).reshape(
        -1, 3, 3
    )
    middle = p_model.mean(axis=0)  # about it scale and turn do not move the places as one
    steps_m = np.zeros_like(sigmas_m) if steps_m is None else steps_m
    e = GpsEvidence(
        p_model - middle, np.array(p_enu_m, float), sigmas_m, steps_m, R_model_cam, gimbals
    )
    _require_spread(e)
    fits = _fits(e)
    found = _similarity(e, fits[0], middle)
    _require_not_mirrored(e, fits[0], found)
    _require_most_places(e, found)
    _require_known(e, found)
    _require_one_answer(fits, found)
    return found


def _require_spread(e: GpsEvidence) -> None:
    placed = int(e.placed.sum())
    if placed < FEWEST:
        raise InputError(
            f"{placed} photographs have both GPS and a pose; scale and turn need {FEWEST}"
        )
    places = e.p_enu_m[e.placed]
    spread_m = float(np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[0])
    if spread_m < 2.0 * float(np.median(np.hypot(e.sigmas_m, e.steps_m)[e.placed])):
        raise InputError(
            f"the photographs were taken within {spread_m:.1f} m, which GPS cannot tell apart"
        )


def _fits(e: GpsEvidence) -> List[Fitted]:
    """Local optima, the best first."""
    rng = np.random.default_rng(0)
    some = _some(e, rng)

    def scored(poses) -> list:
        return sorted(
            ((evidence.agreement(some, p, fine=False)[0], p) for p in poses), key=lambda t: t[0]
        )

    tried = scored(starts(e, rng))
    if not tried:
        raise InputError("all GPS positions are one place, which tells no scale")
    tried += scored(p for start in _distinct(tried, _TURNED) for p in about_the_line(e, start))
    fits = [solve(e, p) for p in _distinct(sorted(tried, key=lambda t: t[0]), _REFINED)]
    return sorted(fits, key=lambda f: f.cost)


def _some(e: GpsEvidence, rng: np.random.Generator) -> GpsEvidence:
    """Few photographs that stand for all, with GPS first."""
    order = rng.permutation(len(e.placed))
    return e.of(order[np.argsort(~e.placed[order], kind="stable")][:_SCORED])


def _distinct(tried, most: int) -> List[Pose]:
    """The best (of costs and poses) that are not alike."""
    kept: List[Pose] = []
    for _, pose in tried:
        if len(kept) < most and all(_apart(pose, k) for k in kept):
            kept.append(pose)
    return kept


def _apart(a: Pose, b: Pose, turn_rad: float = np.radians(8.0), log_scale: float = 0.05) -> bool:
    angle = np.arccos(np.clip((np.trace(a.R @ b.R.T) - 1.0) / 2.0, -1.0, 1.0))
    return bool(angle > turn_rad or abs(np.log(a.scale / b.scale)) > log_scale)


def _require_not_mirrored(e: GpsEvidence, best: Fitted, found: Similarity) -> None:
    """E for W, or N for S, in all photographs: their places are mirrored, and a flat model fits
    them upside down."""
    w, up = best.weights, (best.pose.R @ e.R_model_cam[~e.angled])[:, 2, 2]
    doubtful = any(
        len(of) and (of < _RIGHT).mean() > _DOUBTFUL for of in (w.place, w.angles, w.level)
    )
    if not doubtful and not (len(up) and np.median(up) > _DOUBTFUL):
        return
    costs = {}
    for name, mirror in _MIRRORS.items():
        mirrored = GpsEvidence(
            e.p_model, e.p_enu_m * mirror, e.sigmas_m, e.steps_m, e.R_model_cam, e.R_enu_cam
        )
        costs[name] = _fits(mirrored)[0].cost
    least = min(costs, key=costs.get)
    if costs[least] + SAME_COST < best.cost:
        alike = abs(costs["longitude"] - costs["latitude"]) < SAME_COST
        which = "longitude or of latitude" if alike else least
        or_so = (
            "" if e.angled.any() else ", or all pictures are upside down without EXIF's orientation"
        )
        raise ContradictionError(
            f"GPS's places are the mirror image of the poses: the reference of {which} (GPSLongitudeRef E or W, "
            f"GPSLatitudeRef N or S) is wrong in all photographs{or_so}; correct it (exiftool)",
            replace(found, outliers=np.zeros_like(found.outliers)),
        )


def _require_most_places(e: GpsEvidence, found: Similarity) -> None:
    wrong, of = int(found.outliers.sum()), int(e.placed.sum())
    if of - wrong < FEWEST or 2 * wrong >= of:
        height = (
            f", {int(found.wrong_heights.sum())} of them in height alone"
            if found.wrong_heights.any()
            else ""
        )
        raise ContradictionError(
            f"GPS contradicts the poses: {wrong} of {of} places are elsewhere{height}", found
        )


def _require_known(e: GpsEvidence, found: Similarity) -> None:
    if not found.scale_sigma < MOST_SCALE_SIGMA:
        raise InputError(
            f"GPS does not fix the scale: it is known to {found.scale_sigma:.0%} only; photographs further apart would "
            "fix it"
        )
    level, north = np.degrees([found.level_sigma_rad, found.north_sigma_rad])
    if level > np.degrees(MOST_LEVEL_SIGMA_RAD) or north > np.degrees(MOST_NORTH_SIGMA_RAD):
        raise InputError(
            f"neither GPS nor the pictures tell how the model is turned: level is known to {level:.0f} degrees, north "
            f"to {north:.0f}{_line(e)}; gimbal angles, or photographs beside that line, would fix it"
        )


def _line(e: GpsEvidence) -> str:
    spread = np.linalg.svd(e.p_model - np.median(e.p_model, axis=0), compute_uv=False)
    return ", because the photographs lie on a line" if spread[1] < 0.2 * spread[0] else ""


def _require_one_answer(fits: List[Fitted], found: Similarity) -> None:
    """Raises where another answer, well away, explains the photographs as well."""
    bounds = 4.0 * max(found.level_sigma_rad, found.north_sigma_rad), 4.0 * found.scale_sigma
    for other in fits[1:]:
        if other.cost < fits[0].cost + SAME_COST and _apart(other.pose, fits[0].pose, *bounds):
            raise InputError(
                "GPS and angles agree with two answers alike: "
                f"{_sentence(fits[0])} or {_sentence(other)}; more photographs with right GPS would decide"
            )


def _sentence(f: Fitted) -> str:
    wrong = int((f.weights.height < _RIGHT).sum() + (f.weights.angles < _RIGHT).sum())
    return f"{f.pose.scale:.4g} m per unit with {wrong} places or angles wrong"


def _similarity(e: GpsEvidence, best: Fitted, middle: np.ndarray) -> Similarity:
    pose = best.pose
    residuals, outliers, heights, angles = _by_photograph(e, best)
    return Similarity(
        pose.scale,
        pose.R,
        pose.t - pose.scale * pose.R @ middle,
        residuals,
        outliers,
        heights,
        angles,
        covariance(e, best),
        best.noise.gps,
        best.noise.model_m,
        pose.scale * e.extent,
        best.cost,
    )


def _by_photograph(e: GpsEvidence, best: Fitted):
    residuals, wrong = np.full(e.p_model.shape, np.nan), np.zeros((3, len(e.p_model)), bool)
    residuals[e.placed] = evidence.away_m(e, best.pose)
    wrong[0, e.placed] = best.weights.height < _RIGHT
    wrong[1, e.placed] = (best.weights.height < _RIGHT) & (best.weights.place >= _RIGHT)
    wrong[2, e.angled] = best.weights.angles < _RIGHT
    return (residuals, *wrong)

# SPDX-License-Identifier: Apache-2.0
"""The pose of a body from the tags on its sides: all corners of all tags in one adjustment, and
what it leaves open.

A tag's corners say how well it is seen, so one adjustment over all corners is the fusion with
covariances that poses of single tags would need: a tag seen obliquely gives the rotation, a near
one the distance. Tags do not sit quite where they should: half a millimetre between two of them, 9
cm apart, would be two centimetres of distance at 3.5 m. Each tag's corners are therefore weighed
with what its own place leaves open. Each tag has two planar poses that nearly mirror each other
(IPPE): every one of them is a start, and where two ends fit alike it is said.
"""

from dataclasses import dataclass, fields
from typing import List, Mapping, Optional, Sequence, Tuple

import numpy as np
from scipy.optimize import least_squares

from fcsv_geometry import rotations, transforms
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.config import BodyTag
from fcsv_tracking.tags import TagObservation, corner_points

#: The counter of a picture whose attitude alone is not known.
AMBIGUOUS = "ambiguous"

_SAME_RAD = np.radians(3.0)  # solutions nearer than this are one
_ROUNDS, _DONE = 5, 1e-7


@dataclass(frozen=True)
class PoseRules:
    """``corner_px`` is the standard deviation of the corners of a tag seen face on in a sharp
    picture; it grows as one over the cosine of the angle. ``tag_m`` and ``tag_deg``: how a tag sits
    on its body other than told."""

    corner_px: float = 0.042
    # of the way that it moved in the picture while the shutter was open, likewise
    blur_share: float = 0.012
    tag_m: float = 0.0005
    tag_deg: float = 0.3
    # a second pose that fits worse by less than this (squared sigmas) may be the true one
    ambiguous: float = 25.0
    prior_deg: float = 20.0  # the true one is so near to the last known attitude, the other is not
    # cosine to a tag's face; seen more flatly its corners are off by a pixel
    flattest: float = 0.28
    # standard deviations above what noise does: tags that contradict each other
    misfit: float = 8.0

    def __post_init__(self):
        for f in fields(self):
            if not getattr(self, f.name) > 0:
                raise ValueError(f"{f.name}: {getattr(self, f.name)} must be positive")


@dataclass(frozen=True)
class Upright:
    """A body that stands: its z points up but for ``sigma_rad`` about each horizontal axis;
    R_level_cam (3,3) turns the camera's axes into level ones."""

    R_level_cam: np.ndarray
    sigma_rad: float


@dataclass(frozen=True)
class BodySight:
    """T_cam_body; covariance (6,6) of position (m) and small rotation (rad) about the camera's
    axes."""

    T_cam_body: np.ndarray
    covariance: np.ndarray
    rms_px: float
    tags: Tuple[int, ...]


@dataclass(frozen=True)
class PoseFit:
    """T_cam_body that fits the corners, ``cost``: squared residuals in standard deviations, ``rms``:
    normalised; covariance as BodySight has it."""

    T: np.ndarray
    cost: float
    covariance: np.ndarray
    rms: float


class _TagModel:
    """Corners of every tag seen, and what is known of them; units are those of the normalised
    picture."""

    def __init__(
        self,
        own: Sequence[TagObservation],
        tags: Mapping[int, BodyTag],
        sigmas,
        rules: PoseRules,
        upright: Optional[Upright] = None,
    ):
        self.image = np.stack([o.corners_normalized for o in own])  # (K, 4, 2)
        T_body_tag = np.stack([tags[o.id].T_body_tag for o in own])
        corners = np.stack([corner_points(o.size_m) for o in own])
        # about each tag's centre, body axes
        self.arms = np.einsum("kij,knj->kni", T_body_tag[:, :3, :3], corners)
        self.points = self.arms + T_body_tag[:, None, :3, 3]
        self._variances = np.square(sigmas)  # (K,)
        self._place = np.array([rules.tag_m**2] * 3 + [np.radians(rules.tag_deg) ** 2] * 3)
        self._upright = upright

    def fit(self, T: np.ndarray) -> Optional[PoseFit]:
        """Fits a pose from a start, in rounds as the weights depend on the pose.

        None where that runs away, as from a mirrored pose of a distant tag it may.
        """
        try:
            for _ in range(_ROUNDS):
                T_before, T = T, self._round(T)
                if np.abs(T - T_before).max() < _DONE:
                    break
            W, r = self._whitening(T), self._residuals(T)
            J, cost = self._white_jacobian(W, T), float((self._white_residuals(W, T) ** 2).sum())
            rms = float(np.sqrt((r**2).sum() / (4 * len(r))))
            return PoseFit(T, cost, np.linalg.inv(J.T @ J), rms) if np.isfinite(cost) else None
        # the latter is scipy's for residuals that are not finite
        except (np.linalg.LinAlgError, ValueError):
            return None

    def _round(self, T: np.ndarray) -> np.ndarray:
        """The best pose with the weights of T."""
        W = self._whitening(T)
        found = least_squares(
            lambda d: self._white_residuals(W, _moved(T, d)),
            np.zeros(6),
            jac=lambda d: self._white_jacobian(W, _moved(T, d)),
            method="lm",
            max_nfev=20,
        )
        return _moved(T, found.x)

    def _white_residuals(self, W: np.ndarray, T: np.ndarray) -> np.ndarray:
        """(8 K,) in standard deviations, and two of how the body leans where it stands upright."""
        corners, upright = (W @ self._residuals(T)[..., None]).ravel(), self._upright
        if upright is None:
            return corners
        leans = (upright.R_level_cam @ T[:3, 2])[:2] / upright.sigma_rad
        return np.concatenate([corners, leans])

    def _white_jacobian(self, W: np.ndarray, T: np.ndarray) -> np.ndarray:
        J, upright = (W @ self._jacobian(T)).reshape(-1, 6), self._upright
        if upright is None:
            return J
        leans = -(upright.R_level_cam @ rotations.skew(T[:3, 2]))[:2] / upright.sigma_rad
        return np.concatenate([J, np.hstack([np.zeros((2, 3)), leans])])

    def _residuals(self, T: np.ndarray) -> np.ndarray:
        """(K, 8) corners as predicted less as seen, in the normalised picture."""
        p = transforms.apply(T, self.points)
        return (p[..., :2] / p[..., 2:] - self.image).reshape(-1, 8)

    def _jacobian(self, T: np.ndarray) -> np.ndarray:
        """(K, 8, 6) of the residuals to _moved()'s displacement."""
        return projection_jacobian(T, self.points.reshape(-1, 3)).reshape(-1, 8, 6)

    def _whitening(self, T: np.ndarray) -> np.ndarray:
        """(K, 8, 8) W with W'W the inverse covariance of each tag's corners: their own, its place's
        as seen at T."""
        B = projection_jacobian(T, self.points.reshape(-1, 3), self.arms.reshape(-1, 3)).reshape(
            -1, 8, 6
        )
        S = self._variances[:, None, None] * np.eye(8) + (B * self._place) @ B.transpose(0, 2, 1)
        return np.linalg.inv(np.linalg.cholesky(S))


def _moved(T: np.ndarray, d: np.ndarray) -> np.ndarray:
    """T after a displacement (m) and a rotation (rad) about the camera's axes."""
    return transforms.transform(rotations.exp(d[3:]) @ T[:3, :3], T[:3, 3] + d[:3])


def locate_body(
    observations: Sequence[TagObservation],
    tags: Mapping[int, BodyTag],
    focal_px: float,
    rules: PoseRules,
    R_cam_body_prior: Optional[np.ndarray] = None,
    blur_px: float = 0.0,
) -> BodySight:
    """The body's pose from its tags in one picture. Raises SampleRejected where there is none to be
    trusted."""
    fits, own = body_poses(observations, tags, focal_px, rules, blur_px)
    best = _chosen(fits, rules, R_cam_body_prior)
    return BodySight(best.T, best.covariance, best.rms * focal_px, own)


def body_poses(
    observations: Sequence[TagObservation],
    tags: Mapping[int, BodyTag],
    focal_px: float,
    rules: PoseRules,
    blur_px: float = 0.0,
    upright: Optional[Upright] = None,
) -> Tuple[List[PoseFit], Tuple[int, ...]]:
    """Distinct poses that the body's tags in one picture leave, best first, and the tags' ids. Raises
    SampleRejected where there is none."""
    own = [o for o in observations if o.id in tags]
    if not own:
        raise SampleRejected("no tag", "no tag of the body in the picture")
    facing = np.array([_facing(o) for o in own])
    clear = facing >= rules.flattest
    if clear.any():
        own, facing = [o for o, is_clear in zip(own, clear) if is_clear], facing[clear]
    sharp_px = rules.corner_px / np.maximum(facing, rules.flattest)
    sigmas = np.hypot(sharp_px, rules.blur_share * blur_px) / focal_px
    model = _TagModel(own, tags, sigmas, rules, upright)
    fits = _fits(model, own, tags)
    free = 8 * len(own) - 6
    if fits[0].cost > free + rules.misfit * np.sqrt(2.0 * free):
        raise SampleRejected(
            "tags contradict each other",
            f"tags {[o.id for o in own]} fit no pose: off by {fits[0].rms * focal_px:.1f} px; "
            "are they where the file says?",
        )
    return fits, tuple(o.id for o in own)


def _facing(o: TagObservation) -> float:
    """How a tag is seen: one face on, nought edge on; the cosine of the angle between, but for the
    perspective.

    Ratio of the singular values of the map from the tag's plane to the picture.
    """
    a, b, c, d = o.corners_normalized
    values = np.linalg.svd(np.stack([b - a + c - d, d - a + c - b]), compute_uv=False)
    return float(values[1] / values[0])


def _fits(
    model: _TagModel, own: Sequence[TagObservation], tags: Mapping[int, BodyTag]
) -> List[PoseFit]:
    """Distinct poses, best first."""
    found: List[Optional[PoseFit]] = []
    for o in own:
        T_tag_body = transforms.invert(tags[o.id].T_body_tag)
        found += [
            model.fit(T @ T_tag_body) for T in (o.T_cam_tag, o.T_cam_tag_other) if T is not None
        ]
    distinct: List[PoseFit] = []
    for fit in sorted((f for f in found if f is not None), key=lambda f: f.cost):
        if fit.T[2, 3] > 0 and all(
            transforms.rotation_angle(fit.T, other.T) > _SAME_RAD for other in distinct
        ):
            distinct.append(fit)
    if not distinct:
        raise SampleRejected("no pose", "the tags' corners fit no pose in front of the camera")
    return distinct


def _chosen(fits: List[PoseFit], rules: PoseRules, prior: Optional[np.ndarray]) -> PoseFit:
    """The best one; where another fits as well, the one near the last known attitude, or none."""
    alike = [f for f in fits if f.cost - fits[0].cost < rules.ambiguous]
    if len(alike) == 1:
        return fits[0]
    near = [f for f in alike if prior is not None and _angle_deg(f.T, prior) < rules.prior_deg]
    if len(near) != 1:
        raise SampleRejected(
            AMBIGUOUS, "two mirrored poses fit alike, and the last attitude does not decide"
        )
    return near[0]


def _angle_deg(T: np.ndarray, R: np.ndarray) -> float:
    return float(np.degrees(transforms.rotation_angle(T[:3, :3], R)))


def projection_jacobian(
    T: np.ndarray, points: np.ndarray, arms: Optional[np.ndarray] = None
) -> np.ndarray:
    """(2N, 6) of normalised corners with respect to (d, w).

    Without ``arms``: position + d and rotation exp(w) R of the body, camera's axes. With arms
    (N,3): the points are moved by d and turned by w about the place that the arms lead from, body's
    axes.
    """
    R = T[:3, :3]
    x, y, z = transforms.apply(T, points).T
    zero = np.zeros_like(x)
    by_point = np.stack(
        [np.stack([1 / z, zero, -x / z / z], -1), np.stack([zero, 1 / z, -y / z / z], -1)], 1
    )
    a, b, c = (points @ R.T if arms is None else arms).T
    turned = np.stack(
        [np.stack([zero, c, -b], -1), np.stack([-c, zero, a], -1), np.stack([b, -a, zero], -1)], 1
    )
    if arms is not None:
        by_point = by_point @ R
    return np.concatenate([by_point, by_point @ turned], axis=2).reshape(-1, 6)

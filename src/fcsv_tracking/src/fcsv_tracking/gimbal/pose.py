# SPDX-License-Identifier: Apache-2.0
"""The pose of a body from the tags on its sides: all corners of all tags in one adjustment, and what it leaves open.

A tag's corners say how well it is seen, so one adjustment over all corners is the fusion with covariances that poses of
single tags would need: a tag seen obliquely gives the rotation, a near one the distance. Each tag has two planar poses
that nearly mirror each other (IPPE): every one of them is a start, and where two ends fit alike it is said.
"""

from dataclasses import dataclass, fields
from typing import List, Mapping, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.config import BodyTag
from fcsv_tracking.tags import TagObservation, corner_points

_SAME_RAD = np.radians(3.0)  # solutions nearer than this are one


@dataclass(frozen=True)
class PoseRules:
    """``corner_px`` is a corner's standard deviation in a sharp picture, ``tag_m`` and ``tag_deg`` how a tag sits on
    its body other than told."""

    corner_px: float = 0.12
    tag_m: float = 0.0005
    tag_deg: float = 0.3
    blur_share: float = 0.06  # of the way that it moved in the picture while the shutter was open, likewise
    ambiguous: float = 12.0  # a second pose that fits worse by less than this (squared sigmas) may be the true one
    prior_deg: float = 20.0  # the true one is so near to the last known attitude, the other is not
    most_rms_px: float = 1.5  # of all corners: tags that contradict each other, or another body's

    def __post_init__(self):
        for f in fields(self):
            if not getattr(self, f.name) > 0:
                raise ValueError(f"{f.name}: {getattr(self, f.name)} must be positive")


@dataclass(frozen=True)
class BodySight:
    """T_cam_body; covariance (6,6) of position (m) and small rotation (rad) about the camera's axes."""

    T_cam_body: np.ndarray
    covariance: np.ndarray
    rms_px: float
    tags: Tuple[int, ...]


def see_body(
    observations: Sequence[TagObservation],
    tags: Mapping[int, BodyTag],
    focal_px: float,
    rules: PoseRules,
    R_cam_body_prior: Optional[np.ndarray] = None,
    blur_px: float = 0.0,
) -> BodySight:
    """The body's pose from its tags in one picture. Raises SampleRejected where there is none to be trusted."""
    corner_px = float(np.hypot(rules.corner_px, rules.blur_share * blur_px))
    own = [o for o in observations if o.id in tags]
    if not own:
        raise SampleRejected("no tag", "no tag of the body in the picture")
    points = np.concatenate([transforms.apply(tags[o.id].T_body_tag, corner_points(o.size_m)) for o in own])
    image = np.concatenate([o.corners_normalized for o in own])
    solutions = _solutions(own, tags, points, image)
    if solutions[0][1] * focal_px > rules.most_rms_px:
        raise SampleRejected(
            "tags contradict each other",
            f"tags {[o.id for o in own]} fit no pose: off by {solutions[0][1] * focal_px:.1f} px; "
            "are they where the file says?",
        )
    T, rms = _chosen(solutions, focal_px, len(points), corner_px, rules, R_cam_body_prior)
    return BodySight(
        T, _covariance(T, points, focal_px / corner_px, len(own), rules), rms * focal_px, tuple(o.id for o in own)
    )


def _solutions(own, tags, points: np.ndarray, image: np.ndarray) -> List[Tuple[np.ndarray, float]]:
    """Distinct T_cam_body and rms (normalised) of all corners, best first."""
    found: List[Tuple[np.ndarray, float]] = []
    for o in own:
        T_tag_body = transforms.invert(tags[o.id].T_body_tag)
        for T_cam_tag in (o.T_cam_tag, o.T_cam_tag_other):
            if T_cam_tag is not None:
                found.append(_refined(T_cam_tag @ T_tag_body, points, image))
    found.sort(key=lambda s: s[1])
    distinct: List[Tuple[np.ndarray, float]] = []
    for T, rms in found:
        if T[2, 3] > 0 and all(transforms.rotation_angle(T, other) > _SAME_RAD for other, _ in distinct):
            distinct.append((T, rms))
    if not distinct:
        raise SampleRejected("no pose", "the tags' corners fit no pose in front of the camera")
    return distinct


def _refined(T: np.ndarray, points: np.ndarray, image: np.ndarray) -> Tuple[np.ndarray, float]:
    rvec, tvec = cv2.Rodrigues(T[:3, :3])[0], T[:3, 3].reshape(3, 1).copy()
    rvec, tvec = cv2.solvePnPRefineLM(points, image.reshape(-1, 1, 2), np.eye(3), None, rvec, tvec)
    T = transforms.transform(cv2.Rodrigues(rvec)[0], tvec.ravel())
    p = transforms.apply(T, points)
    return T, float(np.sqrt(np.mean(np.sum((p[:, :2] / p[:, 2:] - image) ** 2, axis=1))))


def _chosen(
    solutions, focal_px: float, corners: int, corner_px: float, rules: PoseRules, prior
) -> Tuple[np.ndarray, float]:
    """The best one; where another fits as well, the one near the last known attitude, or none."""
    # squared residuals in sigmas; a picture that fits worse than its corners' noise says less of either
    best_px = solutions[0][1] * focal_px
    scale = corners / max(corner_px**2, 0.5 * best_px**2)
    alike = [s for s in solutions if ((s[1] * focal_px) ** 2 - best_px**2) * scale < rules.ambiguous]
    if len(alike) == 1:
        return solutions[0]
    near = [s for s in alike if prior is not None and _angle_deg(s[0], prior) < rules.prior_deg]
    if len(near) != 1:
        raise SampleRejected(
            "ambiguous", "two mirrored poses fit the tags alike, and the last attitude does not decide"
        )
    return near[0]


def _angle_deg(T: np.ndarray, R: np.ndarray) -> float:
    return float(np.degrees(transforms.rotation_angle(T[:3, :3], R)))


def projection_jacobian(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(2N, 6) of normalised corners with respect to (d, w): position + d, rotation exp(w) R."""
    arm = points @ T[:3, :3].T
    x, y, z = (arm + T[:3, 3]).T
    zero = np.zeros_like(x)
    by_point = np.stack(
        [np.stack([1 / z, zero, -x / z**2], -1), np.stack([zero, 1 / z, -y / z**2], -1)], 1
    )  # (N, 2, 3)
    a, b, c = arm.T
    minus_cross = -np.stack(
        [np.stack([zero, -c, b], -1), np.stack([c, zero, -a], -1), np.stack([-b, a, zero], -1)], 1
    )  # w x arm = -[arm]x w
    return np.concatenate([by_point, by_point @ minus_cross], axis=2).reshape(-1, 6)


def _covariance(T: np.ndarray, points: np.ndarray, sigmas: float, tags: int, rules: PoseRules) -> np.ndarray:
    J = sigmas * projection_jacobian(T, points)
    covariance = np.linalg.inv(J.T @ J)
    covariance[:3, :3] += rules.tag_m**2 / tags * np.eye(3)
    covariance[3:, 3:] += np.radians(rules.tag_deg) ** 2 / tags * np.eye(3)
    return covariance

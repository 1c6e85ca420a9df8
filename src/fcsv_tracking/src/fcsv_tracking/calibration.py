# SPDX-License-Identifier: Apache-2.0
"""Where one vehicle's odometry began, seen from another's (thesis 6.1), from many tag detections.

The printed equation 6.1 adds T_A and T_D(n-1) in one frame although they live in two, and drops the rotation
of the camera on the body. In our notation, vehicle n (child) seeing the tag of m = n-1 (parent):

    T_On_Om = T_On_Dn T_Dn_Cn T_Cn_Am inv(T_Dm_Am) inv(T_Om_Dm)

Both odometry frames are level, so four of its six degrees of freedom are free. All detections are adjusted
together on the corners' reprojection: a tag that is 27 px wide says little about its yaw when it is seen
square-on, but a tag that moves sideways by a metre says it well.
"""

from dataclasses import dataclass
from typing import List, Sequence

import numpy as np
from scipy.optimize import least_squares

from fcsv_geometry import transforms
from fcsv_tracking.errors import CalibrationRefused
from fcsv_tracking.tags import corner_points, planar_poses


@dataclass(frozen=True)
class CalibrationRules:
    """What is good enough; see the messages of CalibrationRefused."""

    duration_s: float = 8.0
    least_detections: int = 20
    corner_noise_px: float = 0.25
    attitude_noise_deg: float = 0.06  # of camera against odometry, per detection
    outlier_sigmas: float = 4.0
    most_yaw_std_deg: float = 0.4
    most_position_std_m: float = 0.05
    most_distance_m: float = 8.0
    most_speed_mps: float = 1.5

    def __post_init__(self):
        for name, value in vars(self).items():
            if not value > 0:
                raise ValueError(f"{name}: {value} must be positive")


@dataclass(frozen=True)
class Detection:
    """One picture of the child's camera with the parent's tag.

    ``T_odom_cam`` is the child's camera in its odometry frame, ``T_odom_tag`` the parent's tag in the parent's, both
    at ``stamp_s``; corners (4,2) undistorted x/z, y/z in the detector's order.
    """

    stamp_s: float
    corners_normalized: np.ndarray
    size_m: float
    focal_px: float
    T_odom_cam: np.ndarray
    T_odom_tag: np.ndarray


@dataclass(frozen=True)
class Link:
    """T_parent_child between two level odometry frames; covariance 4x4 of x, y, z (m), yaw (rad)."""

    parent: str
    child: str
    T_parent_child: np.ndarray
    covariance: np.ndarray
    position_spread_m: float
    yaw_spread_rad: float
    reprojection_rms_px: float
    used: int
    rejected: int


def calibrate_link(
    parent: str, child: str, detections: Sequence[Detection], rules: CalibrationRules = CalibrationRules()
) -> Link:
    """The link from all detections of one pair. Raises CalibrationRefused with the reason and what to do."""
    _require_enough(parent, child, detections, rules)
    x = _initial(detections)
    used = np.ones(len(detections), bool)
    for _ in range(3):  # solve, drop what does not fit, solve again
        chosen = [d for d, u in zip(detections, used) if u]
        _require_enough(parent, child, chosen, rules)
        solution = least_squares(_residuals, x, args=(chosen, rules), loss="soft_l1", x_scale=[1, 1, 1, 0.1])
        x = solution.x
        norms = np.sqrt(np.mean(_residuals(x, detections, rules).reshape(len(detections), -1) ** 2, axis=1))
        keep = norms < rules.outlier_sigmas * max(1.0, float(np.median(norms[used])))
        if (keep == used).all():
            break
        used = keep
    chosen = [d for d, u in zip(detections, used) if u]
    covariance = _covariance(solution, len(chosen))
    _require_tight(parent, child, x, covariance, chosen, rules)
    position_spread_m, yaw_spread_rad = _spread(x, chosen)
    return Link(
        parent, child, transforms.from_xyz_yaw(x[:3], x[3]), covariance, position_spread_m, yaw_spread_rad,
        _rms_px(x, chosen), len(chosen), int(len(detections) - len(chosen)),
    )  # fmt: skip


def single_link(detection: Detection, T_cam_tag: np.ndarray) -> np.ndarray:
    """T_parent_child by equation 6.1 (corrected) from one detection's tag pose; six degrees of freedom."""
    return detection.T_odom_tag @ transforms.invert(T_cam_tag) @ transforms.invert(detection.T_odom_cam)


def _level_candidates(detection: Detection) -> List[np.ndarray]:
    """Four-degree-of-freedom links of the planar solutions: the tag's place fixes position once yaw is chosen."""
    candidates = []
    for T_cam_tag, _ in planar_poses(detection.corners_normalized, detection.size_m):
        yaw = transforms.yaw(single_link(detection, T_cam_tag))
        R = transforms.from_xyz_yaw([0, 0, 0], yaw)
        p_child_tag = transforms.apply(detection.T_odom_cam, T_cam_tag[:3, 3])
        p = detection.T_odom_tag[:3, 3] - transforms.apply(R, p_child_tag)
        candidates.append(np.array([*p, yaw]))
    return candidates


def _initial(detections: Sequence[Detection]) -> np.ndarray:
    """The single-detection solution that most others agree with: survives flipped normals."""
    some = detections[:: max(1, len(detections) // 25)]
    candidates = [c for d in some for c in _level_candidates(d)]
    rules = CalibrationRules()
    costs = [np.median(np.abs(_residuals(c, detections, rules))) for c in candidates]
    return candidates[int(np.argmin(costs))]


def _predicted(x: np.ndarray, detections: Sequence[Detection]) -> np.ndarray:
    """Normalised corners (N,4,2) that a link x, y, z, yaw predicts."""
    T_child_parent = transforms.invert(transforms.from_xyz_yaw(x[:3], x[3]))
    T_cam_tag = np.stack([transforms.invert(d.T_odom_cam) @ T_child_parent @ d.T_odom_tag for d in detections])
    points = np.stack([corner_points(d.size_m) for d in detections])
    p_cam = np.einsum("nij,nkj->nki", T_cam_tag[:, :3, :3], points) + T_cam_tag[:, None, :3, 3]
    depth = np.maximum(p_cam[..., 2:], 0.05)  # behind the camera: a large residual, not a division by zero
    return p_cam[..., :2] / depth


def _residuals(x: np.ndarray, detections: Sequence[Detection], rules: CalibrationRules) -> np.ndarray:
    """Whitened: the mean of the corners carries the attitude noise, their shape the detector's alone."""
    error = _predicted(x, detections) - np.stack([d.corners_normalized for d in detections])
    f = np.array([d.focal_px for d in detections])[:, None, None]
    mean = error.mean(axis=1, keepdims=True)
    shape_sigma = rules.corner_noise_px / f
    mean_sigma = np.sqrt((rules.corner_noise_px / f) ** 2 / 4.0 + np.radians(rules.attitude_noise_deg) ** 2)
    return np.concatenate([(error - mean) / shape_sigma, mean / mean_sigma], axis=1).ravel()


def _covariance(solution, detections: int) -> np.ndarray:
    """From the Jacobian, scaled up (never down) where residuals are larger than assumed."""
    information = solution.jac.T @ solution.jac
    scale = max(1.0, 2.0 * solution.cost / max(1, 10 * detections - 4))
    return np.linalg.pinv(information) * scale


def _spread(x: np.ndarray, detections: Sequence[Detection]):
    """rms distance of the tag seen from the tag predicted (m), and of single yaws about the result (rad)."""
    T_parent_child = transforms.from_xyz_yaw(x[:3], x[3])
    misses, turns = [], []
    for d in detections:
        T_cam_tag, _ = planar_poses(d.corners_normalized, d.size_m)[0]
        seen = transforms.apply(T_parent_child @ d.T_odom_cam, T_cam_tag[:3, 3])
        misses.append(np.linalg.norm(seen - d.T_odom_tag[:3, 3]))
        turns.append(min(abs(np.angle(np.exp(1j * (c[3] - x[3])))) for c in _level_candidates(d)))
    return float(np.sqrt(np.mean(np.square(misses)))), float(np.sqrt(np.mean(np.square(turns))))


def _rms_px(x, detections) -> float:
    error = _predicted(x, detections) - np.stack([d.corners_normalized for d in detections])
    f = np.array([d.focal_px for d in detections])[:, None, None]
    return float(np.sqrt(np.mean(np.sum((error * f) ** 2, axis=-1))))


def _require_enough(parent, child, detections, rules) -> None:
    pair = f"{child} sees {parent}'s tag"
    if len(detections) < rules.least_detections:
        raise CalibrationRefused(
            f"{pair} in {len(detections)} usable pictures, {rules.least_detections} are needed: "
            f"line {child} up 3 to 4 m behind {parent}, at its height, and calibrate again"
        )
    distances = [float(np.median(d.focal_px * d.size_m / _width_px(d))) for d in detections]
    if np.median(distances) > rules.most_distance_m:
        raise CalibrationRefused(
            f"{pair} from {np.median(distances):.1f} m, at most {rules.most_distance_m:.0f}: come nearer"
        )
    ordered = sorted(detections, key=lambda d: d.stamp_s)
    for a, b in zip(ordered, ordered[1:]):
        dt_s = b.stamp_s - a.stamp_s
        for T_a, T_b in ((a.T_odom_cam, b.T_odom_cam), (a.T_odom_tag, b.T_odom_tag)):
            if 0.02 < dt_s < 0.5 and np.linalg.norm(T_b[:3, 3] - T_a[:3, 3]) / dt_s > rules.most_speed_mps:
                raise CalibrationRefused(
                    f"{parent} or {child} moves faster than {rules.most_speed_mps} m/s: fly slower"
                )


def _width_px(d: Detection) -> float:
    edges = np.linalg.norm(d.corners_normalized - np.roll(d.corners_normalized, 1, axis=0), axis=1)
    return float(np.max(edges) * d.focal_px)


def position_std(link_covariance: np.ndarray, T_parent_child: np.ndarray, p_child_m: np.ndarray) -> float:
    """Standard deviation (m) of a point of the child's frame in the parent's: grows with the lever arm of the yaw."""
    p = T_parent_child[:3, :3] @ p_child_m
    J = np.column_stack([np.eye(3), [-p[1], p[0], 0.0]])
    return float(np.sqrt(np.trace(J @ link_covariance @ J.T)))


def _require_tight(parent, child, x, covariance, detections, rules) -> None:
    yaw_deg = float(np.degrees(np.sqrt(covariance[3, 3])))
    if yaw_deg > rules.most_yaw_std_deg:
        raise CalibrationRefused(
            f"yaw between {parent} and {child} is only known to {yaw_deg:.2f} deg (bound {rules.most_yaw_std_deg}): "
            f"sway {parent} a metre sideways while calibrating"
        )
    p_child = np.mean([d.T_odom_cam[:3, 3] for d in detections], axis=0)
    std_m = position_std(covariance, transforms.from_xyz_yaw(x[:3], x[3]), p_child)
    if std_m > rules.most_position_std_m:
        raise CalibrationRefused(
            f"position of {child} against {parent} is only known to {std_m:.3f} m (bound {rules.most_position_std_m}): "
            f"come nearer and calibrate again"
        )

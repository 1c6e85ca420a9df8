# SPDX-License-Identifier: Apache-2.0
"""Where one vehicle's odometry began, seen from another's (thesis 6.1), from many tag detections.

The printed equation 6.1 adds T_A and T_D(n-1) in one frame although they live in two, and drops the
rotation of the camera on the body. In our notation, vehicle n (child) seeing the tag of m = n-1
(parent):

    T_Om_On = T_Om_Dm T_Dm_Am inv(T_Cn_Am) inv(T_Dn_Cn) inv(T_On_Dn)

Both odometry frames are level, so four of its six degrees of freedom are free. All detections are
adjusted together on the corners' reprojection (link_solver): a tag that is 27 px wide says little
about its yaw when it is seen square-on, but a tag that moves sideways by a metre says it well.
"""

from dataclasses import dataclass
from typing import Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.home import OdomLink
from fcsv_geometry.vehicles.thresholds import CLOCK_S
from fcsv_tracking.column.detection import Detection
from fcsv_tracking.column.link_model import LinkNoise
from fcsv_tracking.column.link_solver import LinkSolution, solve_link
from fcsv_tracking.errors import CalibrationRefused


@dataclass(frozen=True)
class CalibrationRules(LinkNoise):
    """What is good enough (see the messages of CalibrationRefused), beside the noise that is
    assumed."""

    duration_s: float = 8.0
    # where detections come in slowly, as from a camera or a computer that is slow
    longest_s: float = 40.0
    least_detections: int = 20
    most_yaw_std_deg: float = 0.4
    most_position_std_m: float = 0.05
    most_distance_m: float = 8.0
    most_speed_mps: float = 1.5
    most_oblique_deg: float = 55.0  # between the tag's normal and the line of sight
    most_clock_offset_s: float = CLOCK_S.calibration.red  # between two machines


@dataclass(frozen=True)
class Link(OdomLink):
    """A link with how well its detections agree."""

    position_spread_m: float
    yaw_spread_rad: float
    reprojection_rms_px: float
    used: int
    rejected: int


def calibrate_link(
    parent: str,
    child: str,
    detections: Sequence[Detection],
    rules: CalibrationRules = CalibrationRules(),
) -> Link:
    """The link at the last detection, from all of one pair.

    Raises CalibrationRefused with the reason and what to do.
    """
    ordered = sorted(detections, key=lambda d: d.stamp_s)
    _require_enough(parent, child, ordered, rules)
    _require_near(parent, child, ordered, rules)
    _require_slow(parent, child, ordered, rules)
    try:
        solution = solve_link(ordered, rules)
    except CalibrationRefused as error:
        raise CalibrationRefused(
            f"{child} sees {parent}'s tag, but {error}: check the tag's size and the camera's calibration, "
            f"and calibrate again with nobody touching the vehicles"
        ) from error
    used = [d for d, u in zip(ordered, solution.used) if u]
    _require_enough(parent, child, used, rules)
    _require_facing(parent, child, used, solution, rules)
    _require_tight(parent, child, solution, used[-1], rules)
    return Link(
        parent,
        child,
        solution.T_Op_Oc,
        solution.covariance,
        solution.position_spread_m,
        solution.yaw_spread_rad,
        solution.reprojection_rms_px,
        len(used),
        len(ordered) - len(used),
    )


def _require_enough(
    parent: str, child: str, detections: Sequence[Detection], rules: CalibrationRules
) -> None:
    if not detections:
        raise CalibrationRefused(
            f"{child} does not see {parent}'s tag: line {child} up 3 to 4 m behind {parent}, at its height, and check "
            f"that the tag has the id and family of {parent}'s file and is not covered"
        )
    if len(detections) < rules.least_detections:
        raise CalibrationRefused(
            f"{child} sees {parent}'s tag in {len(detections)} usable pictures, {rules.least_detections} are needed: "
            f"line {child} up 3 to 4 m behind {parent}, at its height, and calibrate again"
        )


def _require_near(
    parent: str, child: str, detections: Sequence[Detection], rules: CalibrationRules
) -> None:
    distance_m = float(np.median([d.focal_px * d.size_m / d.edge_px for d in detections]))
    if distance_m > rules.most_distance_m:
        raise CalibrationRefused(
            f"{child} sees {parent}'s tag from {distance_m:.1f} m, at most {rules.most_distance_m:.0f}: come nearer"
        )


def _require_slow(
    parent: str, child: str, ordered: Sequence[Detection], rules: CalibrationRules
) -> None:
    for a, b in zip(ordered, ordered[1:]):
        dt_s = b.stamp_s - a.stamp_s
        for T_a, T_b in ((a.T_odom_cam, b.T_odom_cam), (a.T_odom_tag, b.T_odom_tag)):
            if (
                0.02 < dt_s < 0.5
                and np.linalg.norm(T_b[:3, 3] - T_a[:3, 3]) / dt_s > rules.most_speed_mps
            ):
                raise CalibrationRefused(
                    f"{parent} or {child} moves faster than {rules.most_speed_mps} m/s: fly slower"
                )


def _require_facing(
    parent: str,
    child: str,
    used: Sequence[Detection],
    solution: LinkSolution,
    rules: CalibrationRules,
) -> None:
    """Checks, by the joint solution: a single detection's normal may be the mirrored one."""
    angles_deg = []
    for d in used:
        T_cam_tag = (
            transforms.invert(d.T_odom_cam) @ transforms.invert(solution.T_Op_Oc) @ d.T_odom_tag
        )
        p = T_cam_tag[:3, 3]
        angles_deg.append(
            np.degrees(np.arccos(np.clip(T_cam_tag[:3, 2] @ p / np.linalg.norm(p), -1.0, 1.0)))
        )
    angle_deg = float(np.median(angles_deg))
    if angle_deg > rules.most_oblique_deg:
        raise CalibrationRefused(
            f"{child} sees {parent}'s tag at {angle_deg:.0f} deg off its normal (bound {rules.most_oblique_deg:.0f}): "
            f"bring {child} straight behind {parent}"
        )


def _require_tight(
    parent: str, child: str, solution: LinkSolution, last: Detection, rules: CalibrationRules
) -> None:
    yaw_deg = float(np.degrees(np.sqrt(solution.covariance[3, 3])))
    if yaw_deg > rules.most_yaw_std_deg:
        raise CalibrationRefused(
            f"yaw between {parent} and {child} is only known to {yaw_deg:.2f} deg (bound {rules.most_yaw_std_deg}): "
            f"sway {parent} a metre sideways while calibrating"
        )
    std_m = position_std(solution.covariance, solution.T_Op_Oc, last.T_odom_cam[:3, 3])
    if std_m > rules.most_position_std_m:
        raise CalibrationRefused(
            f"position of {child} against {parent} is only known to {std_m:.3f} m (bound {rules.most_position_std_m}): "
            f"come nearer and calibrate again"
        )


def position_std(
    link_covariance: np.ndarray, T_parent_child: np.ndarray, p_child_m: np.ndarray
) -> float:
    """Standard deviation (m) of a point of the child's frame in the parent's: grows with the lever
    arm of the yaw."""
    p = T_parent_child[:3, :3] @ p_child_m
    J = np.column_stack([np.eye(3), [-p[1], p[0], 0.0]])
    return float(np.sqrt(np.trace(J @ link_covariance @ J.T)))

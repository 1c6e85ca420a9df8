# SPDX-License-Identifier: Apache-2.0
"""Where the robot is by the tags on its sides that vehicles' cameras read.

All tags in one picture are one adjustment (fcsv_tracking.gimbal.pose) with the prior that the robot
stands no steeper than it climbs. The prior settles most of what a tag's two planar poses leave open;
where two still explain the corners, the fix lies between them, and says that its yaw is not known.
A port: pictures' tags and monotonic time in, fixes and what is wrong out.
"""

from dataclasses import dataclass
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.chi_squared import quantile
from fcsv_geometry.config import require_positive, require_within
from fcsv_geometry.vehicles.telemetry import Dropped, SeenTag
from fcsv_guidance.place.tracker import GATES, PlaceFix
from fcsv_stereo.pose_covariance import carried
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.config import BodyTag
from fcsv_tracking.gimbal.pose import PoseFit, PoseRules, Upright, body_poses
from fcsv_tracking.tags import longest_edge, observation

_XY_YAW = (0, 1, 5)


@dataclass(frozen=True)
class TagFixRules:
    """What is believed of a picture's tags. ``corner_px``: standard deviation of a distant tag's
    corners, seen face on (docs/lab/guidance.md#by-its-tags); ``tag_m``: of where a tag sits.
    ``gate``: the share of disagreements that chance explains."""

    corner_px: float = 0.12
    tag_m: float = 0.003
    least_edge_px: float = 16.0
    ambiguous: float = 12.0  # a pose that fits worse by less (squared sigmas) may be the true one
    same_yaw_deg: float = 12.0  # two poses of yaws farther apart: the yaw is not measured
    silent_s: float = 5.0  # so long nobody sees the robot until it is told
    gate: float = 0.999
    together_s: float = 0.6  # pictures of two vehicles that are compared
    apart_m: float = 1.0  # and farther apart than the gate: two robots with one tag
    fastest_mps: float = 1.0  # of the robot between two such pictures
    conflict_s: float = 3.0  # so long no fix is given out after it

    def __post_init__(self):
        require_positive(self)
        require_within(self, *GATES, "gate")


@dataclass(frozen=True)
class RobotSight:
    """The tags in one picture of a vehicle; covariance (6,6) of T_home_cam as camera_pose has it."""

    vehicle: str
    stamp_s: float
    T_home_cam: np.ndarray
    covariance: np.ndarray
    focal_px: float
    tags: Sequence[SeenTag]


def tag_fix(
    sight: RobotSight,
    tags: Mapping[int, BodyTag],
    largest_slope_rad: float,
    rules: TagFixRules = TagFixRules(),
) -> PlaceFix:
    """The robot's place by its ``tags`` in a picture. Raises SampleRejected, whose reason is a
    counter's name, where there is none."""
    seen = _large_enough(_finite(sight, tags), sight.focal_px, rules)
    camera = PinholeCamera(1, 1, sight.focal_px, sight.focal_px, 0.0, 0.0)
    own = [observation(t.id, t.size_m, sight.focal_px * t.corners_normalized, camera) for t in seen]
    upright = Upright(sight.T_home_cam[:3, :3], 0.5 * largest_slope_rad)
    corners = PoseRules(corner_px=rules.corner_px, tag_m=rules.tag_m)
    fits, _ = body_poses(own, tags, sight.focal_px, corners, upright=upright)
    alike = [f for f in fits if f.cost - fits[0].cost < rules.ambiguous]
    places = [_place(f, sight) for f in alike]
    x, C = _between(places, np.radians(rules.same_yaw_deg))
    return PlaceFix(sight.stamp_s, float(x[0]), float(x[1]), rotations.wrap(float(x[2])), C)


def _finite(sight: RobotSight, tags: Mapping[int, BodyTag]) -> List[SeenTag]:
    """The robot's tags in it, once all is finite, each of the size of the robot's file."""
    own = [t for t in sight.tags if t.id in tags]
    if not own:
        raise SampleRejected("no tag", "no tag of the robot in the picture")
    numbers = [sight.T_home_cam, sight.covariance, [sight.stamp_s, sight.focal_px]]
    if not all(np.isfinite(v).all() for v in [*numbers, *(t.corners_normalized for t in own)]):
        raise SampleRejected("not finite", f"{sight.vehicle}: a pose or a corner is not finite")
    if sight.focal_px <= 0 or len({t.id for t in own}) < len(own):
        raise SampleRejected("implausible", f"{sight.vehicle}: no focal length, or one id twice")
    for tag in own:
        if not np.isclose(tag.size_m, tags[tag.id].size_m, rtol=1e-3):
            raise SampleRejected(
                "other size",
                f"{sight.vehicle} takes tag {tag.id} to be {tag.size_m:g} m wide, this machine's file "
                f"says {tags[tag.id].size_m:g} m: give both the same robot",
            )
    return own


def _large_enough(seen: List[SeenTag], focal_px: float, rules: TagFixRules) -> List[SeenTag]:
    edges_px = [focal_px * longest_edge(t.corners_normalized) for t in seen]
    large = [t for t, edge_px in zip(seen, edges_px) if edge_px >= rules.least_edge_px]
    if not large:
        raise SampleRejected(
            "too small", f"tag {seen[0].id} is {max(edges_px):.0f} px large: go nearer"
        )
    return large


def _place(fit: PoseFit, sight: RobotSight) -> Tuple[np.ndarray, np.ndarray]:
    """(x, y, yaw) in home and its covariance (3,3): by the corners, and by the vehicle's own pose,
    whose turn moves the robot by its distance."""
    T_home_robot = sight.T_home_cam @ fit.T
    arm_m = T_home_robot[:3, 3] - sight.T_home_cam[:3, 3]
    F, turn = carried(arm_m), np.kron(np.eye(2), sight.T_home_cam[:3, :3])
    C = turn @ fit.covariance @ turn.T + F @ sight.covariance @ F.T
    x = np.array([*T_home_robot[:2, 3], transforms.yaw(T_home_robot)])
    return x, C[np.ix_(_XY_YAW, _XY_YAW)]


def _between(
    places: Sequence[Tuple[np.ndarray, np.ndarray]], same_yaw_rad: float
) -> Tuple[np.ndarray, np.ndarray]:
    """The middle of places of which any may be true, and a covariance that covers all of them."""
    first = places[0][0]
    off = np.array([x - first for x, _ in places])
    off[:, 2] = [rotations.wrap(a) for a in off[:, 2]]
    middle = off.mean(axis=0)
    off -= middle
    C = np.mean([C for _, C in places], axis=0) + off.T @ off / len(off)
    if np.abs(off[:, 2]).max() > 0.5 * same_yaw_rad:
        C[2, :2] = C[:2, 2] = 0.0
        C[2, 2] = np.inf
    return first + middle, C


class RobotTagReader:
    """Makes fixes of what all vehicles see of the robot, and says where that goes wrong."""

    def __init__(
        self,
        tags: Mapping[int, BodyTag],
        largest_slope_rad: float,
        rules: TagFixRules = TagFixRules(),
    ):
        self._tags, self._slope_rad, self._rules = tags, largest_slope_rad, rules
        self._last: Dict[str, PlaceFix] = {}  # by vehicle
        self._seen_s: Optional[float] = None
        self._conflict, self._conflict_s = "", -np.inf

    def receive(self, now_s: float, sight: RobotSight) -> Tuple[Optional[PlaceFix], List[Dropped]]:
        """A picture's tags came: the fix that they give, or why there is none."""
        self._seen_s = now_s if self._seen_s is None else self._seen_s
        if not any(t.id in self._tags for t in sight.tags):
            return None, []
        try:
            fix = tag_fix(sight, self._tags, self._slope_rad, self._rules)
        except SampleRejected as error:
            return None, [Dropped(error.reason, f"{sight.vehicle}: {error}")]
        self._last[sight.vehicle], self._seen_s = fix, now_s
        self._compare(now_s, sight.vehicle, fix)
        if now_s - self._conflict_s < self._rules.conflict_s:
            return None, [Dropped("seen at two places", self._conflict)]
        return fix, []

    def step(self, now_s: float) -> str:
        """What is wrong now; empty where nothing is."""
        if now_s - self._conflict_s < self._rules.conflict_s:
            return self._conflict
        self._seen_s = now_s if self._seen_s is None else self._seen_s
        silent_s = now_s - self._seen_s
        if silent_s < self._rules.silent_s:
            return ""
        return f"no vehicle has read a tag of the robot for {silent_s:.0f} s: turn one to it, go nearer"

    def _compare(self, now_s: float, vehicle: str, fix: PlaceFix) -> None:
        """Two vehicles see the robot at one time at two places: nobody can tell which is right."""
        rules = self._rules
        for name, other in self._last.items():
            apart_s = abs(fix.stamp_s - other.stamp_s)
            if name == vehicle or apart_s > rules.together_s:
                continue
            off = np.array([fix.x_m - other.x_m, fix.y_m - other.y_m])
            C = (fix.covariance + other.covariance)[:2, :2]
            C = C + np.eye(2) * (rules.fastest_mps * apart_s) ** 2
            apart_m = float(np.hypot(*off))
            if apart_m > rules.apart_m and off @ np.linalg.solve(C, off) > quantile(rules.gate, 2):
                self._conflict_s = now_s
                self._conflict = (
                    f"{name} and {vehicle} see the robot {apart_m:.1f} m apart: two robots have one "
                    "tag, or a vehicle's place is wrong; fixes are dropped"
                )

# SPDX-License-Identifier: Apache-2.0
"""One gimbal and its vehicle: angles and tags in; the vehicle's pose in the ground robot's frame
and commands out.

T_G_D = T_G_C(angles at the picture's stamp) T_C_D(tags). Frames: G ground robot, C gimbal camera, D
body.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Deque, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.config import require_positive
from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.streams.flow import DropCounter
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.angles import AngleTrack
from fcsv_tracking.gimbal.base_motion import BaseMotion
from fcsv_tracking.gimbal.config import BodyTag
from fcsv_tracking.gimbal.follow import Follower, FollowRules, Target
from fcsv_tracking.gimbal.geometry import Angles, GimbalGeometry
from fcsv_tracking.gimbal.looking import ImageWindow, window_about
from fcsv_tracking.gimbal.pose import BodySight, PoseRules
from fcsv_tracking.gimbal.sighting import Seen, TagPicture, find_body
from fcsv_tracking.mocap.equations import moved_covariance
from fcsv_tracking.tags import TagObservation

_BLIND_DEGPS = 30.0  # smears a tag over several of its modules
# so long after its last sight a vehicle is looked for first where it should be
_EXPECTED_S, _MOST_STRAYED_M = 3.0, 0.2
_SPEED_MPS, _ACCELERATION_MPS2 = 0.5, 3.0  # by which it may move otherwise than it did
_POSITION_M = 0.005  # of a sight, for weighing sights against each other


@dataclass(frozen=True)
class GimbalRules:
    """Standard deviations: ``angle_deg`` of a reading (0.088 degrees of resolution are 0.025),
    ``mount_*`` of how the gimbal was measured in, ``stamp_s`` of a picture's stamp against the
    readings'."""

    angle_deg: float = 0.03
    mount_deg: float = 0.03
    mount_m: float = 0.001
    stamp_s: float = 0.0012
    # of the gimbal's camera, set by hand: what moves is smeared for so long
    exposure_s: float = 0.002
    # a gimbal that turns faster blurs and misplaces: no pose from such pictures
    still_degps: float = 4.0
    most_speed_mps: float = 6.0  # no vehicle here is faster
    velocity_over_s: float = 0.3
    newest_s: float = 0.05  # a picture further ahead of the clock is of another clock
    oldest_s: float = 1.0
    pose: PoseRules = field(default_factory=PoseRules)
    follow: FollowRules = field(default_factory=FollowRules)

    def __post_init__(self):
        require_positive(self)


@dataclass(frozen=True)
class GroundPose:
    """T_G_D at a picture's stamp; covariance (6,6): position (m), rotation (rad), about the ground
    robot's axes."""

    stamp_s: float
    T_G_D: np.ndarray
    covariance: np.ndarray
    sight: BodySight


class GimbalTracker:
    """add_angles() and add_tags() as they come; command() says where to turn. What is rejected is
    counted.

    ``base``: how the robot moves meanwhile; what was seen is remembered in its wheels' frame.
    """

    def __init__(
        self,
        geometry: GimbalGeometry,
        tags: Sequence[BodyTag],
        camera: PinholeCamera,
        rules: GimbalRules,
        start: Optional[Angles] = None,
        base: Optional[BaseMotion] = None,
    ):
        self._geometry, self._rules, self._camera = geometry, rules, camera
        self._tags: Mapping[int, BodyTag] = {t.id: t for t in tags}
        #: What is kept in the picture: the middle of the tags, in the body.
        self._centre_D = np.mean([t.T_body_tag[:3, 3] for t in tags], axis=0)
        self._angles, self._base = AngleTrack(), base or BaseMotion()
        self.follower = Follower(geometry, camera, rules.follow, start or Angles(0.0, 0.35))
        self.counts = DropCounter()
        self._start_over()

    def _start_over(self) -> None:
        self._seen: Deque[Tuple[float, np.ndarray, float]] = deque()
        self._stamp_s = -np.inf
        self.latest: Optional[GroundPose] = None

    def add_angles(self, stamp_s: float, angles: Angles) -> None:
        """A reading of the servos. Raises SampleRejected."""
        try:
            self._angles.add(stamp_s, angles)
        except SampleRejected as error:
            self.counts.count(error.reason)
            raise

    @property
    def angles_until_s(self) -> float:
        """Up to which stamp readings have come: a picture newer than this waits."""
        return self._angles.newest_s

    def camera_now(self) -> np.ndarray:
        """T_G_C of the newest reading. Raises PoseUnavailable before the first."""
        return self._geometry.T_ground_cam(self._angles.latest())

    def add_tags(
        self, now_s: float, stamp_s: float, observations: Sequence[TagObservation]
    ) -> GroundPose:
        """What the detector found in the picture of ``stamp_s``. Raises SampleRejected where it
        gives no pose.

        begin(), see() and finish() in one: who shares the tracker holds its lock for the first and
        the last alone.
        """
        picture = self.begin(now_s, stamp_s, observations)
        return self.finish(picture, self.find_body(picture))

    def begin(
        self, now_s: float, stamp_s: float, observations: Sequence[TagObservation]
    ) -> TagPicture:
        """What see() needs of the picture of ``stamp_s``. Raises SampleRejected where it is none to
        look at."""
        try:
            self._check_stamp(now_s, stamp_s)
            return self._picture(stamp_s, observations)
        except PoseUnavailable as error:
            self.counts.count("no angles")
            raise SampleRejected("no angles", f"gimbal: {error}") from error
        except SampleRejected as error:
            self.counts.count(error.reason)
            raise

    def find_body(self, picture: TagPicture) -> Seen:
        """The body in the picture: reads nothing that changes, so it needs no lock."""
        return find_body(
            picture, self._tags, 0.5 * (self._camera.fx + self._camera.fy), self._rules.pose
        )

    def finish(self, picture: TagPicture, seen: Seen) -> GroundPose:
        """Takes what was seen. Raises SampleRejected where it gives no pose."""
        try:
            return self._pose(picture, seen)
        except SampleRejected as error:
            self.counts.count(error.reason)
            raise

    def _check_stamp(self, now_s: float, stamp_s: float) -> None:
        if not np.isfinite(stamp_s) or stamp_s > now_s + self._rules.newest_s:
            raise SampleRejected(
                "stamp ahead of the clock",
                f"picture is {stamp_s - now_s:.2f} s ahead: set the clocks",
            )
        if stamp_s < now_s - self._rules.oldest_s:
            raise SampleRejected("too old", f"picture is {now_s - stamp_s:.1f} s old")
        if stamp_s < self._stamp_s - self._rules.oldest_s:
            self._start_over()  # the clock was set back
        if stamp_s <= self._stamp_s:
            raise SampleRejected(
                "stamp goes back", f"picture is {self._stamp_s - stamp_s:.3f} s before the last"
            )
        self._stamp_s = stamp_s

    def _picture(self, stamp_s: float, observations: Sequence[TagObservation]) -> TagPicture:
        own = [o for o in observations if o.id in self._tags]
        for o in own:
            if abs(o.size_m - self._tags[o.id].size_m) > 1e-6:
                raise SampleRejected(
                    "tag size", f"tag {o.id} was measured as {o.size_m} m, the file says otherwise"
                )
        angles, rates = self._angles.at(stamp_s)
        T_G_C, turning = self._geometry.T_ground_cam(angles), float(np.max(np.abs(rates)))
        prior = (
            None
            if self._lost(stamp_s) or self.latest is None
            else T_G_C[:3, :3].T @ self._carried(self.latest, stamp_s)
        )
        return TagPicture(
            stamp_s, own, angles, rates, T_G_C, prior, self._blur_px(stamp_s, own, T_G_C, turning)
        )

    def _pose(self, picture: TagPicture, seen: Seen) -> GroundPose:
        if picture.stamp_s != self._stamp_s:
            raise SampleRejected(
                "overtaken", "looked at, when a newer one was taken or the clock set back"
            )
        if seen.T_G_D is not None:
            self._remember(
                picture.stamp_s, transforms.apply(seen.T_G_D, self._centre_D), picture.turning_radps
            )
        if seen.rejected is not None:
            raise seen.rejected
        if np.degrees(picture.turning_radps) > self._rules.still_degps:
            raise SampleRejected("gimbal turning", "the gimbal turned while the picture was taken")
        covariance = self._covariance(picture, seen.T_G_D, seen.sight)
        self.latest = GroundPose(picture.stamp_s, seen.T_G_D, covariance, seen.sight)
        return self.latest

    def _carried(self, pose: GroundPose, stamp_s: float) -> np.ndarray:
        """R_G_D of an earlier pose as the robot has it now, if the body has not turned."""
        moved = transforms.invert(self._base.at(stamp_s)) @ self._base.at(pose.stamp_s)
        return moved[:3, :3] @ pose.T_G_D[:3, :3]

    def _blur_px(
        self, stamp_s: float, own: Sequence[TagObservation], T_G_C: np.ndarray, turning_radps: float
    ) -> float:
        """How far the body moved in the picture while the shutter was open, by its last
        velocity."""
        target = self._target_in_ground(stamp_s)
        if not own or target is None:
            return 0.0
        across = T_G_C[:3, :2].T @ target.v_ground_mps / max(float(own[0].T_cam_tag[2, 3]), 0.1)
        return (
            self._rules.exposure_s
            * self._camera.fx
            * (float(np.linalg.norm(across)) + turning_radps)
        )

    def _covariance(self, picture: TagPicture, T_G_D, sight: BodySight) -> np.ndarray:
        """What tags, readings, mounting and stamps leave open, about G's axes."""
        r, angles, rates, T_G_C = self._rules, picture.angles, picture.rates_radps, picture.T_G_C
        turn = np.kron(np.eye(2), T_G_C[:3, :3])
        total = turn @ sight.covariance @ turn.T
        M = self._geometry.motions(angles, T_G_D[:3, 3])
        total += M @ np.diag(np.radians(r.angle_deg) ** 2 + (rates * r.stamp_s) ** 2) @ M.T
        mount = np.diag([r.mount_m**2] * 3 + [np.radians(r.mount_deg) ** 2] * 3)
        total += moved_covariance(mount, np.eye(3), T_G_D[:3, 3] - T_G_C[:3, 3])
        target = self._target_in_ground(picture.stamp_s)
        if target is not None:
            total[:3, :3] += r.stamp_s**2 * np.outer(target.v_ground_mps, target.v_ground_mps)
        return total

    # -- following
    # --------------------------------------------------------------------------------------------------

    def _lost(self, stamp_s: float) -> bool:
        return not self._seen or stamp_s - self._seen[-1][0] > self._rules.follow.lost_s

    def _remember(self, stamp_s: float, p_G: np.ndarray, turning_radps: float) -> None:
        p_O = transforms.apply(self._base.at(stamp_s), p_G)
        if self._lost(stamp_s):
            self._seen.clear()
        else:
            last_s, last_p, _ = self._seen[-1]
            most_m = 0.15 + self._rules.most_speed_mps * (stamp_s - last_s)
            if np.linalg.norm(p_O - last_p) > most_m:
                raise SampleRejected(
                    "jump",
                    f"{np.linalg.norm(p_O - last_p):.2f} m from the last place: not the vehicle",
                )
        distance_m = float(np.linalg.norm(p_G - self._geometry.base.xyz_m))
        self._seen.append(
            (stamp_s, p_O, _POSITION_M + turning_radps * 2 * self._rules.stamp_s * distance_m)
        )
        while self._seen[0][0] < stamp_s - self._rules.velocity_over_s:
            self._seen.popleft()

    def target(self) -> Optional[Target]:
        """Place and velocity of the tags' middle by a straight line through the last sights, in
        the frame of the robot's wheels; None before the first."""
        if not self._seen:
            return None
        t, p, sigma = (np.array(column) for column in zip(*self._seen))
        end_s = t[-1]
        if len(t) < 3 or end_s - t[0] < 0.3 * self._rules.velocity_over_s:
            return Target(end_s, p[-1], np.zeros(3))
        A = np.stack([np.ones_like(t), t - end_s], axis=1) / sigma[:, None]
        line = np.linalg.lstsq(A, p / sigma[:, None], rcond=None)[0]
        return Target(end_s, line[0], line[1])

    def _target_in_ground(self, stamp_s: float) -> Optional[Target]:
        """The same as the robot has it at a moment."""
        target = self.target()
        if target is None:
            return None
        return self._base.in_ground(target, stamp_s, self._rules.follow.lost_s)

    def turning(self, stamp_s: float) -> bool:
        """Whether the gimbal turned so fast then that looking at the picture is of no use
        (counted)."""
        try:
            rates = self._angles.at(stamp_s)[1]
        except PoseUnavailable:
            return False
        if np.degrees(np.max(np.abs(rates))) < _BLIND_DEGPS:
            return False
        self.counts.count("gimbal turning")
        return True

    def window(self, stamp_s: float) -> Optional[ImageWindow]:
        """Where in the picture of ``stamp_s`` the vehicle should be; None where that is not known.

        Also for a while after it was lost: where the whole picture takes longer than that, it would
        stay lost else.
        """
        target = self._target_in_ground(stamp_s)
        if target is None or abs(stamp_s - target.last_sight_s) > _EXPECTED_S:
            return None
        try:
            T_G_C = self._geometry.T_ground_cam(self._angles.at(stamp_s)[0])
        except PoseUnavailable:
            return None
        age_s = abs(stamp_s - target.last_sight_s)
        strayed_m = min(
            0.05 + _SPEED_MPS * age_s + 0.5 * _ACCELERATION_MPS2 * age_s**2, _MOST_STRAYED_M
        )
        radius_m = self._rules.follow.target_radius_m + strayed_m
        p_ground_m = target.at(min(stamp_s, target.last_sight_s + self._rules.follow.lost_s))
        return window_about(transforms.invert(T_G_C), p_ground_m, radius_m, self._camera)

    def command(self, now_s: float) -> Optional[Angles]:
        """Where to turn now; None to stand still."""
        target = self.target()
        if target is not None and target.stamp_s > now_s + self._rules.oldest_s:
            self._start_over()  # the clock was set back
        return self.follower.command(now_s, self._target_in_ground(now_s), self._stamp_s)

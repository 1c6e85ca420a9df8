# SPDX-License-Identifier: Apache-2.0
"""Leads from the tracking camera's odometry to the body's, with a gate that no jump passes.

``odom`` is the T265's own level odometry frame, so T_odom_body = T_odom_t265 @ inv(T_body_t265),
until the tracker jumps. Then the frame is re-based by four degrees of freedom (the jump undone,
roll and pitch are gravity's and stay) so that the pose given to the autopilot is continuous:
ArduCopter flies a jump's length when it adopts it, and does not follow a rotated frame at all. What
was calibrated before a jump, or before a gap over which the vehicle may have moved, does not hold
after it: each begins an epoch.
"""

import math
from dataclasses import dataclass, field
from typing import Optional, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.config import require_positive
from fcsv_geometry.frozen import frozen
from fcsv_geometry.rotations import Quaternion, Vector
from fcsv_geometry.streams.flow import DropCounter
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile
from fcsv_tracking.errors import OdometryRejected

# by which stamps may run ahead of when samples come, and no more: they are then stepped
_STEP_S = 0.3


@dataclass(frozen=True)
class GateParameters:
    """Bounds beyond which a step of the odometry is not a movement."""

    max_step_m: float = 0.3  # off the prediction by the last velocity
    max_speed_mps: float = 10.0
    # off the prediction, heading; and between tilts of neighbouring samples
    max_turn_rad: float = 0.2
    max_rate_radps: float = 15.0
    bridge_s: float = 0.5  # longest time over which the last velocity carries on
    max_gap_s: float = 0.5  # of silence: after more of it the vehicle may be anywhere near
    max_jumps: int = 5  # in lost_window_s: more is a lost tracker, whose pose is withheld
    lost_window_s: float = 1.0
    patience_samples: int = 100  # rejected in a row before the tracker is taken to have begun anew

    def __post_init__(self):
        require_positive(self)


@frozen
class BodyPose:
    """Body in uavN/odom; velocities in the body frame (m/s, rad/s)."""

    stamp_s: float
    p_odom_body: Vector
    q_odom_body_xyzw: Quaternion
    linear_mps: Vector
    angular_radps: Vector


@dataclass(frozen=True)
class EpochBegan:
    """Which beginning of the odometry frame it is, and why it began; another number: calibrate
    again."""

    number: int = 0
    reason: str = "start"


@dataclass
class GateStatus:
    """What the gate has done so far."""

    passed: int = 0
    rejected: DropCounter = field(default_factory=DropCounter)
    jumps: int = 0
    largest_jump_m: float = 0.0
    largest_jump_rad: float = 0.0
    last_jump_stamp_s: Optional[float] = None
    lost: bool = False


@dataclass(frozen=True)
class Rebase:
    """T_odom_t265odom, four degrees of freedom: identity until the tracker jumps."""

    yaw_rad: float = 0.0
    p_m: Vector = (0.0, 0.0, 0.0)


class BodyOdometry:
    """Samples of the tracking camera in, poses of the body out; time comes with the samples."""

    def __init__(
        self,
        T_body_t265: np.ndarray,
        gate: Optional[GateParameters] = None,
        rebase: Optional[Rebase] = None,
        tracker: TrackerProfile = T265_PROFILE,
        epoch: EpochBegan = EpochBegan(),
    ):
        self.epoch = epoch
        T_t265_body = transforms.invert(T_body_t265)
        self._p_t265_body: Vector = tuple(T_t265_body[:3, 3].tolist())
        self._q_t265_body: Quaternion = tuple(transforms.quaternion_xyzw(T_t265_body).tolist())
        self._q_body_t265 = rotations.conjugate(self._q_t265_body)
        self._p_body_t265: Vector = tuple(np.asarray(T_body_t265, float)[:3, 3].tolist())
        self._gate, self._period_s = gate or GateParameters(), tracker.period_s
        self._set_rebase(rebase or Rebase())
        self._last: Optional[BodyPose] = None
        self._came_s: Optional[float] = None  # the last sample that passed
        self._dt_s = 0.0  # between the last one that passed and this
        # odom frame, from positions: the twist field is not relied on
        self._velocity: Vector = (0.0, 0.0, 0.0)
        self._yaw_rate = 0.0
        self._rejected_in_a_row = 0
        self._recent_jumps: Tuple[float, ...] = ()
        self.status = GateStatus()

    @property
    def rebase(self) -> Rebase:
        """Where the tracker's odometry frame stands in uavN/odom now."""
        return self._rebase

    def reject(self, reason: str, message: str) -> OdometryRejected:
        """Count a sample as rejected; the error to raise."""
        self.status.rejected.count(reason)
        return OdometryRejected(reason, message)

    def add(
        self,
        stamp_s: float,
        p_t265odom_t265: Vector,
        q_t265odom_t265_xyzw: Quaternion,
        linear_mps: Vector = (0.0, 0.0, 0.0),
        angular_radps: Vector = (0.0, 0.0, 0.0),
        came_s: Optional[float] = None,
    ) -> BodyPose:
        """The body's pose from one sample (velocities in the t265 frame). Raises OdometryRejected.

        ``came_s``: when it came, by a monotonic clock, by which a step of the stamps' clock is told
        from a gap.
        """
        self._dt_s = self._since_last(stamp_s, came_s)
        q_raw = self._checked(
            stamp_s, p_t265odom_t265, q_t265odom_t265_xyzw, linear_mps, angular_radps
        )
        pose = self._body(stamp_s, p_t265odom_t265, q_raw, linear_mps, angular_radps)
        if self._last is not None:
            pose = self._continuous(pose, p_t265odom_t265, q_raw)
            self._learn_velocity(pose)
        self._rejected_in_a_row = 0
        self._last, self._came_s = pose, came_s
        self._require_tracking(stamp_s)
        self.status.passed += 1
        return pose

    def _since_last(self, stamp_s: float, came_s: Optional[float]) -> float:
        """Time (s) since the last sample that passed: by the stamps, unless their clock was stepped
        meanwhile."""
        if self._last is None:
            return 0.0
        by_stamps_s = stamp_s - self._last.stamp_s
        if came_s is None or self._came_s is None:
            return by_stamps_s
        ahead_s = by_stamps_s - (came_s - self._came_s)
        stepped = ahead_s > _STEP_S or by_stamps_s < -_STEP_S
        return came_s - self._came_s if stepped else by_stamps_s

    def _checked(self, stamp_s, p, q, linear, angular) -> Quaternion:
        """The quaternion normalised; raises OdometryRejected on what is no sample at all."""
        norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        if not math.isfinite(norm + sum(p) + sum(linear) + sum(angular) + stamp_s):
            raise self.reject("not_finite", "odometry holds NaN or infinity")
        if abs(norm - 1.0) > 0.01:
            raise self.reject("quaternion", f"odometry's quaternion has length {norm:.3g}, not 1")
        if self._last is not None and self._dt_s <= 0.0:
            self._rejected_in_a_row += 1
            if self._rejected_in_a_row < self._gate.patience_samples:
                back_s = self._last.stamp_s - stamp_s
                raise self.reject("stamp", f"odometry's stamp goes back {back_s:.3f} s")
        return (q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm)

    def _body(self, stamp_s, p_raw, q_raw, linear, angular) -> BodyPose:
        """T_odom_body = T_odom_t265odom @ T_t265odom_t265 @ inv(T_body_t265), and the twist of the
        body's origin."""
        arm = rotations.rotate(q_raw, self._p_t265_body)
        p = rotations.rotate(
            self._q_rebase, (p_raw[0] + arm[0], p_raw[1] + arm[1], p_raw[2] + arm[2])
        )
        t = self._rebase.p_m
        q = rotations.multiply(self._q_rebase, rotations.multiply(q_raw, self._q_t265_body))
        w = rotations.rotate(self._q_body_t265, angular)
        v = rotations.rotate(self._q_body_t265, linear)
        r = self._p_body_t265  # v_body = v_t265 - w x r
        v_body = (
            v[0] - w[1] * r[2] + w[2] * r[1],
            v[1] - w[2] * r[0] + w[0] * r[2],
            v[2] - w[0] * r[1] + w[1] * r[0],
        )
        return BodyPose(stamp_s, (p[0] + t[0], p[1] + t[1], p[2] + t[2]), q, v_body, w)

    def _continuous(self, pose: BodyPose, p_raw: Vector, q_raw: Quaternion) -> BodyPose:
        """The pose itself where it continues the last ones, else the pose after re-basing. Raises
        OdometryRejected."""
        last, gate = self._last, self._gate
        dt_s = max(self._dt_s, self._period_s)  # never sharper than the tracker's rate
        began_anew = self._rejected_in_a_row >= gate.patience_samples
        tilt = rotations.tilt_between(last.q_odom_body_xyzw, pose.q_odom_body_xyzw)
        if tilt > max(gate.max_turn_rad, gate.max_rate_radps * dt_s) and not began_anew:
            self._rejected_in_a_row += 1
            raise self.reject(
                "tilt", f"odometry's roll or pitch jumps by {math.degrees(tilt):.1f} deg"
            )
        if dt_s > gate.max_gap_s:
            self._begin_epoch(f"the tracker was silent for {dt_s:.1f} s")
        bridged_s = min(dt_s, gate.bridge_s) if self._dt_s > 0.0 else 0.0
        (x, y, z), (vx, vy, vz) = last.p_odom_body, self._velocity
        predicted = (x + vx * bridged_s, y + vy * bridged_s, z + vz * bridged_s)
        yaw_predicted = rotations.yaw(last.q_odom_body_xyzw) + self._yaw_rate * bridged_s
        step_m = math.dist(pose.p_odom_body, last.p_odom_body)
        off_m = math.dist(pose.p_odom_body, predicted)
        turn_rad = abs(rotations.wrap(rotations.yaw(pose.q_odom_body_xyzw) - yaw_predicted))
        turned = turn_rad > max(gate.max_turn_rad, gate.max_rate_radps * (dt_s - bridged_s))
        if not (
            began_anew or turned or off_m > gate.max_step_m or step_m > gate.max_speed_mps * dt_s
        ):
            return pose
        self._note_jump(pose.stamp_s, off_m, turn_rad)
        yaw_step = (
            rotations.wrap(yaw_predicted - rotations.yaw(pose.q_odom_body_xyzw))
            if turned or began_anew
            else 0.0
        )
        self._rebase_onto(predicted, yaw_step, p_raw, q_raw)
        return self._body(pose.stamp_s, p_raw, q_raw, (0.0, 0.0, 0.0), pose.angular_radps)

    def _rebase_onto(
        self, p_odom_body: Vector, yaw_step: float, p_raw: Vector, q_raw: Quaternion
    ) -> None:
        self._set_rebase(Rebase(rotations.wrap(self._rebase.yaw_rad + yaw_step)))
        without = self._body(0.0, p_raw, q_raw, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).p_odom_body
        self._set_rebase(
            Rebase(self._rebase.yaw_rad, tuple(a - b for a, b in zip(p_odom_body, without)))
        )

    def _set_rebase(self, rebase: Rebase) -> None:
        self._rebase = rebase
        self._q_rebase = rotations.quaternion_of_yaw(rebase.yaw_rad)

    def _begin_epoch(self, reason: str) -> None:
        self.epoch = EpochBegan(self.epoch.number + 1, reason)

    def _note_jump(self, stamp_s: float, off_m: float, turn_rad: float) -> None:
        self._begin_epoch(f"the tracker jumped by {off_m:.2f} m, {math.degrees(turn_rad):.0f} deg")
        status = self.status
        status.jumps += 1
        status.largest_jump_m = max(status.largest_jump_m, off_m)
        status.largest_jump_rad = max(status.largest_jump_rad, turn_rad)
        status.last_jump_stamp_s = stamp_s
        self._recent_jumps = (*self._recent_jumps, stamp_s)[-self._gate.max_jumps - 1 :]

    def _require_tracking(self, stamp_s: float) -> None:
        """A tracker that jumps again and again has no pose: the autopilot's failsafe handles
        silence."""
        recent = [s for s in self._recent_jumps if 0.0 <= stamp_s - s < self._gate.lost_window_s]
        if len(recent) > self._gate.max_jumps:
            self.status.lost = True
        elif not recent:
            self.status.lost = False
        if self.status.lost:
            raise self.reject("lost", "odometry jumps again and again: tracker lost, pose withheld")

    def _learn_velocity(self, pose: BodyPose) -> None:
        """Velocity from positions, smoothed over about 50 ms."""
        dt_s = self._dt_s
        if dt_s <= 0.0 or self.status.last_jump_stamp_s == pose.stamp_s:
            return
        gain = min(1.0, dt_s / 0.05)
        (ax, ay, az), (bx, by, bz) = self._last.p_odom_body, pose.p_odom_body
        vx, vy, vz = self._velocity
        self._velocity = (
            vx + gain * ((bx - ax) / dt_s - vx),
            vy + gain * ((by - ay) / dt_s - vy),
            vz + gain * ((bz - az) / dt_s - vz),
        )
        turn = rotations.wrap(
            rotations.yaw(pose.q_odom_body_xyzw) - rotations.yaw(self._last.q_odom_body_xyzw)
        )
        self._yaw_rate += gain * (turn / dt_s - self._yaw_rate)

# SPDX-License-Identifier: Apache-2.0
"""One vehicle: samples in as they arrive, its pose in the mocap's frame out; no pose rather than a
wrong one.

Samples are put in order of the moments that they tell of and taken once every stream has come that
far: the mocap is 10 ms late, a Tello's packets 70 ms and more, and the filter learns how much more.
"""

import heapq
from collections import deque
from dataclasses import dataclass
from typing import Deque, List, Optional, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_geometry.streams.flow import DropCounter
from fcsv_geometry.trajectory import Trajectory
from fcsv_tracking.mocap.anchor import Anchor, lies_as_before
from fcsv_tracking.mocap.blend import Blend
from fcsv_tracking.mocap.disputes import Disputes, MocapVerdict
from fcsv_tracking.mocap.filter import PERIOD_S, MocapFilter
from fcsv_tracking.mocap.rules import TrackerRules
from fcsv_tracking.mocap.samples import MocapInput, VehicleInput, VehicleSample

_LONGEST_STEP_S = 0.05
# how long after the filter's moment a sample may come: motion is straight for so long
_LATEST_S = 0.02
_UNPROVEN_S = 0.1  # how long odometry alone is followed before movement has proven its heading
_CONTRADICTION = "odometry and IMU contradict each other, or mocap: who is right is not known"
_SILENT = "neither odometry nor mocap"
_UNPROVEN = "its heading is not proven yet: move it 0.3 m sideways in the mocap's view"


@dataclass(frozen=True)
class TrackedPose:
    """T_M_D at a stamp, and T_M_O that goes with it; covariance (6,6): position (m), rotation
    (rad), in M's axes."""

    stamp_s: float
    T_M_D: np.ndarray
    T_M_O: np.ndarray
    covariance: np.ndarray
    in_view: bool
    heading_confirmed: bool

    @property
    def T_O_D(self) -> np.ndarray:
        """The body in its odometry's frame, by both."""
        return transforms.invert(self.T_M_O) @ self.T_M_D


class MocapTracker:
    """add_mocap() and add_vehicle() with the time of arrival; pose() afterwards. Rejected samples
    raise."""

    def __init__(self, rules: Optional[TrackerRules] = None):
        self._rules = rules = rules or TrackerRules()
        self.counts = DropCounter()
        self._mocap_input = MocapInput(rules.input, self.counts)
        self._vehicle_input = VehicleInput(rules.input, self.counts)
        self._queue: List[Tuple[float, int, object]] = []
        self._number = 0
        self._coming: Deque[Tuple[float, VehicleSample, bool]] = deque()
        self._newest = {"mocap": -np.inf, "vehicle": -np.inf}
        self._odometry = _newest_poses()
        self._anchor, self._blend = Anchor(), _blend(rules)
        self._disputes = Disputes(rules, self.counts)
        # of an odometry that went silent after its heading was proven
        self._proven_R_M_O: Optional[np.ndarray] = None
        self._filter: Optional[MocapFilter] = None  # None: not anchored
        self._imu: Optional[VehicleSample] = None  # of the last packet, and its moment
        self._vehicle_s = -np.inf
        # the filter's moment, and that of the last pose that it took
        self._time_s = self._mocap_s = -np.inf
        self._began_p_M = np.zeros(3)  # where it was anchored
        self._heading_confirmed = self._coasting = False
        self.absent_because = "not seen yet: fly it into the mocap's view"

    # -- samples
    # ----------------------------------------------------------------------------------------------------

    def add_mocap(self, now_s: float, stamp_s: float, p_M_D_m, q_M_D_xyzw) -> None:
        """A pose of the body from the tracker on the ground. Raises SampleRejected."""
        T_M_D = self._mocap_input.check(now_s, stamp_s, p_M_D_m, q_M_D_xyzw)
        self._push(now_s, "mocap", stamp_s - self._rules.mocap_latency_s, T_M_D)

    def add_vehicle(
        self, now_s: float, stamp_s: float, p_O_D_m, q_O_D_xyzw, v_D_mps, gyro_radps, accel_mps2
    ) -> None:
        """A packet of the vehicle's odometry and IMU. Raises SampleRejected."""
        sample, continues = self._vehicle_input.check(
            now_s, stamp_s, p_O_D_m, q_O_D_xyzw, v_D_mps, gyro_radps, accel_mps2
        )
        if not continues:
            self.counts.count("odometry: began anew")
            self._odometry = _newest_poses()
            self._anchor.clear()
            self._proven_R_M_O = None
        delay_s = self._filter.state.delay_s if self._filter else self._rules.odometry_latency_s
        self._odometry.add(stamp_s - delay_s, sample.T_O_D)
        self._coming.append((stamp_s - delay_s, sample, continues))
        self._push(now_s, "vehicle", stamp_s - delay_s, (sample, delay_s, continues))

    def _push(self, now_s: float, stream: str, moment_s: float, what) -> None:
        if moment_s < self._newest[stream] - self._rules.input.oldest_s:
            self._start_over()
        self._newest[stream] = max(self._newest[stream], moment_s)
        self._number += 1
        heapq.heappush(self._queue, (moment_s, self._number, what))
        mocap_s = max(
            self._newest["mocap"], now_s - self._rules.mocap_latency_s - self._rules.mocap_wait_s
        )
        ready_s = min(mocap_s, max(self._newest["vehicle"], now_s - self._rules.hold_s))
        before_s = self._time_s
        while self._queue and self._queue[0][0] <= ready_s:
            moment_s, _, what = heapq.heappop(self._queue)
            self._process(moment_s, what)
        # one pose goes out for all of them: one step, also where packets were lost
        if self._filter is not None:
            self._blend.advance(min(max(self._time_s - before_s, 0.0), _LONGEST_STEP_S))

    def _start_over(self) -> None:
        """The clock was set back: what came before it is of another time."""
        self.counts.count("clock set back")
        self._queue.clear()
        self._coming.clear()
        self._newest = {"mocap": -np.inf, "vehicle": -np.inf}
        self._odometry = _newest_poses()
        self._vehicle_s, self._imu = -np.inf, None
        self._forget("the clock was set back")

    def _process(self, moment_s: float, what) -> None:
        if self._filter is not None and moment_s < self._time_s - _LATEST_S:
            self.counts.count("too late")
            return
        self._advance(moment_s)
        late_s = max(0.0, self._time_s - moment_s)
        if isinstance(what, tuple):
            sample, delay_s, continues = what
            self._process_vehicle(moment_s, late_s, sample, delay_s, continues)
        else:
            self._process_mocap(moment_s, late_s, what)

    # -- the filter's steps
    # -----------------------------------------------------------------------------------------

    def _advance(self, moment_s: float) -> None:
        if self._filter is None:
            self._time_s = moment_s
            return
        while moment_s - self._time_s > 1e-9:
            dt_s = min(moment_s - self._time_s, _LONGEST_STEP_S)
            imu = self._imu_at(self._time_s + 0.5 * dt_s)
            self._time_s += dt_s
            self._coasting = imu is None
            if imu is None:
                self._filter.coast(dt_s, self._time_s - max(self._mocap_s, self._vehicle_s))
            else:
                rate_radps, accel_mps2, apart_s = imu
                self._filter.predict(rate_radps, accel_mps2, dt_s, apart_s)
        if self._time_s - max(self._mocap_s, self._vehicle_s) > self._rules.coast_s:
            self._forget(_SILENT, proven=True)

    def _imu_at(self, moment_s: float):
        """Rate, force and the seconds between the last sample and the next, which is mostly there
        already; or None.

        A sample that came too late for the filter lies before the moment asked for, and is not the
        next one.
        """
        while self._coming and (
            self._coming[0][0] <= self._vehicle_s or self._coming[0][0] < moment_s
        ):
            self._coming.popleft()
        last, following = self._imu, self._coming[0] if self._coming else None
        if (
            last is None
            or following is None
            or not 0.0 < following[0] - self._vehicle_s < self._rules.hold_s
        ):
            return None  # silent: rate and force of the last packet hold for 50 ms at most
        if not following[2]:
            return last.gyro_radps, last.accel_mps2, PERIOD_S
        gap_s, after = following[0] - self._vehicle_s, following[1]
        share = min(1.0, max(0.0, (moment_s - self._vehicle_s) / gap_s))
        # the turn between two attitudes, not the gyro's momentary reading: at 20 Hz that is
        # vibration
        rate = rotations.log(last.T_O_D[:3, :3].T @ after.T_O_D[:3, :3]) / gap_s
        return rate, (1 - share) * last.accel_mps2 + share * after.accel_mps2, gap_s

    def _process_vehicle(
        self, moment_s: float, late_s: float, sample: VehicleSample, delay_s: float, continues: bool
    ) -> None:
        silent_s = moment_s - self._vehicle_s
        self._vehicle_s, self._imu = moment_s, sample
        if self._filter is None:
            return
        if silent_s > self._rules.bridge_s and moment_s - self._mocap_s > self._rules.coast_s:
            self._forget("odometry was silent too long out of view: fly it into the mocap's view")
            return
        if not continues or silent_s > self._rules.bridge_s:
            self._filter.move_odometry(sample.T_O_D, 0.05 + silent_s * 0.1, np.radians(1.0))
            return
        self._correct_by_odometry(moment_s, sample, delay_s - late_s)

    def _correct_by_odometry(self, moment_s: float, sample: VehicleSample, delay_s: float) -> None:
        before = self._filter.state.T_M_D
        odometry = self._filter.odometry(sample.T_O_D[:3, 3], sample.v_O_mps, delay_s)
        off = odometry.distance2 > self._rules.gate_6
        if self._disputes.odometry(moment_s, off):
            self._forget(_CONTRADICTION)
        if off:
            return
        odometry.apply()
        attitude = self._filter.attitude(sample.T_O_D[:3, :3], sample.gyro_radps, delay_s)
        off = attitude.distance2 > self._rules.gate_3
        if self._disputes.attitude(moment_s, off):
            self._forget(_CONTRADICTION)
            return
        if not off:
            attitude.apply()
        self._blend.corrected(before, self._filter.state.T_M_D)

    def _process_mocap(self, moment_s: float, late_s: float, T_M_D: np.ndarray) -> None:
        if self._filter is None:
            T_M_D = self._anchor.add(moment_s, T_M_D, self._odometry)
            if T_M_D is not None and self._imu is not None:
                self._begin(moment_s, T_M_D)
            return
        correction = self._filter.mocap(self._moved_on(T_M_D, late_s))
        verdict = self._disputes.mocap(
            moment_s, correction, self._coasting, self._heading_confirmed
        )
        if verdict is MocapVerdict.CONTRADICTS:
            self._forget("mocap and odometry contradict each other: who is right is not known")
        if verdict is not MocapVerdict.TAKE:
            return
        before = self._filter.state.T_M_D
        correction.apply()
        self._blend.corrected(before, self._filter.state.T_M_D)
        self._mocap_s = moment_s
        self._disputes.mocap_agrees()
        moved_O = self._filter.state.R_M_O.T @ (T_M_D[:3, 3] - self._began_p_M)
        if float(np.hypot(moved_O[0], moved_O[1])) > self._rules.confirm_m:
            self._heading_confirmed, self.absent_because = True, ""

    def _moved_on(self, T_M_D: np.ndarray, late_s: float) -> np.ndarray:
        """A pose of a little before the filter's moment, as it would be now."""
        rate_radps = self._imu.gyro_radps if late_s and self._imu is not None else np.zeros(3)
        turned = T_M_D[:3, :3] @ rotations.exp(rate_radps * late_s)
        return transforms.transform(turned, T_M_D[:3, 3] + self._filter.state.v_M * late_s)

    def _begin(self, moment_s: float, T_M_D: np.ndarray) -> None:
        self._filter = MocapFilter(
            self._rules.noise,
            T_M_D,
            self._odometry.at(moment_s),
            self._imu.v_O_mps,
            self._rules.odometry_latency_s,
        )
        self._time_s = self._mocap_s = moment_s
        self._began_p_M = T_M_D[:3, 3].copy()
        self.counts.count("anchored")
        self._heading_confirmed = lies_as_before(self._proven_R_M_O, self._filter.state.R_M_O)
        self.absent_because = "" if self._heading_confirmed else _UNPROVEN

    def _forget(self, why: str, proven: bool = False) -> None:
        """No pose from here on, until mocap and odometry agree for half a second again.

        ``proven``: a heading that movement had proven stays proven, as over a silence of both when
        this program itself hung: nobody may move the vehicle then, and without a pose nobody flies
        it 0.3 m aside.
        """
        if not proven:
            self._proven_R_M_O = None
        elif self._filter is not None and self._heading_confirmed:
            self._proven_R_M_O = self._filter.state.R_M_O
        self._filter = None
        self._anchor.clear()
        self._time_s = self._mocap_s = -np.inf
        self._blend = _blend(self._rules)
        self._heading_confirmed = self._coasting = False
        self._disputes.clear()
        self.absent_because = why

    # -- what comes out
    # ---------------------------------------------------------------------------------------------

    @property
    def old_pose(self) -> bool:
        """Whether the mocap streams a pose of some time ago, as it does while the body is
        hidden."""
        return self._mocap_input.old_pose

    @property
    def filter(self) -> Optional[MocapFilter]:
        return self._filter

    def pose(self, now_s: float) -> Optional[TrackedPose]:
        """The newest pose, None where there is none to be trusted (``absent_because``)."""
        found = self.guess(now_s)
        if found is None or not found.heading_confirmed:
            return None
        if self._disputes.about_attitude:
            self.absent_because = "its own attitude contradicts the pose"
            return None
        return found

    def guess(self, now_s: float) -> Optional[TrackedPose]:
        """The same, and before movement has proven the heading a pose that may stand turned over in
        its right place."""
        if self._filter is None:
            return None
        if now_s - self._time_s > self._rules.coast_s + self._rules.hold_s:
            self._forget(_SILENT, proven=True)
            return None
        if self._time_s - max(self._vehicle_s, self._mocap_s) > self._rules.coast_s:
            return None
        if not self._heading_confirmed and self._time_s - self._mocap_s > _UNPROVEN_S:
            return None  # odometry may lead the wrong way
        state = self._filter.state
        T_M_D = self._blend.pose(state.T_M_D)
        covariance = self._filter.pose_covariance() + self._blend.covariance()
        if not self._heading_confirmed:
            # a body with the wrong marker in front fits equally well, and leans the other way
            up = state.R_M_D[:, 2]
            covariance[3:, 3:] += (0.5 * np.pi) ** 2 * np.outer(up, up) + np.radians(
                6.0
            ) ** 2 * np.eye(3)
        T_D_O = transforms.invert(state.T_M_D) @ state.T_M_O
        in_view = self._time_s - self._mocap_s < self._rules.hold_s
        return TrackedPose(
            self._time_s, T_M_D, T_M_D @ T_D_O, covariance, in_view, self._heading_confirmed
        )


def _newest_poses() -> Trajectory:
    return Trajectory(gap_s=0.2, keep_s=2.0)


def _blend(rules: TrackerRules) -> Blend:
    return Blend(rules.blend_mps, np.radians(rules.blend_degps))

# SPDX-License-Identifier: Apache-2.0
"""The odometry's process without its transport: samples of the tracking camera in, poses of the
body out."""

import logging
import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import frames
from fcsv_geometry.frozen import frozen
from fcsv_geometry.rotations import Quaternion, Vector
from fcsv_geometry.streams.flow import RateGate
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.tracker import TrackerProfile
from fcsv_tracking.errors import OdometryRejected
from fcsv_tracking.odometry import BodyOdometry, BodyPose, EpochBegan, GateParameters, Rebase

_LOG = logging.getLogger(__name__)
_FIRST = EpochBegan()


@frozen
class TrackerSample:
    """A pose of the tracking camera in its own odometry frame, velocities (m/s, rad/s) in its own;
    ``frames`` are the names of both, ``covariance`` (36,) is passed on as it is."""

    frames: Tuple[str, str]
    stamp_s: float
    p_m: Vector
    q_xyzw: Quaternion
    linear_mps: Vector
    angular_radps: Vector
    covariance: Sequence[float]


@frozen
class BodySample:
    """The body's pose of one sample; ``goes_on``: it is one of those for autopilot and radio."""

    pose: BodyPose
    covariance: Sequence[float]
    goes_on: bool


@dataclass(frozen=True)
class OdometryHealth:
    """What diagnostics say: an ``error`` or a ``warning``, in words (empty: none), and values by
    their names."""

    error: str
    warning: str
    values: Sequence[Tuple[str, object]]


class OdometryPort:
    """Gives BodySample, tm.OdometryEpoch, tm.Dropped, and Rebase where a new one must outlive this
    process; step it after each message."""

    def __init__(
        self,
        vehicle: str,
        T_body_t265: np.ndarray,
        tracker: TrackerProfile,
        state_rate_hz: float,
        gate: Optional[GateParameters] = None,
        rebase: Optional[Rebase] = None,
        epoch: EpochBegan = _FIRST,
    ):
        self._vehicle = vehicle
        self._frames = (tracker.odom_frame(vehicle), tracker.pose_frame(vehicle))
        self._core = BodyOdometry(T_body_t265, gate, rebase, tracker, epoch)
        self._state_gate = RateGate.bursting(state_rate_hz)
        self._epoch: Optional[EpochBegan] = None  # as it was told
        self._jumps = self._received = self._received_before = 0
        self._received_s, self._calibrated_s = -math.inf, 0.0
        self._out: List[object] = []

    def receive(self, now_s: float, message: object) -> None:
        """TrackerSample or tm.CalibrationFound came. Raises TypeError for anything else."""
        if isinstance(message, TrackerSample):
            self._sampled(now_s, message)
        elif isinstance(message, tm.CalibrationFound):
            if any(self._vehicle in (link.parent, link.child) for link in message.links):
                self._calibrated_s = message.stamp_s
        else:
            raise TypeError(f"an odometry takes no {type(message).__name__}")

    def step(self, _now_s: float) -> Sequence[object]:
        """What is to be sent now; another epoch before the first pose in it."""
        out, self._out = self._out, []
        if self._core.epoch is not self._epoch:
            epoch = self._epoch = self._core.epoch
            out.insert(0, tm.OdometryEpoch(self._vehicle, "", epoch.number, epoch.reason))
        return out

    def _sampled(self, now_s: float, m: TrackerSample) -> None:
        self._received, self._received_s = self._received + 1, now_s
        try:
            if m.frames != self._frames:
                raise self._core.reject(
                    "frames", f"odometry has frames {m.frames}, expected {self._frames}"
                )
            pose = self._core.add(m.stamp_s, m.p_m, m.q_xyzw, m.linear_mps, m.angular_radps, now_s)
        except OdometryRejected as error:
            self._out.append(tm.Dropped("odometry", str(error)))
            return
        self._out.append(BodySample(pose, m.covariance, self._state_gate.passes(now_s)))
        status = self._core.status
        if status.jumps != self._jumps:
            self._jumps = status.jumps
            _LOG.error(
                "%s: odometry jumped (number %d, largest %.2f m); undone for the autopilot, calibrate again",
                frames.odom(self._vehicle),
                status.jumps,
                status.largest_jump_m,
            )
            self._out.append(self._core.rebase)

    def health(self, now_s: float, stale_s: float) -> OdometryHealth:
        """Gives the health of now; a tracker that was silent for ``stale_s`` is an error. Samples
        count since the last call."""
        status, jumped_s = self._core.status, self._core.status.last_jump_stamp_s
        error = ""
        if now_s - self._received_s > stale_s:
            error = "no odometry from the tracking camera"
        elif status.lost:
            error = "tracker lost: it jumps again and again, pose withheld"
        elif jumped_s and self._calibrated_s < jumped_s:
            error = "odometry jumped: calibrate again"
        values = [
            ("samples in the last period", self._received - self._received_before),
            ("passed", status.passed),
            ("jumps", status.jumps),
            ("largest jump (m)", f"{status.largest_jump_m:.3f}"),
            ("largest jump (deg)", f"{math.degrees(status.largest_jump_rad):.1f}"),
            *((f"rejected: {reason}", count) for reason, count in sorted(status.rejected.items())),
        ]
        self._received_before = self._received
        return OdometryHealth(
            error, "odometry samples were rejected" if status.rejected else "", values
        )

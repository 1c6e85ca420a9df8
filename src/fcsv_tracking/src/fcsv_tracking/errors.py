# SPDX-License-Identifier: Apache-2.0
"""Errors of the trackers."""

from fcsv_geometry.errors import FcsvError


class TrackingError(FcsvError):
    """Base of this package's errors."""


class OdometryRejected(TrackingError):
    """A sample of the tracking camera that must not reach the autopilot; ``reason`` is its
    counter's name."""

    def __init__(self, reason: str, message: str):
        super().__init__(message)
        self.reason = reason


class SampleRejected(TrackingError):
    """A sample that the mocap tracker must not use; ``reason`` is its counter's name."""

    def __init__(self, reason: str, message: str):
        super().__init__(message)
        self.reason = reason


class TagError(TrackingError):
    """The tag detector cannot be set up, or cannot read a picture."""


class CalibrationRefused(TrackingError):
    """A calibration that would not be good enough; the message tells the operator what to do."""


class TrackerDrifts(CalibrationRefused):
    """A calibration in flight that differs from what the trackers said by more than is known of
    them."""


class ClocksApart(CalibrationRefused):
    """A calibration of vehicles whose clocks differ."""


class HomeRefused(TrackingError):
    """Home cannot be set now; the message says why."""


class CameraCalibrationRefused(TrackingError):
    """Pictures of a chessboard that would not give a good camera; the message says which and what
    to do."""


class ExtrinsicsRefused(TrackingError):
    """A motion or detections from which the mounting of camera or tag cannot be found; the message
    says why."""


class EvaluationError(TrackingError):
    """Trajectories that cannot be read or compared."""

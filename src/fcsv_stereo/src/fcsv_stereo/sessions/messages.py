# SPDX-License-Identifier: Apache-2.0
"""What the control PC says of a recording (/mission/capture), for bags and for live maps."""

import math
from typing import Tuple

import numpy as np

from fcsv_geometry import frames
from fcsv_geometry.messages import seconds
from fcsv_stereo.errors import InputError
from fcsv_stereo.in_flight.live import RecordingWindow
from fcsv_stereo.model import Axis, Configuration
from fcsv_stereo.pose_covariance import checked


def camera_covariance(message, vehicle: str) -> Tuple[float, np.ndarray]:
    """Stamp (s) and covariance (6, 6) of a camera_pose, as trackers publish it. Raises InputError
    where it is none."""
    if message.header.frame_id != frames.HOME:
        raise InputError(
            f"covariance of the pose of {vehicle} is of frame '{message.header.frame_id}', not home"
        )
    return seconds(message.header.stamp), checked(message.pose.covariance, vehicle)


def window_of(capture) -> RecordingWindow:
    """A recording window from its message."""
    c = capture.configuration
    axis = Axis.VERTICAL if c.axis == c.VERTICAL else Axis.HORIZONTAL
    configuration = Configuration(axis, c.baseline_m, c.tilt_rad, c.name)
    start_s, stop_s = seconds(capture.start), seconds(capture.stop)
    return RecordingWindow(
        capture.index,
        configuration,
        capture.reference,
        capture.vehicle,
        start_s,
        stop_s,
        view_of(capture),
    )


def view_of(capture) -> str:
    """From which station and heading a recording is, in words; empty: from home, or of a bag that
    knows no stations."""
    station = getattr(capture, "station", "")
    return f"{station} at {math.degrees(capture.heading_rad):.6g} deg" if station else ""

# SPDX-License-Identifier: Apache-2.0
"""What the control PC says of a recording (/mission/capture), for bags and for live maps."""

from fcsv_stereo.live import Window
from fcsv_stereo.model import Axis, Configuration


def window_of(capture) -> Window:
    """A recording window from its message."""
    c = capture.configuration
    axis = Axis.VERTICAL if c.axis == c.VERTICAL else Axis.HORIZONTAL
    configuration = Configuration(axis, c.baseline_m, c.tilt_rad, c.name)
    start_s, stop_s = capture.start.to_sec(), capture.stop.to_sec()
    return Window(capture.index, configuration, capture.reference, capture.vehicle, start_s, stop_s)

# SPDX-License-Identifier: Apache-2.0
"""Where the lines of a vehicle become amber and red."""

from dataclasses import dataclass

from fcsv_geometry.config import require_graded, require_positive
from fcsv_geometry.vehicles import thresholds as at


@dataclass(frozen=True)
class VehicleCheckRules:
    """``red_*`` and ``amber_*`` are bounds; what is worse than the red one is red. Those that
    forbid GUIDED on board have the guardian's figures (``guardian/rules.py``)."""

    silent_s: float = at.OFTEN_AGE_S.check.red  # of what comes at least five times a second
    slow_silent_s: float = at.SLOW_AGE_S.check.red  # of what comes once a second
    red_position_hz: float = at.POSITION_HZ.check.red  # of 30 that the autopilot is asked for
    amber_position_hz: float = at.POSITION_HZ.check.amber  # likewise
    red_feed_hz: float = at.FEED_HZ.check.red  # of 30 that go to the autopilot
    amber_feed_hz: float = at.FEED_HZ.check.amber  # likewise
    red_feed_age_s: float = at.POSE_AGE_S.check.red  # of the newest pose
    red_ekf_variance: float = at.EKF_VARIANCE.check.red  # of the worst of the filter's variances
    amber_ekf_variance: float = at.EKF_VARIANCE.check.amber  # likewise
    red_apart_m: float = at.APART_M.check.red  # between estimate and feed, on the ground
    amber_apart_m: float = at.APART_M.check.amber  # likewise
    red_apart_in_flight_m: float = at.APART_IN_FLIGHT_M.check.red  # the estimate is late
    red_battery: float = at.BATTERY.check.red  # share of the charge
    amber_battery: float = at.BATTERY.check.amber  # likewise
    amber_picture_hz: float = at.PICTURE_HZ.check.amber  # fewer pictures that come are amber
    red_disk_mib: float = at.DISK_MIB.check.red  # the recorder stops at 500
    amber_disk_mib: float = at.DISK_MIB.check.amber  # some 25 minutes of pictures at 5.5 Hz

    def __post_init__(self):
        require_positive(self)
        require_graded(self)

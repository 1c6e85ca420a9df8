# SPDX-License-Identifier: Apache-2.0
"""Where the lines of a vehicle become amber and red."""

from dataclasses import dataclass

from fcsv_geometry.config import require_positive


@dataclass(frozen=True)
class VehicleCheckRules:
    """``red_*`` and ``amber_*`` are bounds; what is worse than the red one is red. Those that
    forbid GUIDED on board have the guardian's figures (``guardian/rules.py``)."""

    silent_s: float = 2.0  # of what comes at least five times a second
    slow_silent_s: float = 5.0  # of what comes once a second
    red_position_hz: float = 5.0  # of 30 that the autopilot is asked for
    amber_position_hz: float = 15.0  # likewise
    red_feed_hz: float = 8.0  # of 30 that go to the autopilot
    amber_feed_hz: float = 15.0  # likewise
    red_feed_age_s: float = 0.5  # of the newest pose
    red_ekf_variance: float = 0.8  # of the worst of the filter's variances
    amber_ekf_variance: float = 0.5  # likewise
    red_apart_m: float = 0.5  # between estimate and feed, on the ground
    amber_apart_m: float = 0.2  # likewise
    red_apart_in_flight_m: float = 1.0  # the estimate is later than the feed
    red_battery: float = 0.2  # share of the charge
    amber_battery: float = 0.4  # likewise
    amber_picture_hz: float = 0.5  # fewer pictures that come are amber
    red_disk_mib: float = 1000.0  # the recorder stops at 500
    amber_disk_mib: float = 8000.0  # of pictures of 640 x 480 at 5.5 Hz some 25 minutes

    def __post_init__(self):
        require_positive(self)
        for low, high in (
            ("red_position_hz", "amber_position_hz"),
            ("red_feed_hz", "amber_feed_hz"),
            ("amber_ekf_variance", "red_ekf_variance"),
            ("amber_apart_m", "red_apart_m"),
            ("red_battery", "amber_battery"),
            ("red_disk_mib", "amber_disk_mib"),
        ):
            if getattr(self, low) > getattr(self, high):
                raise ValueError(
                    f"{low}: {getattr(self, low)} is over {high} {getattr(self, high)}"
                )

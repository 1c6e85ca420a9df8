# SPDX-License-Identifier: Apache-2.0
"""What a guardian watches for, and when it acts."""

from dataclasses import dataclass, field

from fcsv_geometry.config import require_positive
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.separation import LOST_CLEAR_M, SeparationRules

NEVER = "never"
LINK_LOSS = ("land", NEVER)


@dataclass(frozen=True)
class GuardianRules:
    """Times in s, shares of the battery, angles in degrees. ``link_loss`` "never" must be written: then a vehicle
    without its control PC holds until the battery is low."""

    feed_warn_s: float = 0.5
    feed_land_s: float = 0.7  # before the flight link's own watchdog, which is the second line
    finds_again: bool = False  # a tracker on the ground knows a place as soon as it sees it; on board ways add up
    feed_warn_hz: float = 8.0
    feed_land_hz: float = 4.0
    apart_m: float = 0.5  # between estimate and feed, on the ground
    ekf_variance: float = 0.8  # ArduCopter's own bound, FS_EKF_THRESH
    ekf_s: float = 0.5
    confidence: float = 1.0  # T265: 0 failed, 1 low, 2 medium, 3 high; up to here is low
    confidence_hold_s: float = 1.0
    confidence_land_s: float = 4.0
    tilt_warn_deg: float = 30.0
    tilt_land_deg: float = 50.0
    tilt_s: float = 0.3
    low_battery: float = 0.2
    low_battery_s: float = 60.0  # so long the mission has to bring it down
    empty_battery: float = 0.1
    home_s: float = 10.0  # low, and so long without the control PC: home; a mission that restarts is back by then
    battery_s: float = 2.0  # a voltage that sags for a moment is no empty battery
    battery_old_s: float = 10.0  # what was heard of it counts for so long
    link_warn_s: float = 2.0
    link_hold_s: float = 30.0  # without the control PC: then aside and LAND
    link_loss: str = "land"
    agent_silent_s: float = 1.0
    agent_land_s: float = 15.0
    link_silent_s: float = 2.0
    transmitter: bool = True  # without one that is heard no hand-over: nobody could take over
    throttle_middle: float = 0.25  # of the stick's way either side
    fence: Fence = field(default_factory=lambda: Fence(0.3, 45.0, 100.0))
    fence_land_m: float = 5.0  # further out than this: LAND
    mission_fence_slack_m: float = 1.0  # a mission's own fence, in which every way was planned, counts from so far out
    separation: SeparationRules = field(default_factory=SeparationRules)
    clear_m: float = 2.5  # horizontally, for one to come down beside another
    beside_m: float = 1.8  # likewise, where both fly at one height
    uncontrolled_clear_m: float = LOST_CLEAR_M  # likewise, of one that comes down without a position
    unruly_s: float = 1.0  # so long one may be above or below a vehicle that is in other hands, or lost
    silent_above_s: float = 1.5  # who was above and is silent for so long may come down
    aside_s: float = 15.0  # longest way aside
    obey_s: float = 1.0  # a mode that does not show by then: the next one

    def __post_init__(self):
        require_positive(self)
        if self.link_loss not in LINK_LOSS:
            raise ValueError(f"link_loss: '{self.link_loss}' is not one of {', '.join(LINK_LOSS)}")
        for low, high in (("feed_warn_s", "feed_land_s"), ("feed_land_hz", "feed_warn_hz"),
                          ("empty_battery", "low_battery"), ("tilt_warn_deg", "tilt_land_deg")):  # fmt: skip
            if getattr(self, low) > getattr(self, high):
                raise ValueError(f"{low}: {getattr(self, low)} is over {high} {getattr(self, high)}")

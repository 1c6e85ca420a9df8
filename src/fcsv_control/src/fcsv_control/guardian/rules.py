# SPDX-License-Identifier: Apache-2.0
"""What a guardian watches for, and when it acts."""

from dataclasses import dataclass, field

from fcsv_geometry.config import require_in_order, require_positive
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.separation import LOST_CLEAR_M, SeparationRules
from fcsv_geometry.vehicles import thresholds as at

NEVER = "never"
LINK_LOSS = ("land", NEVER)


@dataclass(frozen=True)
class GuardianRules:
    """Times in s, shares of the battery, angles in degrees. ``link_loss`` "never" must be written:
    then a vehicle without its control PC holds until the battery is low."""

    feed_warn_s: float = at.POSE_AGE_S.guardian.amber  # no pose for so long: a warning
    feed_land_s: float = at.POSE_AGE_S.guardian.red  # LAND, before the flight link's own watchdog
    # a tracker on the ground knows a place as soon as it sees it; on board ways add up
    finds_again: bool = False
    feed_warn_hz: float = at.FEED_HZ.guardian.amber  # fewer poses a second for 1 s: a warning
    feed_land_hz: float = at.FEED_HZ.guardian.red  # likewise: LAND
    apart_m: float = at.APART_M.guardian.red  # between estimate and feed, on the ground
    ekf_variance: float = at.EKF_VARIANCE.guardian.red  # ArduCopter's own bound, FS_EKF_THRESH
    ekf_s: float = 0.5  # above ekf_variance for so long: LAND
    confidence: float = at.CONFIDENCE.guardian.red  # up to here is low: 1 of 0..3
    confidence_hold_s: float = 1.0  # low for so long: it holds
    confidence_land_s: float = 4.0  # low for so long: LAND
    tilt_warn_deg: float = at.TILT_DEG.guardian.amber  # leans further: a warning
    tilt_land_deg: float = at.TILT_DEG.guardian.red  # leans further: LAND
    tilt_s: float = 0.3  # for so long
    low_battery: float = at.BATTERY.guardian.amber  # a share below is low
    low_battery_s: float = 60.0  # so long the mission has to bring it down
    empty_battery: float = at.BATTERY.guardian.red  # a share below: LAND
    # low, and so long without the control PC: home; a mission that restarts is back by then
    home_s: float = 10.0
    battery_s: float = 2.0  # a voltage that sags for a moment is no empty battery
    battery_old_s: float = at.BATTERY_AGE_S.guardian.red  # its last word counts for so long
    link_warn_s: float = at.CONTROL_AGE_S.guardian.amber  # without the control PC: a warning
    link_hold_s: float = at.CONTROL_AGE_S.guardian.red  # likewise: aside, then LAND
    link_loss: str = "land"  # what follows link_hold_s; "never": it holds until the battery is low
    agent_silent_s: float = at.AGENT_AGE_S.guardian.amber  # its agent is silent: it holds
    agent_land_s: float = at.AGENT_AGE_S.guardian.red  # and for so long: LAND
    link_silent_s: float = at.LINK_AGE_S.guardian.red  # its flight link is silent: restarted
    transmitter: bool = True  # without one that is heard no hand-over: nobody could take over
    throttle_middle: float = at.STICK.guardian.red  # of the stick's way either side
    # of the place, for every mission
    fence: Fence = field(default_factory=lambda: Fence(0.3, 45.0, 100.0))
    fence_land_m: float = 5.0  # further out than this: LAND
    # a mission's own fence, in which every way was planned, counts from so far out
    mission_fence_slack_m: float = 1.0
    separation: SeparationRules = field(default_factory=SeparationRules)  # the air that is its own
    clear_m: float = 2.5  # horizontally, for one to come down beside another
    beside_m: float = 1.8  # likewise, where both fly at one height
    # likewise, of one that comes down without a position
    uncontrolled_clear_m: float = LOST_CLEAR_M
    # so long one may be above or below a vehicle that is in other hands, or lost
    unruly_s: float = 1.0
    silent_above_s: float = at.OTHER_AGE_S.guardian.amber  # who was above may come down then
    aside_s: float = 15.0  # longest way aside
    obey_s: float = 1.0  # a mode that does not show by then: the next one

    def __post_init__(self):
        require_positive(self)
        if self.link_loss not in LINK_LOSS:
            raise ValueError(f"link_loss: '{self.link_loss}' is not one of {', '.join(LINK_LOSS)}")
        require_in_order(
            self,
            ("feed_warn_s", "feed_land_s"),
            ("feed_land_hz", "feed_warn_hz"),
            ("empty_battery", "low_battery"),
            ("tilt_warn_deg", "tilt_land_deg"),
        )

# SPDX-License-Identifier: Apache-2.0
"""When the Tello link holds, lands and gives way."""

from dataclasses import dataclass

from fcsv_geometry.config import require_in_order, require_positive
from fcsv_geometry.vehicles import thresholds as at
from fcsv_geometry.vehicles.modes import Mode

PILOT, GUIDED, BRAKE, LAND = Mode.LOITER, Mode.GUIDED, Mode.BRAKE, Mode.LAND
#: Modes in which the companion flies; in LOITER the pilot does, and zero sticks hold by the Tello's
#: own flow sensor.
MODES = (PILOT, GUIDED, BRAKE, LAND)


@dataclass(frozen=True)
class TelloRules:
    """Times in s. ``feed_*``: age of the tracker's newest good pose.

    A Tello that hears no sticks for 15 s lands by itself.
    """

    # no position is flown by an older pose: zero sticks, its own flow sensor holds
    feed_old_s: float = at.POSE_AGE_S.tello.amber
    feed_land_s: float = at.POSE_AGE_S.tello.red  # lost for so long: LAND
    feed_steady_s: float = 1.0  # for so long poses must have come before GUIDED is taken
    doubt_s: float = 1.0  # poses that cannot be, for so long: said
    silent_s: float = at.LINK_AGE_S.tello.amber  # without any packet: the Wi-Fi counts as lost
    silent_land_s: float = at.LINK_AGE_S.tello.red  # lost for so long: LAND, as soon as it hears
    pilot_old_s: float = 0.5  # of the pilot's sticks; older ones are let go
    pilot_moved: float = 0.2  # a stick moved so far takes the vehicle
    warn_battery: float = at.BATTERY.tello.amber
    land_battery: float = at.BATTERY.tello.red  # as the Tello itself does at about 5 %
    take_off_s: float = 8.0  # to leave the ground
    climb_s: float = 15.0  # to the altitude asked for
    highest_m: float = 9.0  # of a take-off; the Tello's own limit is 10 m
    repeat_s: float = 1.0  # of a take-off or landing that does not show

    def __post_init__(self):
        require_positive(self)
        require_in_order(
            self,
            ("feed_old_s", "feed_land_s"),
            ("silent_s", "silent_land_s"),
            ("land_battery", "warn_battery"),
        )

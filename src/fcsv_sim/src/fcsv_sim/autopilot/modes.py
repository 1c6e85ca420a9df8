# SPDX-License-Identifier: Apache-2.0
"""ArduCopter's flight modes, as far as they are flown here, and what each needs."""

from fcsv_geometry.vehicles.modes import Mode

STABILIZE, ALT_HOLD, GUIDED, LOITER, LAND, BRAKE = 0, 2, 4, 5, 9, 17
NAMES = {
    STABILIZE: Mode.STABILIZE,
    ALT_HOLD: Mode.ALT_HOLD,
    GUIDED: Mode.GUIDED,
    LOITER: Mode.LOITER,
    LAND: Mode.LAND,
    BRAKE: Mode.BRAKE,
}
NUMBERS = {name: number for number, name in NAMES.items()}
NEEDS_POSITION = {GUIDED, LOITER, BRAKE}
POSITION_CONTROL = {GUIDED, LOITER, BRAKE, LAND}
MANUAL_ARMING = {STABILIZE, ALT_HOLD, LOITER}  # modes that may be armed with the sticks

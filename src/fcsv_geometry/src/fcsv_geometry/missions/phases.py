# SPDX-License-Identifier: Apache-2.0
"""The phases of a mission, as MissionState.msg numbers them, and which of them are alike.

Before GUIDED people fly. A mission that is ABORTED has given its vehicles back.
"""

PHASES = (
    "WAIT_VEHICLES",
    "TAKE_OFF",
    "COLUMN",
    "CALIBRATE",
    "MOVE_HOME",
    "SET_HOME",
    "GUIDED",
    "CONFIGURATIONS",
    "LAND",
    "DONE",
    "ABORTED",
)
FLOWN = ("GUIDED", "CONFIGURATIONS")  # the mission sends the vehicles to places
BY_HOME = (*FLOWN, "LAND")  # it flies by calibration and home: neither may change
OVER = ("DONE", "ABORTED")

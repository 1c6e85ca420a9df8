# SPDX-License-Identifier: Apache-2.0
"""The rig's servos: one or two MX-12W on the bus of the gimbals' driver; behind it a simulated bus
in tests."""

from typing import Callable, Dict, NamedTuple

from fcsv_tracking.gimbal.dynamixel import DynamixelAxes, DynamixelAxis, DynamixelBus
from fcsv_tracking.tilting.rig import SIDES, TiltAngles, TiltingRig


class TiltReading(NamedTuple):
    """How the cameras stood at ``stamp_s``."""

    stamp_s: float
    angles: TiltAngles


class TiltServos:
    """Turns and reads a rig's sides; a geared side has the other one's angle. Every call may raise
    ServoError."""

    def __init__(
        self,
        bus: DynamixelBus,
        rig: TiltingRig,
        clock: Callable[[], float],
        speed_degps: float = 60.0,
        acceleration_degps2: float = 500.0,
    ):
        sides = [(side, getattr(rig, side).servo) for side in SIDES]
        axes = [DynamixelAxis(side, s.id, s.zero, s.sign) for side, s in sides if s is not None]
        self._rig = rig
        self._axes = DynamixelAxes(bus, axes, clock, speed_degps, acceleration_degps2)

    def turn(self, angles: TiltAngles) -> None:
        """Turn there, inside the rig's limits, and hold."""
        angles = self._rig.clipped(angles)
        self._axes.turn_axes(angles[:1] if self._rig.coupled else angles)

    def read(self) -> TiltReading:
        """Both angles at one moment."""
        stamp_s, angles = self._axes.read_axes()
        return TiltReading(stamp_s, TiltAngles(angles[0], angles[-1]))

    def health(self) -> Dict[str, str]:
        """Gives figures, for diagnostics, by name."""
        return self._axes.health()

    def close(self) -> None:
        """Torque off."""
        self._axes.close()

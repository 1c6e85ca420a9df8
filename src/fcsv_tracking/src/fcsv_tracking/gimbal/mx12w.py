# SPDX-License-Identifier: Apache-2.0
"""The Robotis MX-12W's control table and units (its e-manual). It speaks protocol 1.0 and nothing
else."""

from typing import List, NamedTuple

import numpy as np


class Register(NamedTuple):
    """Address and length (bytes, little-endian)."""

    address: int
    length: int


MODEL_NUMBER = 360
MODEL = Register(0, 2)
CW_LIMIT, CCW_LIMIT = Register(6, 2), Register(8, 2)
TORQUE_ENABLE = Register(24, 1)
GOAL_POSITION = Register(30, 2)
MOVING_SPEED = Register(32, 2)
PRESENT = Register(36, 8)  # position, speed, load (2 each), voltage, temperature (1 each)
GOAL_ACCELERATION = Register(73, 1)

TICK_RAD = 2.0 * np.pi / 4096.0
SPEED_DEGPS = 0.916 * 6.0  # a unit is 0.916 rpm; 0 is as fast as it goes
ACCELERATION_DEGPS2 = 8.583  # likewise
MOST_SPEED, MOST_ACCELERATION = 1023, 254

#: Bits of the error byte in every answer, in order, and what to do.
_ERRORS = (
    (0x01, "input voltage out of range: check the 12 V supply"),
    (0x02, "goal outside its angle limits: make the gimbal's limits narrower than the servo's"),
    (0x04, "overheated: let it cool, then switch it off and on"),
    (0x08, "value out of range"),
    (0x10, "received a damaged packet: check cable and baud rate"),
    (0x20, "overloaded: free the gimbal, then switch it off and on"),
    (0x40, "does not know the instruction: is it an MX-12W?"),
)


class Present(NamedTuple):
    """What PRESENT holds."""

    position: int
    load: float  # share of the greatest torque, positive counter-clockwise
    voltage_v: float
    temperature_c: int


def errors(bits: int) -> List[str]:
    """What an error byte says.

    >>> errors(0x20)
    ['overloaded: free the gimbal, then switch it off and on']
    """
    return [text for bit, text in _ERRORS if bits & bit]


def present(raw: List[int]) -> Present:
    """
    >>> present([0, 8, 0, 0, 100, 4, 121, 40])
    Present(position=2048, load=-0.1, voltage_v=12.1, temperature_c=40)
    """
    load = (raw[4] | raw[5] << 8) & 0x7FF
    return Present(
        raw[0] | raw[1] << 8,
        (load & 0x3FF) / 1000.0 * (-1.0 if load & 0x400 else 1.0),
        raw[6] / 10.0,
        raw[7],
    )


def speed_units(speed_degps: float) -> int:
    """Gives at least 1: 0 would be the greatest speed."""
    return int(np.clip(round(speed_degps / SPEED_DEGPS), 1, MOST_SPEED))


def acceleration_units(acceleration_degps2: float) -> int:
    return int(np.clip(round(acceleration_degps2 / ACCELERATION_DEGPS2), 1, MOST_ACCELERATION))

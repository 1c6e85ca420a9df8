# SPDX-License-Identifier: Apache-2.0
"""Numbers in MAVLink messages: east and north swapped, and such as the autopilot does not take."""

import math
from typing import Tuple

from fcsv_geometry import rotations

_FARTHEST = 1e6  # m, m/s, rad: the real filter bounds its position so


def ned(p_ext_m) -> Tuple[float, float, float]:
    """East-north-up to north-east-down."""
    x, y, z = p_ext_m.tolist()
    return y, x, -z


def heading(yaw_rad: float) -> float:
    """Counter-clockwise from east to clockwise from north, and back: the map is its own inverse."""
    return rotations.wrap(math.pi / 2 - yaw_rad)


def usable(*values: float) -> bool:
    """Whether all are numbers with which one can fly.

    >>> usable(1.0, -3.0), usable(float("nan")), usable(0.0, 3e38)
    (True, False, False)
    """
    for value in values:
        if not abs(value) <= _FARTHEST:
            return False
    return True


def whole(value: float) -> int:
    """A number of a mode or a message that came as a float; -1 where it is none."""
    return int(value) if math.isfinite(value) else -1

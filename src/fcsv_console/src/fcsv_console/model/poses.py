# SPDX-License-Identifier: Apache-2.0
"""Where a vehicle's camera is against another's: distance, vector, turn."""

import math
from dataclasses import dataclass
from typing import Tuple

from fcsv_console.model.facts import CameraPoseReport

Vector3 = Tuple[float, float, float]


@dataclass(frozen=True)
class Relative:
    """Leads from the camera of ``other`` to this one, along home's axes; ``yaw_rad``: its heading
    minus the other's.

    ``known`` is False where one of both places is not known, or stale; the figures are NaN then.
    """

    other: str
    p_home_m: Vector3 = (math.nan, math.nan, math.nan)
    distance_m: float = math.nan
    yaw_rad: float = math.nan

    @property
    def known(self) -> bool:
        return not math.isnan(self.distance_m)


def relative(place: CameraPoseReport, other: CameraPoseReport) -> Relative:
    """Both in home.

    >>> r = relative(CameraPoseReport("uav2", (0.0, -6.0, 8.0), 3.1), CameraPoseReport("uav1", (0.0, 0.0, 0.0), -3.1))
    >>> r.p_home_m, r.distance_m, round(r.yaw_rad, 3)
    ((0.0, -6.0, 8.0), 10.0, -0.083)
    """
    x, y, z = (a - b for a, b in zip(place.p_home_m, other.p_home_m))
    yaw_rad = (place.heading_rad - other.heading_rad + math.pi) % (2.0 * math.pi) - math.pi
    return Relative(other.vehicle, (x, y, z), math.sqrt(x * x + y * y + z * z), yaw_rad)

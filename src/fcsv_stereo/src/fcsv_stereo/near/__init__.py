# SPDX-License-Identifier: Apache-2.0
"""The near field: frames of a depth camera along the whole flight, summed in home and joined with a
map (thesis 6.8).

docs/user/maps.md says how it is used and what it reaches.
"""

from fcsv_stereo.near.frame import DepthFrame, Thinning
from fcsv_stereo.near.join import NEAR_BASELINE, NearJoin, join
from fcsv_stereo.near.mapping import with_near
from fcsv_stereo.near.sensor import DepthSensor
from fcsv_stereo.near.surface import NearPoints, NearSurface
from fcsv_stereo.near.volume import NearRules, NearVolume

__all__ = [
    "NEAR_BASELINE",
    "DepthFrame",
    "DepthSensor",
    "NearJoin",
    "NearPoints",
    "NearRules",
    "NearSurface",
    "NearVolume",
    "Thinning",
    "join",
    "with_near",
]

# SPDX-License-Identifier: Apache-2.0
"""The near field: frames of a depth camera along the whole flight, summed in home and joined with a map (thesis 6.8).

docs/near.md says how it is used and what it reaches.
"""

from fcsv_stereo.near.frame import DepthFrame, worth_it
from fcsv_stereo.near.sensor import DepthSensor
from fcsv_stereo.near.surface import NearPoints, NearSurface
from fcsv_stereo.near.volume import NearRules, NearVolume

__all__ = ["DepthFrame", "DepthSensor", "NearPoints", "NearRules", "NearSurface", "NearVolume", "worth_it"]

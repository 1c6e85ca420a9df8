# SPDX-License-Identifier: Apache-2.0
"""One flat float32 array with all that surfaces look up: a kernel that is handed one array instead
of ten is three times as fast (every array that numba passes or slices is counted and unpacked)."""

import numpy as np

from fcsv_sim.render.noise import PYRAMID_SIZE, noise_pyramid
from fcsv_sim.world.materials import COLUMNS
from fcsv_sim.world.town import Town

_MOST_STREETS = 31
_NOWHERE_M = 1e6  # a street that no one sees
AVENUES = PYRAMID_SIZE  # how many, then their t (m)
CROSSINGS = AVENUES + _MOST_STREETS + 1  # how many, then their s (m)
BEND = CROSSINGS + _MOST_STREETS + 1  # sideways shift (m) per metre of s from 0
BEND_SIZE = 1024
COVER = BEND + BEND_SIZE  # colour (3) and share of what lies on the ground
FARMLAND = COVER + 4  # 1 where the ground is a patchwork of crops
PARAMETERS = FARMLAND + 1  # the instance table


def flat_data(town: Town) -> np.ndarray:
    """Noise pyramid, streets, bend and instance parameters of a town."""
    data = np.zeros(PARAMETERS + COLUMNS * len(town.parameters), np.float32)
    data[:PYRAMID_SIZE] = noise_pyramid(town.seed)
    for start, streets in ((AVENUES, town.plan.avenues_t), (CROSSINGS, town.plan.crossings_s)):
        data[start] = len(streets)
        data[start + 1 : start + 1 + _MOST_STREETS] = _NOWHERE_M
        data[start + 1 : start + 1 + len(streets)] = streets
    data[BEND : BEND + BEND_SIZE] = town.plan.bend(np.arange(float(BEND_SIZE)))
    data[COVER : COVER + 3], data[COVER + 3] = town.plan.cover.colour, town.plan.cover.share
    data[FARMLAND] = float(town.plan.farmland)
    data[PARAMETERS:] = town.parameters.ravel()
    return data

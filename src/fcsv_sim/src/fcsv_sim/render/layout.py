# SPDX-License-Identifier: Apache-2.0
"""One flat float32 array with all that surfaces look up: a kernel that is handed one array instead of ten is three
times as fast (every array that numba passes or slices is counted and unpacked)."""

import numpy as np

from fcsv_sim.render.noise import PYRAMID_SIZE, noise_pyramid
from fcsv_sim.world.materials import COLUMNS
from fcsv_sim.world.town import Town

_MOST_STREETS = 31
AVENUES = PYRAMID_SIZE  # how many, then their t (m)
CROSSINGS = AVENUES + _MOST_STREETS + 1  # how many, then their s (m)
BEND = CROSSINGS + _MOST_STREETS + 1  # sideways shift (m) per metre of s from 0
BEND_SIZE = 1024
PARAMETERS = BEND + BEND_SIZE  # the instance table


def flat_data(town: Town) -> np.ndarray:
    """Noise pyramid, streets, bend and instance parameters of a town."""
    data = np.zeros(PARAMETERS + COLUMNS * len(town.parameters), np.float32)
    data[:PYRAMID_SIZE] = noise_pyramid(town.seed)
    for start, streets in ((AVENUES, town.plan.avenues_t), (CROSSINGS, town.plan.crossings_s)):
        data[start] = len(streets)
        data[start + 1 : start + 1 + len(streets)] = streets
    data[BEND : BEND + BEND_SIZE] = town.plan.bend(np.arange(float(BEND_SIZE)))
    data[PARAMETERS:] = town.parameters.ravel()
    return data

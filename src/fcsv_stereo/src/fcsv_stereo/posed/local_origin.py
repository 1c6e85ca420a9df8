# SPDX-License-Identifier: Apache-2.0
"""Models far from their world's origin (UTM): mapped in coordinates near the cameras, so that
float32 holds them.

The shift is whole numbers. What is written in float64 (report.json, COLMAP, LAZ, world files,
calibration.yaml) is in home all the same; map.ply and map.pcd are float32 and say the shift in
their header.
"""

from dataclasses import replace
from typing import Dict

import numpy as np

from fcsv_stereo.model import ConfigurationInput, MapInput, Picture

#: So many times the median baseline away float32 has steps of 1/16000 of that baseline.
_FAR_BASELINES = 1000.0


def with_local_origin(given: MapInput) -> MapInput:
    """The same input where it stands near home's origin; else with poses relative to ``origin_m``
    near its cameras."""
    pictures = [p for c in given.configurations for p in (*c.references, *c.others)]
    places = np.array([p.T_home_cam[:3, 3] for p in pictures])
    away_m = np.sort(np.linalg.norm(places - places[0], axis=1))
    away_m = away_m[away_m > 0.0]
    baseline_m = float(away_m[(len(away_m) - 1) // 2]) if len(away_m) else 0.0
    if not np.abs(places).max() > _FAR_BASELINES * baseline_m > 0.0:
        return given
    step = 10.0 ** max(0.0, np.ceil(np.log10(baseline_m)))
    origin_m = np.round(places[0] / step) * step
    shifted: Dict[int, Picture] = {
        id(p): replace(p, T_home_cam=moved(p.T_home_cam, -origin_m)) for p in pictures
    }
    configurations = [
        ConfigurationInput(
            c.configuration, *([shifted[id(p)] for p in some] for some in (c.references, c.others))
        )
        for c in given.configurations
    ]
    return replace(given, configurations=configurations, origin_m=origin_m)


def moved(T_home_cam: np.ndarray, by_m: np.ndarray) -> np.ndarray:
    """A pose shifted.

    >>> moved(np.eye(4), np.array([1.0, 2.0, 3.0]))[:3, 3].tolist()
    [1.0, 2.0, 3.0]
    """
    T = np.array(T_home_cam, float)
    T[:3, 3] += by_m
    return T

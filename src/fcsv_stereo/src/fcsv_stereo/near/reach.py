# SPDX-License-Identifier: Apache-2.0
"""Which surfaces stood near enough to a depth camera for it to know them."""

from typing import List, Tuple

import numpy as np
from scipy.spatial import cKDTree

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.depth import pixels_of

View = Tuple[PinholeCamera, np.ndarray]


def within_reach(points_home_m: np.ndarray, views: List[View], most_m: float) -> np.ndarray:
    """(N,) bool: which of the points (N,3) had no more than ``most_m`` to a view (camera and
    T_home_cam): its place, or along the optical axis where they are in its picture."""
    places = np.array([T_home_cam[:3, 3] for _, T_home_cam in views])
    near = cKDTree(places).query(points_home_m)[0] <= most_m
    for camera, T_home_cam in views:
        left = np.flatnonzero(~near)
        if not len(left):
            break
        _, _, z, inside = pixels_of(camera, T_home_cam, points_home_m[left])
        near[left] = inside & (z <= most_m)
    return near

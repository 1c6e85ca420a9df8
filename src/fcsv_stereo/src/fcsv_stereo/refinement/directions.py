# SPDX-License-Identifier: Apache-2.0
"""Baselines that are all turned by one angle against the cameras: a principal point, or a mounting, that is wrong.

A principal point that is off by d px turns every ray by d / f, and so the direction of every baseline as the pictures
see it; which of both it was, the pictures do not tell.
"""

from typing import List

import numpy as np

from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.features import View
from fcsv_stereo.refinement.graph import prior_to_reference
from fcsv_stereo.refinement.types import RefineOptions

_LEAST_PICTURES = 3
_IMPROBABLE = 25.0  # squared standard deviations that the turn must explain
_LEAST_SHARE = 0.6  # of what the positions are off that it must explain
_USUAL_RAD = 0.1  # standard deviation: principal points are off by up to a tenth of the focal length
_LEAST_RAD = np.radians(0.5)


def turned_baselines(views: List[View], consensus: Consensus, options: RefineOptions) -> str:
    """In words, where one turn explains how the pictures' positions differ from the stated ones; else empty."""
    adjusted = consensus.adjusted
    if adjusted is None or len(adjusted.order) < _LEAST_PICTURES:
        return ""
    rows, off = [], []
    for k in adjusted.order:
        prior = prior_to_reference(views, k, options.prior)
        p_m, sigma_m = prior.T_a_b[:3, 3], prior.position_m
        rows.append(_cross(p_m) / -sigma_m)
        off.append((adjusted.poses[k][:3, 3] - p_m) / sigma_m)
    A, b = np.vstack(rows)[:, :2], np.concatenate(off)  # a shift of the picture is a turn about its x and y
    turn = np.linalg.solve(A.T @ A + np.eye(2) / _USUAL_RAD**2, A.T @ b)
    before, after = float(b @ b), float(np.sum(np.square(b - A @ turn)))
    angle_rad = float(np.linalg.norm(turn))
    if before - after < max(_IMPROBABLE, _LEAST_SHARE * before) or angle_rad < _LEAST_RAD:
        return ""
    off_px = angle_rad * views[0].picture.camera.fx
    return (
        f"the baselines of all pictures are turned by {np.degrees(angle_rad):.1f} degrees against the cameras: the "
        f"principal point is off by some {off_px:.0f} px, or the cameras are mounted or posed otherwise than stated; "
        "calibrate the camera"
    )


def _cross(p: np.ndarray) -> np.ndarray:
    """(3, 3) with _cross(p) @ v = p x v."""
    x, y, z = p
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

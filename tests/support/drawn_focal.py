# SPDX-License-Identifier: Apache-2.0
"""What pictures tell of a focal length that is wrong, on drawn points (docs/lab/refinement.md)."""

from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.refinement.adjust import Problem, adjust
from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.focal import FocalFit, focal_fit
from fcsv_stereo.refinement.geometry import PairPrior
from fcsv_stereo.refinement.structure import Observations

TRUE = PinholeCamera.from_fov(640, 480, np.radians(56.0))
NOISE_PX, POINTS, NEAR_M, FAR_M = 0.15, 600, 10.0, 250.0

#: Places (m) and turns (roll, pitch, yaw about the optical frame's x, y, z; degrees) of the others
#: in the reference's optical frame: x right, y down, z ahead
Cameras = Tuple[List[Sequence[float]], List[Sequence[float]]]


def toed_in(turn_deg: float) -> Cameras:
    """Both cameras turned towards each other, by half of it each; 8 m between them."""
    half = np.radians(turn_deg / 2)
    return [[8.0 * np.cos(half), 0.0, 8.0 * np.sin(half)]], [[0.0, -turn_deg, 0.0]]


CASES: Dict[str, Cameras] = {
    "look the same way, beside each other": ([[8, 0, 0]], [[0, 0, 0]]),
    "look the same way, above each other": ([[0, -8, 0]], [[0, 0, 0]]),
    "look the same way, one rolled by 90°": ([[8, 0, 0]], [[0, 0, 90]]),
    "three that look the same way": ([[4, 0, 0], [8, 0, 0]], [[0, 0, 0], [0, 0, 0]]),
    "turned by 1° per axis, as in flight": ([[8, 0.1, 0.05]], [[1, -1, 0.7]]),
    "three, turned by 1° per axis": ([[4, 0, 0], [8, 0, 0]], [[1, -1, 0], [0, 1, 1]]),
    "one turned in by 5°": ([[8, 0, 0]], [[0, -5, 0]]),
    "one turned in by 10°": ([[8, 0, 0]], [[0, -10, 0]]),
    "one turned in by 20°": ([[8, 0, 0]], [[0, -20, 0]]),
    "both turned in by 5°": toed_in(10.0),
    "both turned in by 10°": toed_in(20.0),
    "3 m ahead": ([[8, 0, 3]], [[0, 0, 0]]),
    "8 m ahead": ([[8, 0, 8]], [[0, 0, 0]]),
}


def fitted(
    cameras: Cameras, factor: float, seed: int, rotation_deg: float = 0.15, share: float = 0.01
) -> FocalFit:
    """Of points that a reference and others see, whose focal length is said to be ``factor`` times
    the true one; the priors have the noise that they state."""
    random = np.random.default_rng(seed)
    said = PinholeCamera(640, 480, TRUE.fx * factor, TRUE.fy * factor, TRUE.cx, TRUE.cy)
    to_rays = np.linalg.inv(said.K).T
    pixels = np.c_[random.uniform([0, 0], [640, 480], (POINTS, 2)), np.ones(POINTS)]
    depth = 1.0 / random.uniform(1.0 / FAR_M, 1.0 / NEAR_M, POINTS)
    points = pixels @ np.linalg.inv(TRUE.K).T * depth[:, None]
    priors, starts, seen = {}, {0: np.eye(4)}, []
    for k, (place_m, turn_deg) in enumerate(zip(*cameras), 1):
        T = transforms.from_xyz_rpy(place_m, np.radians(turn_deg))
        p = (points - T[:3, 3]) @ T[:3, :3]
        uv = p / p[:, 2:] @ TRUE.K.T
        inside = (p[:, 2] > 1) & (uv[:, :2] > 0).all(1) & (uv[:, :2] < [640, 480]).all(1)
        uv[:, :2] += random.normal(0.0, NOISE_PX, (POINTS, 2))
        seen.append((np.flatnonzero(inside), np.full(inside.sum(), k), uv[inside] @ to_rays))
        position_m, rotation_rad = (
            share * np.linalg.norm(place_m) / np.sqrt(3.0),
            np.radians(rotation_deg),
        )
        error = transforms.from_xyz_rpy(
            random.normal(0, position_m, 3), random.normal(0, rotation_rad, 3)
        )
        starts[k] = T @ error
        priors[k] = PairPrior(starts[k], rotation_rad, position_m)
    point, picture, rays = (np.concatenate(column) for column in zip(*seen))
    observations = Observations(np.zeros(POINTS, int), pixels @ to_rays, point, picture, rays)
    # 2.5: as refinement has it, of points that are not drawn
    problem = Problem(
        observations, priors, dict.fromkeys(starts, said.fx), dict.fromkeys(starts, 2.5 * NOISE_PX)
    )
    consensus = Consensus(adjust(problem, starts, 1.0 / depth), observations, problem=problem)
    return focal_fit(consensus, dict.fromkeys(starts, said))

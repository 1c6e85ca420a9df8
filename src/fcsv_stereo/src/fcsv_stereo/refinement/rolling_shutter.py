# SPDX-License-Identifier: Apache-2.0
"""Pictures whose rows were read one after the other while the camera turned: how it turned, and the picture without it.

A row that was read at the time s of the readout (-1/2: the first row, 1/2: the last) was seen with the pose
R Exp(s turn), where R is that of the middle row (the row-wise model of Hedborg et al., "Rolling shutter bundle
adjustment", 2012, with a constant turn and no movement: centimetres do not show at the distances that are mapped).
Rows are those of the undistorted picture.
"""

from dataclasses import dataclass, replace
from typing import Dict, Optional

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Picture
from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.focal import ANY_FOCAL
from fcsv_stereo.refinement.structure import Structure

_TURN_SIGMA_RAD = np.radians(0.1)  # a vehicle that holds turns by 5 deg/s, and a picture is read in 20 ms
_SURE = 100.0  # drop of the cost: at most 34 on pictures without it, rendered and real; 385 and up with it
_LEAST_PX = 1.5


@dataclass(frozen=True)
class ReadoutTurns:
    """``turns_rad``: by picture the rotation vector (3,) of its camera in its own axes between first and last row.

    ``gain`` is by how much they bring the cost of the adjustment down (twice a log likelihood) that no other focal
    length could, ``most_px`` what the largest of them moves, first row against last. ``covariance`` is what is to be
    added to that of the adjusted poses, because the turns are not known exactly.
    """

    turns_rad: Dict[int, np.ndarray]
    gain: float
    most_px: float
    covariance: np.ndarray

    @property
    def sure(self) -> bool:
        """Whether the pictures show it."""
        return self.gain > _SURE and self.most_px > _LEAST_PX


def readout_turns(
    consensus: Consensus, cameras: Dict[int, PinholeCamera], before: Dict[int, np.ndarray]
) -> Optional[ReadoutTurns]:
    """One linear step from what was adjusted: ReadoutTurns in all, where pictures were straightened by ``before``.

    ``cameras`` are those of the features, by picture. None where nothing was adjusted.
    """
    problem, adjusted, o = consensus.problem, consensus.adjusted, consensus.observations
    if problem is None or adjusted is None:
        return None
    structure = Structure(o, adjusted.rho, problem.focals_px, problem.noise_px)
    at = structure.linearise(adjusted.poses, adjusted.focal_scale)
    weight, _ = structure.weights(at.residual)
    order, pictures = adjusted.order, [0, *adjusted.order]
    n = 6 * len(order)
    pose = {k: slice(6 * i, 6 * i + 6) for i, k in enumerate(order)}
    focal = slice(n, n + 1)
    turn = {k: slice(n + 1 + 3 * i, n + 4 + 3 * i) for i, k in enumerate(pictures)}
    parts = []
    for (a, k, of), (to_a, to_k, to_focal) in zip(structure.groups, at.by_group):
        used = [(pose[p], J) for p, J in ((a, to_a), (k, to_k)) if p in pose] + [(focal, to_focal)]
        for p, J, rays in ((a, to_a, o.anchor_rays[o.point[of]]), (k, to_k, o.rays[of])):
            used.append((turn[p], J[:, :, :3] * _time(cameras[p], rays)[:, None, None]))
        parts.append(used)
    H, g = structure.eliminated(at, weight, parts, n + 1 + 3 * len(pictures))
    for k in order:
        H[pose[k], pose[k]] += np.linalg.inv(problem.priors[k].full_covariance)
    g[:n] = 0.0  # the poses are at their optimum, priors included
    H[focal, focal] += (problem.focal_sigma or ANY_FOCAL) ** -2
    if problem.focal_sigma > 0.0:
        g[focal] = 0.0
    turns = range(n + 1, len(H))
    H[turns, turns] += _TURN_SIGMA_RAD**-2
    for k in pictures:
        g[turn[k]] += before.get(k, np.zeros(3)) * _TURN_SIGMA_RAD**-2
    covariance = np.linalg.inv(H)
    step = -covariance @ g
    held = np.linalg.inv(H[: n + 1, : n + 1])
    gain = float(g @ covariance @ g - g[: n + 1] @ held @ g[: n + 1])
    found = {k: before.get(k, np.zeros(3)) + step[turn[k]] for k in pictures}
    most_px = max(float(np.linalg.norm(t)) * cameras[k].fx for k, t in found.items())
    return ReadoutTurns(found, gain, most_px, covariance[:n, :n] - held[:n, :n])


def _time(camera: PinholeCamera, rays: np.ndarray) -> np.ndarray:
    """Of the readout (N,), -1/2 to 1/2, at which rays (N, 3) with z = 1 were read."""
    return (rays[:, 1] * camera.fy + camera.cy + 0.5) / camera.height - 0.5


def straightened(picture: Picture, turn_rad: np.ndarray) -> Picture:
    """As if all rows had been read with the middle one. What it did not see at the edges is repeated from there."""
    camera = picture.camera
    ray, row = camera.rays(), np.arange(camera.height, dtype=float)[:, None]
    for _ in range(2):  # the row in which a point was read depends on the turn by then
        time = (row + 0.5) / camera.height - 0.5
        seen = ray - np.cross(time[..., None] * turn_rad, ray)  # Exp(-time turn) for a small turn
        column = seen[..., 0] / seen[..., 2] * camera.fx + camera.cx
        row = seen[..., 1] / seen[..., 2] * camera.fy + camera.cy
    places = column.astype(np.float32), row.astype(np.float32)
    return replace(picture, image=cv2.remap(picture.image, *places, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))

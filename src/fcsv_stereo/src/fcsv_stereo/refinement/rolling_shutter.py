# SPDX-License-Identifier: Apache-2.0
"""Pictures whose rows were read one after the other while the camera turned: how it turned, and the
picture without it.

A row that was read at the time s of the readout (-1/2: the first row, 1/2: the last) was seen with
the pose R Exp(s turn), where R is that of the middle row (the row-wise model of Hedborg et al.,
"Rolling shutter bundle adjustment", 2012, with a constant turn and no movement: centimetres do not
show at the distances that are mapped). Rows are those of the undistorted picture.
"""

from dataclasses import dataclass, replace
from typing import Dict, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Picture
from fcsv_stereo.refinement import fields
from fcsv_stereo.refinement.consensus import Consensus
from fcsv_stereo.refinement.structure import Structure
from fcsv_stereo.refinement.types import ANY_FOCAL

# a vehicle that holds turns by 5 deg/s, and a picture is read in 20 ms
_TURN_SIGMA_RAD = np.radians(0.1)
# that rows are read late, before the residuals tell: cameras for this work have global shutters
_ODDS = 0.1
# twice the logarithm of the ratio of evidences: twice what Kass and Raftery (1995) call very strong
_MARGIN = 20.0
_LEAST_PX = 0.5
_STILL_RAD = np.radians(0.02)  # stated rotations that differ by less are one
_BAND = 128  # rows at a time: large pictures


@dataclass(frozen=True)
class ReadoutTurns:
    """``turns_rad``: by picture the rotation vector (3,) of its camera in its own axes between
    first and last row.

    ``probability`` is that there are any, ``most_px`` what the largest of them moves, first row
    against last. ``covariance`` (6n, 6n) is what is to be added to that of the adjusted poses,
    because the turns are not known exactly; ``step`` (6n,) by how much the poses move where the
    turns are taken out. ``margin`` is twice the logarithm of how much likelier the residuals are
    with turns than without.
    """

    turns_rad: Dict[int, np.ndarray]
    probability: float
    most_px: float
    covariance: np.ndarray
    step: np.ndarray
    margin: float

    @property
    def sure(self) -> bool:
        """Whether the pictures show it."""
        return self.margin >= _MARGIN and self.most_px > _LEAST_PX

    @property
    def if_left(self) -> np.ndarray:
        """(6n, 6n), to be added to the covariance of poses from pictures that are left as they
        are."""
        return self.probability * (self.covariance + np.outer(self.step, self.step))


def readout_turns(
    consensus: Consensus, cameras: Dict[int, PinholeCamera], before: Dict[int, np.ndarray]
) -> Optional[ReadoutTurns]:
    """One linear step from what was adjusted: ReadoutTurns in all, where pictures were straightened
    by ``before``.

    Turns are told from smooth fields of any other kind (``systematic``) by how likely both make the
    residuals; no focal length counts as one. ``cameras`` are those of the features, by picture.
    None where nothing was adjusted.
    """
    problem, adjusted = consensus.problem, consensus.adjusted
    if problem is None or adjusted is None:
        return None
    H, g, n = _normal(consensus, cameras)
    pictures = [0, *adjusted.order]
    held, turns = n + 1, slice(n + 1, n + 1 + 3 * len(pictures))
    probability, field_px, margin = _compared(H, g, held, turns)
    for i, k in enumerate(pictures):
        at = slice(held + 3 * i, held + 3 * i + 3)
        g[at] += before.get(k, np.zeros(3)) * _TURN_SIGMA_RAD**-2
    known = np.zeros(len(H))
    known[turns], known[turns.stop :] = _TURN_SIGMA_RAD**-2, fields.TERMS / field_px**2
    H = H + np.diag(known)
    covariance = np.linalg.inv(H)
    others = np.delete(np.arange(len(H)), np.r_[turns])
    without = np.linalg.inv(H[np.ix_(others, others)])
    step = -covariance @ g
    found = {
        k: before.get(k, np.zeros(3)) + step[held + 3 * i : held + 3 * i + 3]
        for i, k in enumerate(pictures)
    }
    most_px = max(float(np.linalg.norm(t)) * cameras[k].fx for k, t in found.items())
    moved = step[:n] + (without @ g[others])[:n]
    grown = (covariance - _placed(without, others, len(H)))[:n, :n]
    return ReadoutTurns(found, probability, most_px, grown, moved, margin)


def could_turn(pictures: Sequence[Picture], most_turn_rad: Optional[float]) -> bool:
    """Whether the cameras can have turned while their rows were read, by what is known without the
    pixels.

    By ``most_turn_rad`` (between first and last row), where a recording of poses tells it. Else by
    the stated poses: pictures with one rotation are of a rig, a tripod or rectified.
    """
    if most_turn_rad is not None:
        return most_turn_rad * pictures[0].camera.fx > _LEAST_PX
    R = pictures[0].T_home_cam[:3, :3]
    turned = [np.linalg.norm(cv2.Rodrigues(R.T @ p.T_home_cam[:3, :3])[0]) for p in pictures[1:]]
    return max(turned, default=0.0) > _STILL_RAD


def _normal(
    consensus: Consensus, cameras: Dict[int, PinholeCamera]
) -> Tuple[np.ndarray, np.ndarray, int]:
    """Normal equations of poses (n of them), the focal length, each picture's turn and its fields,
    points eliminated.

    Poses and focal length have their priors, turns and fields none.
    """
    problem, adjusted, o = consensus.problem, consensus.adjusted, consensus.observations
    structure = Structure(o, adjusted.rho, problem.focals_px, problem.noise_px)
    at = structure.linearise(adjusted.poses, adjusted.focal_scale)
    weight, _ = structure.weights(at.residual)
    order, pictures, terms = adjusted.order, [0, *adjusted.order], 2 * fields.TERMS
    n = 6 * len(order)
    pose = {k: slice(6 * i, 6 * i + 6) for i, k in enumerate(order)}
    focal, end = slice(n, n + 1), n + 1 + 3 * len(pictures)
    turn = {k: slice(n + 1 + 3 * i, n + 4 + 3 * i) for i, k in enumerate(pictures)}
    field = {k: slice(end + terms * i, end + terms * (i + 1)) for i, k in enumerate(pictures)}
    parts = []
    for (a, k, of), (to_a, to_k, to_focal) in zip(structure.groups, at.by_group):
        used = [(pose[p], J) for p, J in ((a, to_a), (k, to_k)) if p in pose] + [(focal, to_focal)]
        rays_a, rays_k = o.anchor_rays[o.point[of]], o.rays[of]
        for p, J, rays in ((a, to_a, rays_a), (k, to_k, rays_k)):
            used.append((turn[p], J[:, :, :3] * _time(cameras[p], rays)[:, None, None]))
        used.append((field[a], fields.of_anchor(cameras[a], rays_a, to_a)))
        used.append((field[k], -fields.of_picture(cameras[k], rays_k)))
        parts.append(used)
    H, g = structure.eliminated(at, weight, parts, end + terms * len(pictures))
    for k in order:
        H[pose[k], pose[k]] += np.linalg.inv(problem.priors[k].full_covariance)
    H[focal, focal] += (problem.focal_sigma or ANY_FOCAL) ** -2
    g[:n] = 0.0  # the poses are at their optimum, priors included
    if problem.focal_sigma > 0.0:
        g[focal] = 0.0
    return H, g, n


def _compared(H: np.ndarray, g: np.ndarray, held: int, turns: slice) -> Tuple[float, float, float]:
    """Probability of turns, against smooth fields alone, the size of the fields beside turns (px),
    and the margin.

    Both kinds explain the gradient of turns and fields, poses and focal length (the first ``held``)
    being free to follow. In the directions that residuals show, scaled to unit information, the
    gradient has the covariance NOISE_SHARE I + T + s^2 F: T of the turns, F of fields of the size
    1, s their size.
    """
    follow = np.linalg.solve(H[:held, :held], np.column_stack([H[:held, held:], g[:held]]))
    left, gradient = (
        H[held:, held:] - H[held:, :held] @ follow[:, :-1],
        g[held:] - H[held:, :held] @ follow[:, -1],
    )
    count = turns.stop - turns.start
    scale = np.full(len(left), fields.TERMS**-0.5)
    scale[:count] = _TURN_SIGMA_RAD
    value, vector = np.linalg.eigh(left * np.outer(scale, scale))
    shown = value > 1e-6 * value[-1]
    root = np.sqrt(value[shown])[:, None] * vector[:, shown].T
    y = vector[:, shown].T @ (gradient * scale) / np.sqrt(value[shown])
    noise, of_turns, of_fields = (
        fields.NOISE_SHARE * np.eye(len(y)),
        root[:, :count],
        root[:, count:],
    )
    likely = [_likely(y, noise + t, of_fields) for t in (0.0, of_turns @ of_turns.T)]
    most = max(float(each.max()) for each in likely)
    without, with_turns = (np.exp(each - most) for each in likely)
    against, favour = float(without.sum()), _ODDS * float(with_turns.sum())
    own = np.exp(likely[1] - likely[1].max())
    field_px = float(np.sqrt(own @ np.square(fields.SIZES_PX) / own.sum()))
    margin = 2.0 * float(np.log(max(favour / _ODDS, 1e-300)) - np.log(max(against, 1e-300)))
    return favour / (favour + against), field_px, margin


def _likely(y: np.ndarray, covariance: np.ndarray, of_fields: np.ndarray) -> np.ndarray:
    """Log of how likely y (m,) is with each of SIZES_PX, its prior included, but for a constant."""
    lower = np.linalg.cholesky(covariance)
    U, s, _ = np.linalg.svd(np.linalg.solve(lower, of_fields), full_matrices=True)
    z = np.square(U.T @ np.linalg.solve(lower, y))
    spread = np.zeros(len(y))
    spread[: len(s)] = np.square(s)
    variance = 1.0 + np.outer(np.square(fields.SIZES_PX), spread)
    likely = fields.log_prior() - 0.5 * (np.log(variance) + z / variance).sum(axis=1)
    return likely - np.log(np.diag(lower)).sum()


def _placed(part: np.ndarray, at: np.ndarray, size: int) -> np.ndarray:
    whole = np.zeros((size, size))
    whole[np.ix_(at, at)] = part
    return whole


def _time(camera: PinholeCamera, rays: np.ndarray) -> np.ndarray:
    """Gives the time of the readout (N,), -1/2 to 1/2, at which rays (N, 3) with z = 1 were
    read."""
    return (rays[:, 1] * camera.fy + camera.cy + 0.5) / camera.height - 0.5


def straightened(picture: Picture, turn_rad: np.ndarray) -> Picture:
    """Gives the picture as if all rows had been read with the middle one. What it did not see at
    the edges is repeated from there."""
    bands = [slice(y, y + _BAND) for y in range(0, picture.camera.height, _BAND)]
    places = [
        np.concatenate(of)
        for of in zip(*(_places(picture.camera, turn_rad, band) for band in bands))
    ]
    return replace(
        picture,
        image=cv2.remap(picture.image, *places, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE),
    )


def _places(
    camera: PinholeCamera, turn_rad: np.ndarray, rows: slice
) -> Tuple[np.ndarray, np.ndarray]:
    """Column and row (float32) at which some ``rows`` of the straightened picture were read."""
    ray, row = camera.rays(rows=rows), np.arange(camera.height, dtype=float)[rows, None]
    for _ in range(2):  # the row in which a point was read depends on the turn by then
        time = (row + 0.5) / camera.height - 0.5
        seen = ray - np.cross(time[..., None] * turn_rad, ray)  # Exp(-time turn) for a small turn
        column = seen[..., 0] / seen[..., 2] * camera.fx + camera.cx
        row = seen[..., 1] / seen[..., 2] * camera.fy + camera.cy
    return column.astype(np.float32), row.astype(np.float32)

# SPDX-License-Identifier: Apache-2.0
"""Standard deviation of inverse depth: from the match itself, from its surroundings, and from the refined geometry."""

from typing import Optional, Sequence

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.joint.refine.subpixel import Fine
from fcsv_stereo.model import Picture

#: Neighbours' residuals are not independent (interpolation, shared texture), and matching errors have long tails.
CORRELATED = 1.8
FLOOR_PX = 0.05  # of movement in the fastest pair that agrees: interpolation and sampling leave at least this


#: Relative error of depth at each relative step of inverse depth in the surroundings (STEPS), of four kinds of pixels.
#: AGREED: a pair agrees and the coarse match was trusted; to be multiplied with a power of the match's noise.
#: HALF_KNOWN: only one of the two. Neither, and so taken from the surroundings: HIDDEN from the pairs in whose fields
#: of view the place lies, or UNSEEN, outside of all.
#: Fitted on 14 scenes of the simulator; the bench's 8 others had no part in it (docs/decisions/0007).
STEPS = (0.003, 0.01, 0.03, 0.1, 0.25, 0.5)
AGREED, NOISE_POWER = (0.28, 0.23, 0.23, 0.38, 0.63, 1.26), 0.69
HALF_KNOWN = (0.006, 0.01, 0.023, 0.05, 0.1, 0.26)
HIDDEN = (0.25, 0.25, 0.27, 0.33, 0.385, 0.385)
UNSEEN = (0.07, 0.06, 0.1, 0.36, 0.385, 0.385)
_UNKNOWN = 0.25  # noise from which on the match tells nothing of the depth
_STEP_WINDOW = np.ones((9, 9), np.uint8)
LEAST_TRUST = 0.4
_CELL = 16


def matching_sigma(fine: Fine, known: np.ndarray) -> np.ndarray:
    """HxW float32, 1/m; ``known`` (HxW bool) is where the coarse match was trusted."""
    r = fine.residuals
    agreed = (r.trust >= LEAST_TRUST).any(axis=0)
    speed = np.where(r.trust >= LEAST_TRUST, r.speed, 0.0).max(axis=0)
    speed = np.maximum(speed, 0.25 * r.speed.max(axis=0))
    w = np.maximum(fine.w, 1e-9)
    noise = np.hypot(CORRELATED * np.sqrt(fine.variance), FLOOR_PX / np.maximum(speed, 1e-9)) / w
    step = (cv2.dilate(fine.w, _STEP_WINDOW) - cv2.erode(fine.w, _STEP_WINDOW)) / w
    cases = np.select([agreed & known, agreed | known, (r.seen > 0).any(axis=0)], [0, 1, 2], 3)
    log_step = np.log(np.clip(step, STEPS[0], STEPS[-1]))
    relative = np.empty_like(w)
    for case, errors in enumerate((AGREED, HALF_KNOWN, HIDDEN, UNSEEN)):
        here = cases == case
        relative[here] = np.exp(np.interp(log_step[here], np.log(STEPS), np.log(errors)))
    relative = np.where(cases == 0, relative * noise**NOISE_POWER, relative)
    return (np.where(noise > _UNKNOWN, np.maximum(relative, noise), relative) * w).astype(np.float32)


def geometry_sigma(
    reference: Picture, others: Sequence[Picture], covariances: Sequence[Optional[np.ndarray]], fine: Fine
) -> np.ndarray:
    """HxW float32, 1/m: what the poses' uncertainty makes of the inverse depth, the pairs weighed as they are in it.

    ``covariances`` are 6x6 of each pose relative to the reference: rotation (rad, camera axes), position (m, home
    axes). Errors of the pairs are taken as common: scale is, and what is not is overestimated a little.
    """
    r = fine.residuals
    weight = r.trust * np.square(r.slope) + 1e-9 * np.square(r.speed)
    weight = np.stack([cv2.blur(w, (9, 9)) for w in weight])
    weight /= np.maximum(weight.sum(axis=0), 1e-20)
    sigma = np.zeros(fine.w.shape, np.float32)
    for other, covariance, share in zip(others, covariances, weight):
        if covariance is None:
            continue
        terms = _pose_terms(reference, other, covariance, fine.w.shape)
        variance = terms[0] + fine.w * (terms[1] + fine.w * terms[2])
        sigma += share * np.sqrt(np.maximum(variance, 0.0))
    return sigma


def _pose_terms(reference: Picture, other: Picture, covariance: np.ndarray, shape) -> np.ndarray:
    """3xHxW float32: the variance of inverse depth is terms[0] + w terms[1] + w^2 terms[2] at inverse depth w.

    A pose that is off by (dtheta, dp) moves the homogeneous image q = R^T (ray + w (c_ref - p)) by
    [q]x dtheta - w R^T dp; only the part along the epipolar line looks like depth.
    """
    grid_v, grid_u = (np.linspace(0, n - 1, max(2, n // _CELL)) for n in shape)
    u, v = np.meshgrid(grid_u, grid_v)
    camera = reference.camera
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1)
    T_other_ref = transforms.invert(other.T_home_cam) @ reference.T_home_cam
    q = rays @ T_other_ref[:3, :3].T
    q = q / np.where(np.abs(q[..., 2:]) > 1e-6, q[..., 2:], 1e-6)  # at infinity: the epipolar line's beginning
    scale = np.linalg.norm(rays, axis=-1) / np.linalg.norm(q, axis=-1)
    t = T_other_ref[:3, 3] / scale[..., None]
    f = np.array([other.camera.fx, other.camera.fy])
    motion = f * (t[..., :2] - q[..., :2] * t[..., 2:])  # px per 1/m
    speed = np.maximum(np.linalg.norm(motion, axis=-1), 1e-9)
    along = motion / speed[..., None]
    # d(pixel along the line)/dq, q_z = 1
    dq = np.concatenate([along * f, -(along * f * q[..., :2]).sum(-1, keepdims=True)], axis=-1)
    j_rotation = np.cross(dq, q)  # dq . (q x dtheta) = (dq x q) . dtheta
    j_position = -(dq @ other.T_home_cam[:3, :3].T) / scale[..., None]
    rr, rp, pp = covariance[:3, :3], covariance[:3, 3:], covariance[3:, 3:]
    terms = [
        np.einsum("...i,ij,...j", j_rotation, rr, j_rotation),
        2 * np.einsum("...i,ij,...j", j_rotation, rp, j_position),
        np.einsum("...i,ij,...j", j_position, pp, j_position),
    ]  # fmt: skip
    size = shape[::-1]
    return np.stack([cv2.resize((x / speed**2).astype(np.float32), size) for x in terms])

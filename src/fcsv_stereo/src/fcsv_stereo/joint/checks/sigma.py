# SPDX-License-Identifier: Apache-2.0
"""Standard deviation of inverse depth: from the match itself, from its surroundings, and from the
refined geometry."""

from enum import IntEnum
from typing import Iterable, Iterator, List, Optional, Sequence

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.joint.refine.subpixel import Fine
from fcsv_stereo.joint.tuning import RESIDUALS, SHARED, SIGMA
from fcsv_stereo.model import Picture

# px (slope: grey levels) per 1/m: beside a camera it has no end, and its square no float
_MOST_SPEED = np.float32(1e9)
_BAND = 128  # rows at a time: large pictures
_CELL_PX = 16  # of the poses' part, which is smooth: time alone
_STEP_WINDOW = np.ones((SHARED.around_px,) * 2, np.uint8)


class PixelEvidence(IntEnum):
    """How a pixel is known: each kind has errors of its own."""

    AGREED = 0  # a pair agrees and the volume's match was trusted
    HALF_KNOWN = 1  # only one of the two
    HIDDEN = 2  # neither, in some pair's field of view: taken over from the surroundings
    UNSEEN = 3  # neither, outside of all other pictures


_ERRORS = {
    PixelEvidence.AGREED: SIGMA.agreed,
    PixelEvidence.HALF_KNOWN: SIGMA.half_known,
    PixelEvidence.HIDDEN: SIGMA.hidden,
    PixelEvidence.UNSEEN: SIGMA.unseen,
}


def matching_sigma(fine: Fine, known: np.ndarray) -> np.ndarray:
    """HxW float32, 1/m; ``known`` (HxW bool) is where the coarse match was trusted."""
    step = cv2.dilate(fine.w, _STEP_WINDOW) - cv2.erode(fine.w, _STEP_WINDOW)
    out = np.empty(fine.w.shape, np.float32)
    for y in range(0, len(out), _BAND):
        band = slice(y, y + _BAND)
        out[band] = _matching_sigma(fine.rows(band), known[band], step[band])
    return out


def _matching_sigma(fine: Fine, known: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Gives sigma as ``matching_sigma``, where the surroundings differ by ``step`` (HxW, 1/m)."""
    r = fine.residuals
    agrees = r.trust >= RESIDUALS.least_trust
    speed = np.where(agrees, r.speed, 0.0).max(axis=0)
    speed = np.maximum(speed, SIGMA.least_speed * r.speed.max(axis=0))
    w = np.maximum(fine.w, 1e-9)
    noise = (
        np.hypot(
            SIGMA.correlated * np.sqrt(fine.variance), SIGMA.floor_px / np.maximum(speed, 1e-9)
        )
        / w
    )
    step = step / w
    kinds = _kinds(agrees.any(axis=0), known, (r.seen > 0).any(axis=0))
    log_step = np.log(np.clip(step, SIGMA.steps[0], SIGMA.steps[-1]))
    relative = np.empty_like(w)
    for kind, errors in _ERRORS.items():
        here = kinds == kind
        relative[here] = np.exp(np.interp(log_step[here], np.log(SIGMA.steps), np.log(errors)))
    relative = np.where(
        kinds == PixelEvidence.AGREED, relative * noise**SIGMA.noise_power, relative
    )
    return (
        np.where(noise > SIGMA.unknown_noise, np.maximum(relative, noise), relative) * w
    ).astype(np.float32)


def _kinds(agreed: np.ndarray, known: np.ndarray, in_view: np.ndarray) -> np.ndarray:
    """HxW ``PixelEvidence`` from where a pair agrees, the volume's match was trusted, and some pair
    sees (HxW bool)."""
    kinds = [PixelEvidence.AGREED, PixelEvidence.HALF_KNOWN, PixelEvidence.HIDDEN]
    return np.select([agreed & known, agreed | known, in_view], kinds, PixelEvidence.UNSEEN)


def geometry_sigma(
    reference: Picture,
    others: Sequence[Picture],
    covariances: Sequence[Optional[np.ndarray]],
    fine: Fine,
) -> np.ndarray:
    """HxW float32, 1/m: what the poses' uncertainty makes of the inverse depth, the pairs weighed
    as they are in it.

    ``covariances`` are 6x6 of each pose relative to the reference: rotation (rad, camera axes),
    position (m, home axes). Errors of the pairs are taken as common: scale is, and what is not is
    overestimated a little.
    """
    return next(geometry_sigmas(reference, others, [covariances], fine))


def geometry_sigmas(
    reference: Picture,
    others: Sequence[Picture],
    covariances: Iterable[Sequence[Optional[np.ndarray]]],
    fine: Fine,
) -> Iterator[np.ndarray]:
    """Gives sigma as ``geometry_sigma`` for each of several sets of ``covariances``, one by one;
    the pairs are weighed once."""
    shares = _shares(fine)
    for each in covariances:
        yield _geometry_sigma(reference, others, each, shares, fine.w)


def _shares(fine: Fine) -> List[np.ndarray]:
    """HxW of each pair: which share of the pixel's depth is its."""
    r = fine.residuals
    weights = [_weight(*pair) for pair in zip(r.trust, r.slope, r.speed)]
    total = np.maximum(sum(weights), np.float32(1e-20))
    return [np.divide(weight, total, out=weight) for weight in weights]


def _geometry_sigma(
    reference: Picture,
    others: Sequence[Picture],
    covariances: Sequence[Optional[np.ndarray]],
    shares: Sequence[np.ndarray],
    w: np.ndarray,
) -> np.ndarray:
    sigma = np.zeros(w.shape, np.float32)
    for other, covariance, share in zip(others, covariances, shares):
        if covariance is None:
            continue
        constant, linear, square = _pose_terms(reference, other, covariance, w.shape)
        variance = square  # in place: large pictures
        for term in (linear, constant):
            variance *= w
            variance += term
        sigma += share * np.sqrt(np.maximum(variance, 0.0, out=variance), out=variance)
    return sigma


def _weight(trust: np.ndarray, slope: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """HxW: how much a pair counts at a pixel and about it."""
    slope, speed = np.clip(slope, -_MOST_SPEED, _MOST_SPEED), np.minimum(speed, _MOST_SPEED)
    return cv2.blur(trust * np.square(slope) + 1e-9 * np.square(speed), (SHARED.around_px,) * 2)


def _pose_terms(
    reference: Picture, other: Picture, covariance: np.ndarray, shape
) -> List[np.ndarray]:
    """Three of HxW float32: the variance of inverse depth is terms[0] + w terms[1] + w^2 terms[2]
    at inverse depth w.

    A pose that is off by (dtheta, dp) moves the homogeneous image q = R^T (ray + w (c_ref - p)) by
    [q]x dtheta - w R^T dp; only the part along the epipolar line looks like depth.
    """
    grid_v, grid_u = (np.linspace(0, n - 1, max(2, n // _CELL_PX)) for n in shape)
    u, v = np.meshgrid(grid_u, grid_v)
    camera = reference.camera
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], axis=-1
    )
    T_other_ref = transforms.invert(other.T_home_cam) @ reference.T_home_cam
    q = rays @ T_other_ref[:3, :3].T
    # at infinity: the epipolar line's beginning
    q = q / np.where(np.abs(q[..., 2:]) > 1e-6, q[..., 2:], 1e-6)
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
    ]
    size = shape[::-1]
    return [cv2.resize((x / speed**2).astype(np.float32), size) for x in terms]

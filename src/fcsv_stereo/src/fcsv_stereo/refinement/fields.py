# SPDX-License-Identifier: Apache-2.0
"""Smooth fields over a picture: shifts of its points as a lens, a readout or a detector makes
them."""

import numpy as np

from fcsv_geometry.camera import PinholeCamera

_DEGREE = 3  # as a lens's first radial term, and rows that are read while the camera turns
# polynomials of two variables up to that degree; a field has as many along x, and along y
TERMS = 10
#: Standard deviations (px per axis, rms over a picture) of fields that are tried.
SIZES_PX = np.geomspace(0.005, 1.0, 60)
#: Of the variance that is stated of the residuals' noise (2.5 times its spread, ``consensus``):
#: what smooth fields see of it. 0.16 would be independent noise, 1 noise that is as much alike over
#: whole pictures as among neighbours.
NOISE_SHARE = 0.5
# of the size before residuals tell, and by which factor (logarithm) it may be off
_USUAL_PX, _SPREAD = 0.01, 1.2


def log_prior() -> np.ndarray:
    """Gives the logarithm of the prior of each of SIZES_PX, but for a constant."""
    return -0.5 * np.square(np.log(SIZES_PX / _USUAL_PX) / _SPREAD)


def of_picture(camera: PinholeCamera, rays: np.ndarray) -> np.ndarray:
    """(N, 2, 2 TERMS) px: the shifts of all terms at rays (N, 3) with z = 1."""
    size = np.array([camera.width, camera.height])
    uv = rays[:, :2] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    basis = _basis(2.0 * (uv + 0.5) / size - 1.0)
    out = np.zeros((len(rays), 2, 2 * TERMS))
    out[:, 0, :TERMS], out[:, 1, TERMS:] = basis, basis
    return out


def of_anchor(camera: PinholeCamera, rays: np.ndarray, to_anchor: np.ndarray) -> np.ndarray:
    """(N, 2, 2 TERMS) px: what the shifts at an anchor's rays make of the residuals, by whose
    derivatives to the anchor's pose (N, 2, 6): a shift (x, y) moves its ray as the turn (-y, x, 0)
    / f does at the picture's middle."""
    shifted = np.stack([to_anchor[:, :, 1], -to_anchor[:, :, 0]], axis=2) / camera.fx
    return shifted @ of_picture(camera, rays)


def _basis(xy: np.ndarray) -> np.ndarray:
    """(N, TERMS): Legendre polynomials in two variables over the picture, (N, 2) from -1 to 1, with
    an rms of 1.

    >>> _basis(np.array([[0.0, 0.0]])).shape
    (1, 10)
    """
    one = [
        np.polynomial.legendre.legvander(a, _DEGREE) * np.sqrt(2.0 * np.arange(_DEGREE + 1) + 1.0)
        for a in xy.T
    ]
    pairs = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    return np.stack([one[0][:, i] * one[1][:, j] for i, j in pairs], axis=1)

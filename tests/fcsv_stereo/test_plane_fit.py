# SPDX-License-Identifier: Apache-2.0
"""A step of the planes of inverse depth, on arrays that are drawn."""

import numpy as np
import pytest

from fcsv_stereo.joint.refine.plane_fit import fit_band

SHAPE = (24, 30)


def step(scale):
    """(plane's value, variance) of a noisy plane of inverse depth, whose information is ``scale``
    times as much."""
    random = np.random.default_rng(1)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
    w = (0.02 + 1e-5 * u + 2e-5 * v + random.normal(0.0, 1e-5, SHAPE)).astype(np.float32)
    tau = np.full(SHAPE, 0.01, np.float32)
    information = (scale * random.uniform(0.1, 1.0, SHAPE)).astype(np.float32)
    push = (information * random.normal(0.0, 1e-5, SHAPE)).astype(np.float32)
    energy, prior = np.ones(SHAPE, np.float32), (0.01 * information).astype(np.float32)
    out, variance = np.empty(SHAPE, np.float32), np.empty(SHAPE, np.float32)
    fit_band(w, tau, information, push, energy, prior, 0, SHAPE[0], out, variance)
    return out, variance


@pytest.mark.parametrize("scale", [1e-6, 1e13, 1e15])
def test_how_much_information_there_is_does_not_move_the_plane(scale):
    """Pictures of 12 megapixels with hard edges 4 m apart had 1e13: its third power was no number
    any more, and the next step read outside of a picture."""
    (usual, spread), (out, variance) = step(1e6), step(scale)
    assert np.allclose(out, usual, rtol=1e-5, atol=0.0)
    assert np.allclose(variance * np.float32(scale / 1e6), spread, rtol=1e-3, atol=0.0)

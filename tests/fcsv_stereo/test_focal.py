# SPDX-License-Identifier: Apache-2.0
"""What pictures tell of a focal length: on drawn points, without a pixel."""

import numpy as np
import pytest
from support.drawn_focal import CASES, fitted

from fcsv_stereo.refinement.focal import FocalFit

SAME_WAY = [name for name in CASES if "same way" in name]


@pytest.mark.parametrize("factor", [1.05, 0.95, 1.0])
@pytest.mark.parametrize("prior", [(0.15, 0.01), (0.01, 0.001)])
@pytest.mark.parametrize("name", SAME_WAY)
def test_cameras_that_look_the_same_way_cannot_tell_it(name, prior, factor):
    """However good the priors are: the fit stays where it was, as unsure as before, and this is
    said."""
    fit = fitted(CASES[name], factor, 0, *prior)
    assert (
        abs(fit.change) < 0.005
        and fit.sigma > 0.045
        and fit.probability == pytest.approx(0.2, abs=0.02)
    )
    assert not fit.known and not fit.words
    assert (
        "cannot be known from these pictures" in fit.unseen and "turned by 20 degrees" in fit.unseen
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("factor, which", [(1.05, "shorter"), (0.95, "longer"), (1.0, "")])
@pytest.mark.parametrize(
    "name, prior",
    [
        ("one turned in by 20°", (0.3, 0.01)),
        ("both turned in by 10°", (0.3, 0.01)),
        ("8 m ahead", (0.15, 0.001)),
    ],
)
def test_one_pair_tells_it_where_its_cameras_are_turned_or_ahead(name, prior, factor, which, seed):
    """By 20 degrees, with the priors of photographs; or ahead, with places known to 0.1 %: the
    epipole tells."""
    fit = fitted(CASES[name], factor, seed, *prior)
    assert abs(fit.change - (1.0 / factor - 1.0)) < 3.5 * fit.sigma < 0.06
    assert bool(fit.words) == bool(which) and which in fit.words and not fit.unseen


@pytest.mark.parametrize(
    "sigma, how",
    [
        (0.05, "cannot be known"),
        (0.021, "to +-2.1% only"),
        (0.018, "to +-1.8% only"),
        (0.016, ""),
        (0.002, ""),
    ],
)
def test_what_would_show_nowhere_is_said(sigma, how):
    """Where 5 % that come out a standard deviation too small would not be a warning; a warning
    stands alone."""
    fit = FocalFit(0.0, sigma, 0.1, np.zeros((6, 6)))
    assert bool(fit.unseen) == bool(how) and how in fit.unseen
    warned = FocalFit(-0.05, sigma, 0.5, np.zeros((6, 6)))
    assert warned.words and not warned.unseen

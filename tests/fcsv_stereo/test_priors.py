# SPDX-License-Identifier: Apache-2.0
"""How good photographs' poses are, as the user says: options, and priors.csv."""

import numpy as np
import pytest
from support.photographs import model
from support.scenes import given

from fcsv_stereo import cli, colmap
from fcsv_stereo.errors import InputError
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.model import PosePrior
from fcsv_stereo.priors import read_priors

HEAD = "name,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg\n"
WHOLE = HEAD + "a.png,0.01,0.02,0.03,0.1,0.2,0.3\nb.png,1,1,1,1,1,1\n"


def test_standard_deviations_of_each_photograph(tmp_path):
    folder = model(tmp_path)
    (folder / "priors.csv").write_text(WHOLE)
    (c,) = colmap.read_photographs(folder).configurations
    sigmas = [0.01, 0.02, 0.03, *np.radians([0.1, 0.2, 0.3])]
    np.testing.assert_allclose(np.sqrt(np.diag(c.references[0].covariance)), sigmas)
    assert c.references[0].vehicle != c.others[0].vehicle, "errors of two pictures are no common drift"


@pytest.mark.parametrize("text, words", [
    ("name,x\na.png,1\n", "line 1: the columns must be name,x_m"),
    (HEAD + "c.png,1,1,1,1,1,1\n", "line 2: 'c.png' is not in images.txt"),
    (HEAD + "a.png,1,1,1,1,1\n", "line 2: not six numbers"),
    (HEAD + "a.png,1,1,nan,1,1,1\n", "line 2: standard deviations must be above zero"),
    (HEAD + "a.png,1,1,0,1,1,1\n", "line 2: standard deviations must be above zero"),
    (WHOLE + "a.png,1,1,1,1,1,1\n", "line 4: 'a.png' stands there twice"),
    (HEAD + "a.png,1,1,1,1,1,1\n", "says nothing of b.png"),
])  # fmt: skip
def test_what_is_wrong_with_the_file_is_said(tmp_path, text, words):
    (tmp_path / "priors.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        read_priors(tmp_path / "priors.csv", ["a.png", "b.png"])


def options(*words):
    return cli._options(cli._parser().parse_args(["in", "-o", "out", *words]))


def test_options_say_what_is_known_and_leave_the_rest():
    assert options().prior is None
    assert options("--prior-rotation-deg", "0.01").prior == PosePrior(np.radians(0.01))
    assert options("--prior-position-m", "0.5").prior == PosePrior(position_m=0.5, position_share=0.0)
    assert options("--prior-position-percent", "2").prior == PosePrior(position_m=0.0, position_share=0.02)
    with pytest.raises(InputError):
        options("--prior-rotation-deg", "0")
    with pytest.raises(InputError, match="--prior-position-m belongs to --method joint"):
        options("--method", "thesis", "--prior-position-m", "0")


def test_exact_poses_are_kept():
    """Poses that are said to be exact do not move; those of which nothing is said may."""
    seen = given(((0, -1.0, 0), "horizontal"), kind="photographs")
    exact = JointOptions(prior=PosePrior(np.radians(1e-4), 1e-5, 0.0))
    result = Joint().map(seen, exact)
    for entry in result.images:
        assert np.abs(entry.T_home_cam - entry.prior_T_home_cam).max() < 1e-4


def test_a_session_says_itself_how_good_its_poses_are():
    with pytest.raises(InputError, match="for photographs without priors.csv"):
        Joint().map(given(((0, -1.0, 0), "horizontal")), JointOptions(prior=PosePrior()))

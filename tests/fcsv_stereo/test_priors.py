# SPDX-License-Identifier: Apache-2.0
"""How good photographs' poses are, as the user says: options, and priors.csv."""

import numpy as np
import pytest
from support.photographs import model
from support.scenes import given

from fcsv_stereo import cli
from fcsv_stereo.errors import InputError
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.model import PosePrior
from fcsv_stereo.posed import colmap
from fcsv_stereo.posed.priors import read_priors

HEAD = "name,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg\n"
SCALED = HEAD.replace("\n", ",scale_sigma\n")
WHOLE = HEAD + "a.png,0.01,0.02,0.03,0.1,0.2,0.3\nb.png,1,1,1,1,1,1\n"


def test_standard_deviations_of_each_photograph(tmp_path):
    folder = model(tmp_path)
    (folder / "priors.csv").write_text(WHOLE)
    (c,) = colmap.read_photographs(folder).configurations
    sigmas = [0.01, 0.02, 0.03, *np.radians([0.1, 0.2, 0.3])]
    np.testing.assert_allclose(np.sqrt(np.diag(c.references[0].covariance)), sigmas)
    assert c.references[0].vehicle != c.others[0].vehicle, (
        "errors of two pictures are no common drift"
    )


def test_a_scale_is_of_the_whole_model(tmp_path):
    """Beside the positions, which stay as well known among themselves as they are."""
    folder = model(tmp_path)
    assert colmap.read_photographs(folder).prior is None
    for column, expected in (("", 0.0), ("0.04", 0.04)):
        lines = WHOLE.splitlines()
        scaled = (
            [f"{lines[0]},scale_sigma", *(f"{line},{column}" for line in lines[1:])]
            if column
            else lines
        )
        (folder / "priors.csv").write_text("\n".join(scaled) + "\n")
        read = colmap.read_photographs(folder)
        assert read.prior.scale_sigma == expected
        np.testing.assert_allclose(
            np.diag(read.configurations[0].others[0].covariance),
            [1, 1, 1, *[np.radians(1) ** 2] * 3],
        )


@pytest.mark.parametrize(
    "text, words",
    [
        ("name,x\na.png,1\n", "line 1: the columns must be name,x_m"),
        (HEAD + "c.png,1,1,1,1,1,1\n", "line 2: 'c.png' is not in images.txt"),
        (HEAD + "a.png,1,1,1,1,1\n", "line 2: not six numbers"),
        (HEAD + "a.png,1,1,nan,1,1,1\n", "line 2: standard deviations must be above zero"),
        (HEAD + "a.png,1,1,0,1,1,1\n", "line 2: standard deviations must be above zero"),
        (WHOLE + "a.png,1,1,1,1,1,1\n", "line 4: 'a.png' stands there twice"),
        (HEAD + "a.png,1,1,1,1,1,1\n", "says nothing of b.png"),
        (
            SCALED + "a.png,1,1,1,1,1,1,0.1\nb.png,1,1,1,1,1,1,0.2\n",
            "line 3: scale_sigma must be the same in every line",
        ),
        (SCALED + "a.png,1,1,1,1,1,1,nan\n", "line 2: scale_sigma is a share"),
        (SCALED + "a.png,1,1,1,1,1,1,1.5\n", "line 2: scale_sigma is a share"),
        (SCALED + "a.png,1,1,1,1,1,1\n", "line 2: scale_sigma is no number"),
    ],
)
def test_what_is_wrong_with_the_file_is_said(tmp_path, text, words):
    (tmp_path / "priors.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        read_priors(tmp_path / "priors.csv", ["a.png", "b.png"])


def options(*words):
    return cli._options(cli._parser().parse_args(["in", "-o", "out", *words]))


def test_options_say_what_is_known_and_leave_the_rest():
    assert options().prior is None
    assert options("--prior-rotation-deg", "0.01").prior == PosePrior(np.radians(0.01))
    assert options("--prior-position-m", "0.5").prior == PosePrior(
        position_m=0.5, position_share=0.0
    )
    assert options("--prior-position-percent", "2").prior == PosePrior(
        position_m=0.0, position_share=0.02
    )
    assert options("--prior-scale-percent", "5").prior == PosePrior(scale_sigma=0.05)
    for wrong in (
        ("--prior-rotation-deg", "0"),
        ("--prior-scale-percent", "100"),
        ("--prior-scale-percent", "-1"),
    ):
        with pytest.raises(InputError):
            options(*wrong)
    with pytest.raises(InputError, match="--prior-position-m belongs to --method joint"):
        options("--method", "thesis", "--prior-position-m", "0")


def test_exact_poses_are_kept():
    """Poses that are said to be exact do not move; those of which nothing is said may."""
    seen = given(((0, -1.0, 0), "horizontal"), kind="photographs")
    exact = JointOptions(prior=PosePrior(np.radians(1e-4), 1e-5, 0.0))
    result = Joint().map(seen, exact)
    for entry in result.images:
        assert np.abs(entry.T_home_cam - entry.prior_T_home_cam).max() < 1e-4


@pytest.mark.parametrize("refine_poses", [True, False])
def test_depth_of_one_pair_is_no_better_known_than_its_baseline(refine_poses):
    """No picture tells the scale. The pair states 4 %: refined or not, no pixel may be known
    better."""
    seen = given(((0, -1.0, 0), "horizontal"), kind="photographs")
    for prior in (PosePrior(scale_sigma=0.04), PosePrior(position_m=0.0, position_share=0.04)):
        result = Joint().map(seen, JointOptions(refine_poses, prior=prior))
        known = np.isfinite(result.depth)
        assert known.any() and (result.sigma / result.depth)[known].min() > 0.0395


def test_a_session_says_itself_how_good_its_poses_are():
    with pytest.raises(InputError, match="for photographs without priors.csv"):
        Joint().map(given(((0, -1.0, 0), "horizontal")), JointOptions(prior=PosePrior()))


@pytest.mark.parametrize("name", ["cameras.txt", "images.txt", "priors.csv"])
def test_a_file_that_is_no_utf_8_is_named_with_its_line(name, tmp_path):
    folder = model(tmp_path)
    (folder / "priors.csv").write_text(WHOLE)
    colmap.read_photographs(folder)
    (folder / name).write_bytes(
        (folder / name).read_bytes().rstrip(b"\n") + "\né".encode("latin-1")
    )
    line = len((folder / name).read_bytes().splitlines())
    with pytest.raises(
        InputError, match=f"{name}, line {line}: is no text in UTF-8; save it as UTF-8"
    ):
        colmap.read_photographs(folder)


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path):
    folder = model(tmp_path)
    for name in ("cameras.txt", "images.txt"):
        (folder / name).write_bytes(b"\xef\xbb\xbf" + (folder / name).read_bytes())
    assert len(colmap.read_photographs(folder).configurations) == 1

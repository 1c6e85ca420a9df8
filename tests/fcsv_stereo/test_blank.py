# SPDX-License-Identifier: Apache-2.0
"""What the camera did not take (black where distortion was taken out) has no depth, in every
method's map."""

from dataclasses import replace

import numpy as np
import pytest
from support.scenes import CAMERA, given, photograph

from fcsv_stereo.model import Picture
from fcsv_stereo.pipeline import METHODS

PINCUSHION = replace(CAMERA, distortion=(0.05, 0.0, 0.0, 0.0, 0.0))


def quiet(*_):
    pass


def taken(picture):
    """The same picture by a camera with distortion, without its borders' truth: as a node or a bag
    would give it."""
    image = photograph(picture.T_home_cam)
    return Picture.undistorted(
        picture.name, picture.vehicle, picture.stamp_s, image, PINCUSHION, picture.T_home_cam
    )


@pytest.mark.parametrize("method", ["thesis", "joint"])
def test_black_borders_have_no_depth(method):
    seen = given(((0, -1.0, 0), "horizontal"))
    configurations = [
        replace(c, references=[taken(p) for p in c.references], others=[taken(p) for p in c.others])
        for c in seen.configurations
    ]
    blank = configurations[0].references[0].blank
    result = METHODS[method].map(replace(seen, configurations=configurations))
    assert blank.sum() > 500 and not np.isfinite(result.depth[blank]).any()
    assert (
        not np.isfinite(result.sigma[blank]).any()
        and np.isfinite(result.depth[~blank]).mean() > 0.3
    )
    assert len(result.cloud) <= np.isfinite(result.depth).sum()


def test_a_shrunk_picture_keeps_them():
    (picture,) = given(((0, -1.0, 0), "horizontal")).configurations[0].references
    small = taken(picture).shrunk(0.5)
    assert (
        small.blank.shape == small.image.shape[:2]
        and small.blank[0].all()
        and not small.blank[20:-20, 20:-20].any()
    )

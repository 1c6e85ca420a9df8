# SPDX-License-Identifier: Apache-2.0
"""Whether a calibrated stereo rig took photographs, or they look like it: its poses are known
better than theirs."""

import re
from pathlib import Path
from typing import List, Sequence

import numpy as np

from fcsv_stereo.model import RIG, Picture
from fcsv_stereo.posed.colmap_images import PosedImage

_ROUNDING = 1e-6  # of rotations, focal lengths and directions: what a text file leaves
_WORDS = (
    "the poses are those of a rectified pair (one focal length, no turn): if a calibrated rig took it, --rig makes its "
    "standard deviations smaller"
)
#: Lines of Middlebury's calibration of a rectified pair.
_MIDDLEBURY = "calib.txt", ("cam0", "cam1", "baseline")


def stated_rig(folder: Path, posed: Sequence[PosedImage], pictures: Sequence[Picture]) -> str:
    """What in a ``folder`` of posed photographs says that one calibrated rig took all of them at
    once; empty: nothing.

    A model whose frames.txt has all pictures in one frame of a rig, or Middlebury's calib.txt
    beside the poses of a rectified pair.
    """
    frames = {p.frame for p in posed}
    if len(frames) == 1 and "" not in frames:
        return "rigs.txt and frames.txt say that one rig took them at once"
    name, keys = _MIDDLEBURY
    if len(pictures) == 2 and (folder / name).is_file() and _rectified(*pictures):
        text = (folder / name).read_text(errors="replace")
        if all(re.search(rf"^{key}\s*=", text, re.MULTILINE) for key in keys):
            return f"{name} is a rectified pair's calibration"
    return ""


def rig_words(why: str) -> str:
    """A sentence that says that the poses are taken as a rig's."""
    known = f"poses known to {np.degrees(RIG.rotation_rad):.2g} degrees and {RIG.position_share:.1%} of the baseline"
    return (
        f"the pictures are mapped as a calibrated rig's (as with --rig: {known}): {why}; where its calibration is "
        "worse, --prior-rotation-deg states it"
    )


def rig_hint(reference: Picture, others: List[Picture]) -> List[str]:
    """A sentence where the poses are those of a rectified pair; nobody said that it is one, so it
    is mapped as any."""
    return [_WORDS] if len(others) == 1 and _rectified(reference, others[0]) else []


def _rectified(a: Picture, b: Picture) -> bool:
    """Not turned against each other, one focal length, abreast or one above the other."""
    R_a_b = a.T_home_cam[:3, :3].T @ b.T_home_cam[:3, :3]
    p_a_b = a.T_home_cam[:3, :3].T @ (b.T_home_cam[:3, 3] - a.T_home_cam[:3, 3])
    off_axis = np.sort(np.abs(p_a_b))[:2]
    focals = np.array([a.camera.fx - b.camera.fx, a.camera.fy - b.camera.fy]) / a.camera.fx
    off = [
        *np.abs(R_a_b - np.eye(3)).ravel(),
        *np.abs(focals),
        *off_axis / max(np.linalg.norm(p_a_b), 1e-300),
    ]
    return bool(max(off) < _ROUNDING and abs(p_a_b[2]) <= off_axis.max())

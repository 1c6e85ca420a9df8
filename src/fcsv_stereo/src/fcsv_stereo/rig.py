# SPDX-License-Identifier: Apache-2.0
"""Whether photographs look as if a calibrated stereo rig took them: whose poses are known better than photographs'."""

from typing import List

import numpy as np

from fcsv_stereo.model import Picture

_ROUNDING = 1e-6  # of rotations, focal lengths and directions: what a text file leaves
_WORDS = (
    "the poses are those of a rectified pair (one focal length, no turn): if a calibrated rig took it, --rig makes its "
    "standard deviations smaller"
)


def rig_hint(reference: Picture, others: List[Picture]) -> List[str]:
    """A sentence where the poses are those of a rectified pair; nobody said that it is one, so it is mapped as any."""
    return [_WORDS] if len(others) == 1 and _rectified(reference, others[0]) else []


def _rectified(a: Picture, b: Picture) -> bool:
    """Not turned against each other, one focal length, abreast or one above the other."""
    R_a_b = a.T_home_cam[:3, :3].T @ b.T_home_cam[:3, :3]
    p_a_b = a.T_home_cam[:3, :3].T @ (b.T_home_cam[:3, 3] - a.T_home_cam[:3, 3])
    off_axis = np.sort(np.abs(p_a_b))[:2]
    focals = np.array([a.camera.fx - b.camera.fx, a.camera.fy - b.camera.fy]) / a.camera.fx
    off = [*np.abs(R_a_b - np.eye(3)).ravel(), *np.abs(focals), *off_axis / max(np.linalg.norm(p_a_b), 1e-300)]
    return bool(max(off) < _ROUNDING and abs(p_a_b[2]) <= off_axis.max())

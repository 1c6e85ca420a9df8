# SPDX-License-Identifier: Apache-2.0
"""How far a camera can have turned while its rows were read, by the poses of a recording."""

from typing import List, Optional

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_stereo.model import InputKind, MapInput, Picture

_READOUT_S = 0.05  # a slow colour sensor, first row to last
_LONGEST_GAP_S = 0.2  # between two pictures, for their turn to be that of a readout between them


def most_turn_rad(given: MapInput) -> Optional[float]:
    """Gives the largest turn of any camera of a session between first and last row; None where
    poses in short succession are not known."""
    if given.kind is not InputKind.SESSION:
        return None
    rates = [_rate_rad_s(side) for c in given.configurations for side in (c.references, c.others)]
    return None if not rates or None in rates else _READOUT_S * max(rates)


def _rate_rad_s(pictures: List[Picture]) -> Optional[float]:
    """The fastest turn (rad/s) of one camera's pictures, None where some picture has no neighbour
    in time."""
    pictures = sorted(pictures, key=lambda p: p.stamp_s)
    gaps_s = np.diff([p.stamp_s for p in pictures])
    if len(gaps_s) == 0 or not ((gaps_s > 0.0) & (gaps_s <= _LONGEST_GAP_S)).all():
        return None
    R = Rotation.from_matrix([p.T_home_cam[:3, :3] for p in pictures])
    return float(((R[:-1].inv() * R[1:]).magnitude() / gaps_s).max())

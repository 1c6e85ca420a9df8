# SPDX-License-Identifier: Apache-2.0
"""A time offset between vehicles: stamps that are wrong move a moving camera's prior along its
track."""

from dataclasses import dataclass, replace
from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_stereo.model import Picture
from fcsv_stereo.pose_covariance import relative
from fcsv_stereo.refinement.types import RefineOptions

_LEAST_PICTURES = 3
_LONGEST_GAP_S = 2.0  # between pictures from which a velocity is taken


@dataclass(frozen=True)
class Motion:
    """A vehicle whose offset is asked for: velocities (m/s) in the reference's optical axes, by
    picture number."""

    vehicle: str
    pictures: Dict[int, np.ndarray]

    def among(self, numbers: List[int]) -> "Motion":
        return replace(self, pictures={k: v for k, v in self.pictures.items() if k in numbers})


def motions(
    reference: Picture, others: Sequence[Picture], options: RefineOptions
) -> Tuple[List[Motion], List[str]]:
    """Vehicles that move enough for their offset to be seen, and in words those that do not."""
    if not options.refine_time_offset:
        return [], []
    out, refused = [], []
    for vehicle in sorted({p.vehicle for p in others} - {reference.vehicle}):
        mine = [(k, p) for k, p in enumerate(others, 1) if p.vehicle == vehicle]
        velocities = _velocities(mine, reference)
        speed_mps = max((float(np.linalg.norm(v)) for v in velocities.values()), default=0.0)
        if len(mine) < _LEAST_PICTURES or len(velocities) < _LEAST_PICTURES:
            why = f"needs {_LEAST_PICTURES} pictures {_LONGEST_GAP_S:g} s apart or less and has {len(velocities)}"
            refused.append(f"{vehicle}: its time offset was not refined: it {why}")
        elif speed_mps * options.time_offset_sigma_s < _least_position_m(reference, mine, options):
            refused.append(
                f"{vehicle}: its time offset was not refined: it hardly moves in its pictures"
            )
        else:
            out.append(Motion(vehicle, velocities))
    return out, refused


def _least_position_m(
    reference: Picture, mine: List[Tuple[int, Picture]], options: RefineOptions
) -> float:
    """What the position of the best known picture is known by."""
    known = [c for c in (relative(reference, p) for _, p in mine) if c is not None]
    return min(
        (float(np.sqrt(np.diag(c)[:3].max())) for c in known), default=options.prior.position_m
    )


def _velocities(mine: List[Tuple[int, Picture]], reference: Picture) -> Dict[int, np.ndarray]:
    """Gives velocities by differences of the priors between neighbours in time."""
    mine = sorted(mine, key=lambda kp: kp[1].stamp_s)
    velocities = {}
    for i, (k, _) in enumerate(mine):
        before, after = mine[max(i - 1, 0)][1], mine[min(i + 1, len(mine) - 1)][1]
        gap_s = after.stamp_s - before.stamp_s
        if 0.0 < gap_s <= 2.0 * _LONGEST_GAP_S:
            v_home = (after.T_home_cam[:3, 3] - before.T_home_cam[:3, 3]) / gap_s
            velocities[k] = reference.T_home_cam[:3, :3].T @ v_home
    return velocities

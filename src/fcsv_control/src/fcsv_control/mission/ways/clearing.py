# SPDX-License-Identifier: Apache-2.0
"""Who stands above whom, and where to go out of the way."""

from typing import Callable, Dict, Optional, Tuple

import numpy as np

from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.places import level_camera
from fcsv_geometry import transforms
from fcsv_geometry.missions import airspace
from fcsv_geometry.missions.airspace import HorizontalClearance, Occupant
from fcsv_geometry.vehicles.modes import Mode


def clearance_m(separation_m: float) -> float:
    """How far apart horizontally vehicles must be for one to come down beside the other."""
    return separation_m + 0.5


def below(snapshot: Snapshot, name: str, clear_m: float) -> Optional[str]:
    """A vehicle that ``name`` would come down upon: lower, and nearer than ``clear_m`` horizontally
    to where it stands or its way to a stand; flying or not. One that is lost, or silent, may lie
    anywhere within its reach.

    None where places are not known yet: before home is set they stand in a column.
    """
    own, others = _known(snapshot, name)
    return next(
        (
            n
            for n, other in others.items()
            if _stands_above(own, other, clear_m) or airspace.may_lie_beneath(own, other)
        ),
        None,
    )


def coming_down_on(snapshot: Snapshot, name: str, clear_m: float) -> Optional[str]:
    """A vehicle in LAND above ``name`` that would come down upon it."""
    own, others = _known(snapshot, name)
    lands = {n for n, v in snapshot.vehicles.items() if v.armed and v.mode == Mode.LAND}
    return next(
        (n for n, o in others.items() if n in lands and _stands_above(o, own, clear_m)), None
    )


def aside(
    snapshot: Snapshot,
    name: str,
    away_from: str,
    clear_m: float,
    within: Callable[[np.ndarray], bool] = lambda p: True,
) -> np.ndarray:
    """T_home_cam at the same height, clear of everybody: away from a vehicle, else right, left,
    back, front; ``within`` the fence, where that can be."""
    own, others = _known(snapshot, name)
    best = airspace.aside(own, others, away_from, HorizontalClearance(clear_m), within=within)
    return transforms.transform(level_camera(snapshot.vehicles[name].T_home_cam)[:3, :3], best)


def _stands_above(upper: Occupant, lower: Occupant, clear_m: float) -> bool:
    clear_m = max(HorizontalClearance(clear_m).of(vehicle) for vehicle in (upper, lower))
    return airspace.comes_down_on(upper, lower, clear_m)


def _known(snapshot: Snapshot, name: str) -> Tuple[Optional[Occupant], Dict[str, Occupant]]:
    """The vehicle and the others, whose places in home are known; nobody where its own is not."""
    known = [n for n, v in snapshot.vehicles.items() if v.T_home_cam is not None]
    occupants = {n: snapshot.occupant(n) for n in known if name in known}
    return occupants.pop(name, None), occupants

# SPDX-License-Identifier: Apache-2.0
"""Who stands above whom, and where to go out of the way."""

from typing import Callable, List, Optional

import numpy as np

from fcsv_control.mission.snapshot import Snapshot
from fcsv_control.mission.ways.places import level_camera
from fcsv_geometry import transforms
from fcsv_geometry.missions import separation
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
    known = _known(snapshot, name)
    return next(
        (
            n
            for n in known
            if _stands_above(snapshot, name, n, clear_m) or _may_lie(snapshot, name, n)
        ),
        None,
    )


def _may_lie(snapshot: Snapshot, upper: str, lost: str) -> bool:
    """Whether one that came down without a position, or unheard, may lie beneath another. At which
    height it was last known does not count."""
    view, offset_m = snapshot.vehicles[lost], snapshot.p_home_cam(upper) - snapshot.p_home_cam(lost)
    return not (view.lost and view.armed) and bool(np.linalg.norm(offset_m[:2]) < view.astray_m)


def coming_down_on(snapshot: Snapshot, name: str, clear_m: float) -> Optional[str]:
    """A vehicle in LAND above ``name`` that would come down upon it."""
    landing = [
        n
        for n in _known(snapshot, name)
        if snapshot.vehicles[n].armed and snapshot.vehicles[n].mode == Mode.LAND
    ]
    return next((n for n in landing if _stands_above(snapshot, n, name, clear_m)), None)


def aside(
    snapshot: Snapshot,
    name: str,
    away_from: str,
    clear_m: float,
    within: Callable[[np.ndarray], bool] = lambda p: True,
) -> np.ndarray:
    """T_home_cam at the same height, clear of everybody: away from a vehicle, else right, left,
    back, front; ``within`` the fence, where that can be."""
    here, others = snapshot.p_home_cam(name), _known(snapshot, name)
    clear_m = _clear_of(snapshot, away_from, clear_m)
    clears_m = [max(clear_m, snapshot.vehicles[n].astray_m) for n in others]
    places = [snapshot.p_home_cam(n) for n in others]
    best = separation.aside(here, places, clears_m, snapshot.p_home_cam(away_from), within=within)
    return transforms.transform(level_camera(snapshot.vehicles[name].T_home_cam)[:3, :3], best)


def _stands_above(snapshot: Snapshot, upper: str, lower: str, clear_m: float) -> bool:
    offset_m = snapshot.p_home_cam(upper) - snapshot.p_home_cam(lower)
    clear_m = max(_clear_of(snapshot, n, clear_m) for n in (upper, lower))
    way = (snapshot.p_home_cam(upper), snapshot.p_home_stop(upper))
    lows = (snapshot.p_home_cam(lower), snapshot.p_home_stop(lower))
    return bool(offset_m[2] > 0 and min(separation.passes_m(*way, low) for low in lows) < clear_m)


def _clear_of(snapshot: Snapshot, name: str, clear_m: float) -> float:
    """How far away horizontally others must be: further where nobody knows where it is."""
    return max(clear_m, separation.LOST_CLEAR_M) if snapshot.vehicles[name].lost else clear_m


def _known(snapshot: Snapshot, name: str) -> List[str]:
    """The other vehicles whose places in home are known; none where that of ``name`` is not."""
    if snapshot.vehicles[name].T_home_cam is None:
        return []
    return [n for n, v in snapshot.vehicles.items() if n != name and v.T_home_cam is not None]

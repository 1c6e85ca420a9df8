# SPDX-License-Identifier: Apache-2.0
"""Links that close a loop (a tag seen by two vehicles): all are adjusted together to one consistent chain.

A pose graph with four degrees of freedom per vehicle; with a handful of vehicles its normal equations are small
enough to be solved densely.
"""

from dataclasses import replace
from typing import Dict, List, Sequence, Tuple

import numpy as np
from scipy.stats import chi2

from fcsv_geometry import transforms
from fcsv_geometry.home import Place, about_z, places_in_home
from fcsv_geometry.rotations import wrap
from fcsv_tracking.calibration import Link
from fcsv_tracking.errors import CalibrationRefused

_ROUNDS = 10
_CONTRADICTION = 1e-4  # probability below which a loop that does not close is no chance


def merge_loops(chain: Sequence[Link], extra: Sequence[Link]) -> List[Link]:
    """The links of ``chain`` (a tree), moved and sharpened by what ``extra`` says about the same vehicles.

    Raises CalibrationRefused naming the link that contradicts the others.
    """
    links = [*chain, *extra]
    if not extra:
        return list(chain)
    names = list(dict.fromkeys(n for k in links for n in (k.parent, k.child)))
    places = {n: p.T_a_b for n, p in places_in_home(chain, names[0], np.eye(4)).items()}
    missing = set(names) - set(places)
    if missing:
        raise CalibrationRefused(f"{', '.join(sorted(missing))} is not connected to {names[0]} by the column's links")
    covariance, residual2 = _adjust(links, names, places)
    degrees_of_freedom = 4 * (len(links) - len(names) + 1)
    if chi2.sf(sum(residual2), degrees_of_freedom) < _CONTRADICTION:
        worst = links[int(np.argmax(residual2))]
        raise CalibrationRefused(
            f"what {worst.child} sees of {worst.parent} contradicts the other links by far more than their errors "
            f"explain: did a tracker jump, or a tag move? Calibrate again"
        )
    return [_marginal(link, names, places, covariance) for link in chain]


def _adjust(links, names: List[str], places: Dict[str, np.ndarray]) -> Tuple[np.ndarray, List[float]]:
    """Gauss-Newton from ``places`` (changed in place); joint covariance (4n, 4n), and each link's squared residual."""
    n = len(names)
    free = slice(4, 4 * n)  # the first is fixed
    for _ in range(_ROUNDS):
        N, g = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
        for link in links:
            r, J, at = _residual(link, names, places)
            W = np.linalg.inv(link.covariance)
            N[np.ix_(at, at)] += J.T @ W @ J
            g[at] += J.T @ W @ r
        step = np.zeros(4 * n)
        step[free] = -np.linalg.solve(N[free, free], g[free])
        for i, name in enumerate(names):
            T, d = places[name], step[4 * i : 4 * i + 4]
            places[name] = transforms.from_xyz_yaw(T[:3, 3] + d[:3], transforms.yaw(T) + d[3])
        if np.abs(step).max() < 1e-10:
            break
    covariance = np.zeros_like(N)
    covariance[free, free] = np.linalg.inv(N[free, free])
    residual2 = []
    for link in links:
        r, _, _ = _residual(link, names, places)
        residual2.append(float(r @ np.linalg.solve(link.covariance, r)))
    return covariance, residual2


def _residual(link: Link, names: List[str], places: Dict[str, np.ndarray]):
    """r (4,): estimated minus measured T_parent_child; its Jacobian (4, 8) and the columns that it belongs to."""
    T_parent_child = transforms.invert(places[link.parent]) @ places[link.child]
    turn = wrap(transforms.yaw(T_parent_child) - transforms.yaw(link.T_parent_child))
    r = np.array([*(T_parent_child[:3, 3] - link.T_parent_child[:3, 3]), turn])
    R_parent_ref = places[link.parent][:3, :3].T
    J = np.zeros((4, 8))
    J[:3, :3], J[:3, 4:7] = -R_parent_ref, R_parent_ref
    J[:3, 3] = -about_z(T_parent_child[:3, 3])
    J[3, 3], J[3, 7] = -1.0, 1.0
    at = np.concatenate([4 * names.index(n) + np.arange(4) for n in (link.parent, link.child)])
    return r, J, at


def _marginal(link: Link, names: List[str], places: Dict[str, np.ndarray], covariance: np.ndarray) -> Link:
    """The link as the adjusted places have it."""
    _, J, at = _residual(link, names, places)
    place = Place(transforms.invert(places[link.parent]) @ places[link.child], J @ covariance[np.ix_(at, at)] @ J.T)
    return replace(link, T_parent_child=place.T_a_b, covariance=place.covariance)

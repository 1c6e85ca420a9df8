# SPDX-License-Identifier: Apache-2.0
"""Links that close a loop (a tag seen by two vehicles): all are adjusted together to one consistent
chain.

A pose graph with four degrees of freedom per vehicle; with a handful of vehicles it is small enough
to be solved densely.
"""

from dataclasses import replace
from typing import Dict, List, Sequence, Tuple

import numpy as np
from scipy.optimize import least_squares

from fcsv_geometry import chi_squared, transforms
from fcsv_geometry.home import Place, about_z, places_in_home
from fcsv_geometry.rotations import wrap
from fcsv_tracking.column.calibration import Link
from fcsv_tracking.errors import CalibrationRefused

_DONE = 1e-12  # least_squares' tolerances
_CONTRADICTION = 1e-4  # probability below which a loop that does not close is no chance


def merge_loops(chain: Sequence[Link], extra: Sequence[Link]) -> List[Link]:
    """The links of ``chain`` (a tree), moved and sharpened by what ``extra`` says about the same
    vehicles.

    Raises CalibrationRefused naming the link that contradicts the others.
    """
    links = [*chain, *extra]
    if not extra:
        return list(chain)
    names = list(dict.fromkeys(n for k in links for n in (k.parent, k.child)))
    places = {n: p.T_a_b for n, p in places_in_home(chain, names[0], np.eye(4)).items()}
    missing = set(names) - set(places)
    if missing:
        raise CalibrationRefused(
            f"{', '.join(sorted(missing))} is not connected to {names[0]} by the column's links"
        )
    covariance, residual2 = _adjust(links, names, places)
    degrees_of_freedom = 4 * (len(links) - len(names) + 1)
    if chi_squared.probability_beyond(sum(residual2), degrees_of_freedom) < _CONTRADICTION:
        worst = links[int(np.argmax(residual2))]
        raise CalibrationRefused(
            f"what {worst.child} sees of {worst.parent} contradicts the other links by far more than their errors "
            f"explain: did a tracker jump, or a tag move? Calibrate again"
        )
    return [_marginal(link, names, places, covariance) for link in chain]


def _adjust(
    links, names: List[str], places: Dict[str, np.ndarray]
) -> Tuple[np.ndarray, List[float]]:
    """Least squares from ``places`` (changed in place); joint covariance (4n, 4n), and each link's
    squared residual."""
    n = len(names)
    whitening = [np.linalg.inv(np.linalg.cholesky(link.covariance)) for link in links]

    def place(x: np.ndarray) -> None:
        for name, (*p, yaw) in zip(names[1:], x.reshape(-1, 4)):  # the first is fixed
            places[name] = transforms.from_xyz_yaw(p, yaw)

    def residuals(x: np.ndarray) -> np.ndarray:
        place(x)
        return np.concatenate(
            [W @ _residual(link, names, places)[0] for W, link in zip(whitening, links)]
        )

    def jacobian(x: np.ndarray) -> np.ndarray:
        place(x)
        whole = np.zeros((4 * len(links), 4 * n))
        for k, (W, link) in enumerate(zip(whitening, links)):
            _, J, at = _residual(link, names, places)
            whole[4 * k : 4 * k + 4, at] = W @ J
        return whole[:, 4:]

    start = np.concatenate(
        [[*places[name][:3, 3], transforms.yaw(places[name])] for name in names[1:]]
    )
    fit = least_squares(
        residuals,
        start,
        jac=jacobian,
        method="lm",
        x_scale="jac",
        xtol=_DONE,
        ftol=_DONE,
        gtol=_DONE,
    )
    place(fit.x)
    covariance = np.zeros((4 * n, 4 * n))
    covariance[4:, 4:] = np.linalg.inv(fit.jac.T @ fit.jac)
    return covariance, (fit.fun.reshape(-1, 4) ** 2).sum(axis=1).tolist()


def _residual(link: Link, names: List[str], places: Dict[str, np.ndarray]):
    """r (4,): estimated minus measured T_parent_child; its Jacobian (4, 8) and the columns that it
    belongs to."""
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


def _marginal(
    link: Link, names: List[str], places: Dict[str, np.ndarray], covariance: np.ndarray
) -> Link:
    """The link as the adjusted places have it."""
    _, J, at = _residual(link, names, places)
    place = Place(
        transforms.invert(places[link.parent]) @ places[link.child],
        J @ covariance[np.ix_(at, at)] @ J.T,
    )
    return replace(link, T_parent_child=place.T_a_b, covariance=place.covariance)

# SPDX-License-Identifier: Apache-2.0
"""From calibration links and home to every odometry frame in home (thesis 6.3), with what is known of each.

Covariances (4, 4) are of x, y, z (m, along the parent frame's axes) and yaw (rad) of the child frame: an error
(d, w) stands for p + d and yaw + w. Composition and inverse carry them along with the adjoints of the group of
level transforms: a yaw error of an early link moves everything behind it by its lever arm.
"""

from dataclasses import dataclass
from typing import Dict, List, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_tracking.calibration import Link


@dataclass(frozen=True)
class Place:
    """T_a_b between two level frames and the covariance (4, 4) of its x, y, z, yaw."""

    T_a_b: np.ndarray
    covariance: np.ndarray

    def __matmul__(self, other: "Place") -> "Place":
        """T_a_c of T_a_b and T_b_c, whose errors are independent."""
        R_a_b = self.T_a_b[:3, :3]
        F, G = np.eye(4), np.eye(4)
        F[:3, 3] = about_z(R_a_b @ other.T_a_b[:3, 3])
        G[:3, :3] = R_a_b
        covariance = F @ self.covariance @ F.T + G @ other.covariance @ G.T
        return Place(self.T_a_b @ other.T_a_b, covariance)

    def inverse(self) -> "Place":
        """T_b_a."""
        T_b_a = transforms.invert(self.T_a_b)
        H = -np.eye(4)
        H[:3, :3] = -T_b_a[:3, :3]
        H[:3, 3] = -about_z(T_b_a[:3, 3])
        return Place(T_b_a, H @ self.covariance @ H.T)

    def at(self, p_b_m: np.ndarray) -> np.ndarray:
        """Covariance (4, 4) of a point of frame b, and of the yaw, in frame a."""
        F = np.eye(4)
        F[:3, 3] = about_z(self.T_a_b[:3, :3] @ np.asarray(p_b_m, float))
        return F @ self.covariance @ F.T


def about_z(p_m: np.ndarray) -> np.ndarray:
    """How a point moves per rad of yaw: z x p.

    >>> about_z(np.array([2.0, 0.0, 5.0])).tolist()
    [0.0, 2.0, 0.0]
    """
    return np.array([-p_m[1] + 0.0, p_m[0], 0.0])


def places_in_home(links: Sequence[Link], reference: str, T_odom_home: np.ndarray) -> Dict[str, Place]:
    """T_home_odom of every vehicle that the links connect to the reference, whose T_odom_home is given.

    Home is defined in the reference's odometry, whose place in it is therefore exact. Of several ways to a vehicle
    the shortest counts: loops are merged beforehand (loops.merge_loops).
    """
    places = {reference: Place(transforms.invert(T_odom_home), np.zeros((4, 4)))}
    left: List[Link] = list(links)
    while left:
        known = [k for k in left if k.parent in places or k.child in places]
        if not known:
            return places
        before = dict(places)
        for link in known:
            left.remove(link)
            step = Place(link.T_parent_child, link.covariance)
            if link.child not in places and link.parent in before:
                places[link.child] = before[link.parent] @ step
            elif link.parent not in places and link.child in before:
                places[link.parent] = before[link.child] @ step.inverse()
    return places


def odoms_in_home(links: Sequence[Link], reference: str, T_odom_home: np.ndarray) -> Dict[str, np.ndarray]:
    """T_home_odom of places_in_home() alone."""
    return {name: place.T_a_b for name, place in places_in_home(links, reference, T_odom_home).items()}


def home_of(T_odom_cam: np.ndarray) -> np.ndarray:
    """T_odom_home: the camera's position, level, x along the camera's view (design, "Frames")."""
    forward = T_odom_cam[:3, 2]
    return transforms.from_xyz_yaw(T_odom_cam[:3, 3], float(np.arctan2(forward[1], forward[0])))

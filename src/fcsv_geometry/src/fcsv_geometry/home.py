# SPDX-License-Identifier: Apache-2.0
"""Leads from calibration links and home to every odometry frame and camera in home (thesis 6.3), with what is known of
each.

    T_home_cam = T_home_odom @ T_odom_body @ T_body_cam

T_home_odom comes from home and the calibration's links, T_odom_body is odometry, T_body_cam are the extrinsics.

Covariances (4, 4) are of x, y, z (m, along the parent frame's axes) and yaw (rad) of the child frame: an error
(d, w) stands for p + d and yaw + w. Composition and inverse carry them along with the adjoints of the group of
level transforms: a yaw error of an early link moves everything behind it by its lever arm.
"""

import math
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms


@dataclass(frozen=True)
class OdomLink:
    """T_parent_child between the level odometry frames of two vehicles; covariance (4, 4) of its x, y, z, yaw."""

    parent: str
    child: str
    T_parent_child: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class Place:
    """T_a_b between two level frames and the covariance (4, 4) of its x, y, z, yaw."""

    T_a_b: np.ndarray
    covariance: np.ndarray

    def __matmul__(self, other: "Place") -> "Place":
        """T_a_c of T_a_b and T_b_c, whose errors are independent.

        >>> a = Place(transforms.from_xyz_yaw([1.0, 0.0, 0.0], 0.0), np.diag([0.0, 0.0, 0.0, 0.01**2]))
        >>> b = Place(transforms.from_xyz_yaw([5.0, 0.0, 0.0], 0.0), np.zeros((4, 4)))
        >>> (a @ b).T_a_b[:3, 3].tolist(), round(float((a @ b).covariance[1, 1]) ** 0.5, 6)  # 0.01 rad over 5 m
        ([6.0, 0.0, 0.0], 0.05)
        """
        R_a_b = self.T_a_b[:3, :3]
        F, G = np.eye(4), np.eye(4)
        F[:3, 3] = about_z(R_a_b @ other.T_a_b[:3, 3])
        G[:3, :3] = R_a_b
        covariance = F @ self.covariance @ F.T + G @ other.covariance @ G.T
        return Place(self.T_a_b @ other.T_a_b, covariance)

    def inverse(self) -> "Place":
        """T_b_a.

        >>> place = Place(transforms.from_xyz_yaw([1.0, 2.0, 3.0], 0.7), np.diag([4.0, 3.0, 2.0, 1.0]))
        >>> np.allclose(place.inverse().inverse().covariance, place.covariance)
        True
        """
        T_b_a = transforms.invert(self.T_a_b)
        H = -np.eye(4)
        H[:3, :3] = -T_b_a[:3, :3]
        H[:3, 3] = -about_z(T_b_a[:3, 3])
        return Place(T_b_a, H @ self.covariance @ H.T)

    def sigma_m(self, p_b_m: np.ndarray) -> float:
        """Standard deviation (m) of a point of frame b in frame a, along its worst horizontal axis.

        >>> turned = Place(np.eye(4), np.diag([0.0, 0.0, 0.0, 0.01**2]))
        >>> round(turned.sigma_m(np.array([8.0, 0.0, 3.0])), 6)  # 0.01 rad over 8 m
        0.08
        """
        # symmetric; plain numbers, being asked
        (xx, xy, _, xw), (_, yy, _, yw), _, (*_, ww) = self.covariance.tolist()
        (a, b, c, _), (d, e, f, _), _, _ = self.T_a_b.tolist()
        x, y, z = p_b_m.tolist()  # for by every vehicle 25 times a second
        dx, dy = -(d * x + e * y + f * z), a * x + b * y + c * z  # as in about_z
        xx, xy, yy = (
            xx + dx * (2 * xw + dx * ww),
            xy + dy * xw + dx * yw + dx * dy * ww,
            yy + dy * (2 * yw + dy * ww),
        )
        return math.sqrt(max(0.0, 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)))

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


def places_in_home(
    links: Sequence[OdomLink], reference: str, T_odom_home: np.ndarray
) -> Dict[str, Place]:
    """T_home_odom of every vehicle that the links connect to the reference, whose T_odom_home is given.

    Home is defined in the reference's odometry, whose place in it is therefore exact. Of several ways to a vehicle
    the shortest counts: loops are merged beforehand (fcsv_tracking.column.loops.merge_loops).

    >>> link = OdomLink("uav1", "uav2", transforms.from_xyz_yaw([-3.5, 0.0, 0.0], 0.0), np.zeros((4, 4)))
    >>> places = places_in_home([link], "uav1", transforms.from_xyz_yaw([0.0, 0.0, 8.0], 0.0))
    >>> {name: place.T_a_b[:3, 3].tolist() for name, place in places.items()}
    {'uav1': [0.0, 0.0, -8.0], 'uav2': [-3.5, 0.0, -8.0]}
    """
    places = {reference: Place(transforms.invert(T_odom_home), np.zeros((4, 4)))}
    left: List[OdomLink] = list(links)
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


def odoms_in_home(
    links: Sequence[OdomLink], reference: str, T_odom_home: np.ndarray
) -> Dict[str, np.ndarray]:
    """T_home_odom of places_in_home() alone."""
    return {
        name: place.T_a_b for name, place in places_in_home(links, reference, T_odom_home).items()
    }


def home_of(T_odom_cam: np.ndarray) -> np.ndarray:
    """T_odom_home: the camera's position, level, x along the camera's view (design, "Frames").

    >>> T_odom_cam = transforms.transform(transforms.R_FLU_OPTICAL, [1.0, 2.0, 3.0])  # looks along odometry's x
    >>> np.allclose(home_of(T_odom_cam), transforms.from_xyz_yaw([1.0, 2.0, 3.0], 0.0))
    True
    """
    forward = T_odom_cam[:3, 2]
    return transforms.from_xyz_yaw(T_odom_cam[:3, 3], float(np.arctan2(forward[1], forward[0])))


def camera_in_home(
    T_home_odom: np.ndarray, T_odom_body: np.ndarray, T_body_cam: np.ndarray
) -> np.ndarray:
    """T_home_cam of one vehicle from the three parts of its chain.

    >>> T_home_odom, T_odom_body = (transforms.from_xyz_yaw([x, 0.0, 0.0], 0.0) for x in (-3.5, 2.0))
    >>> camera_in_home(T_home_odom, T_odom_body, np.eye(4))[:3, 3].tolist()
    [-1.5, 0.0, 0.0]
    """
    return T_home_odom @ T_odom_body @ T_body_cam


class HomeFrames:
    """Every odometry frame in home, composed anew when calibration or home comes in, in whichever order.

    With ``alone`` the reference has its place as soon as home is known; otherwise nobody has one before both
    calibration and home are known.

    >>> frames = HomeFrames()
    >>> frames.set_home("uav1", np.eye(4))
    >>> sorted(frames.places)
    []
    >>> frames.calibrate([OdomLink("uav1", "uav2", np.eye(4), np.zeros((4, 4)))])
    >>> sorted(frames.T_home_odom)
    ['uav1', 'uav2']
    """

    def __init__(self, alone: bool = False):
        self._links: Optional[List[OdomLink]] = [] if alone else None
        self._reference = ""
        self._T_odom_home: Optional[np.ndarray] = None
        self.places: Dict[str, Place] = {}
        # until which moment (s) earlier ones held, since home was set
        self._past: List[Tuple[float, Dict[str, Place]]] = []

    @property
    def T_home_odom(self) -> Dict[str, np.ndarray]:
        """(4, 4) by vehicle; who is not in it has no known place."""
        return {name: place.T_a_b for name, place in self.places.items()}

    def at(self, stamp_s: float) -> Dict[str, np.ndarray]:
        """T_home_odom by vehicle as it held at a moment: of what was calibrated before it.

        >>> frames = HomeFrames()
        >>> frames.set_home("uav1", np.eye(4))
        >>> for stamp_s, x_m in ((1.0, 3.0), (9.0, 3.2)):
        ...     T = transforms.from_xyz_yaw([x_m, 0.0, 0.0], 0.0)
        ...     frames.calibrate([OdomLink("uav1", "uav2", T, np.zeros((4, 4)))], stamp_s)
        >>> [frames.at(stamp_s)["uav2"][0, 3] for stamp_s in (0.0, 5.0, 9.0)]
        [3.0, 3.0, 3.2]
        """
        held = next((places for until_s, places in self._past if stamp_s < until_s), self.places)
        return {name: place.T_a_b for name, place in held.items()}

    def calibrate(self, links: Sequence[OdomLink], stamp_s: float = math.inf) -> None:
        """A new calibration, in place of the last one; for pictures from ``stamp_s`` on."""
        if self.places and math.isfinite(stamp_s):
            self._past.append((stamp_s, self.places))
        self._links = list(links)
        self._compose()

    def set_home(self, reference: str, T_odom_home: np.ndarray) -> None:
        """A new home, in the odometry of ``reference``."""
        self._reference, self._T_odom_home, self._past = reference, T_odom_home, []
        self._compose()

    def _compose(self) -> None:
        if self._links is not None and self._T_odom_home is not None:
            self.places = places_in_home(self._links, self._reference, self._T_odom_home)

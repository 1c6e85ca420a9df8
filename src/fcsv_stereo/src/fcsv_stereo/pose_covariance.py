# SPDX-License-Identifier: Apache-2.0
"""How well a picture's pose is known, relative to another picture's.

Covariances in home are (6, 6) of the camera's position (m) and small rotation (rad), both about
home's axes, as geometry_msgs/PoseWithCovariance has them (REP 103): an error (d, w) stands for p +
d and exp(w) R.
"""

from bisect import bisect_left
from collections import deque
from typing import Deque, Iterable, List, Optional, Tuple

import numpy as np

from fcsv_stereo.errors import InputError

_NEAR_S = 0.5  # trackers publish at 15 Hz and more, and what is known of a pose changes slowly
_ASYMMETRIC = 1e-6  # of the largest entry: what rounding leaves


def checked(covariance, name: str) -> np.ndarray:
    """(6, 6) float64, symmetric. Raises InputError where it is not finite, not symmetric or not
    positive definite.

    >>> checked(np.zeros(36), "uav2")
    Traceback (most recent call last):
    ...
    fcsv_stereo.errors.InputError: covariance of the pose of uav2 is not positive definite
    """
    try:
        C = np.asarray(covariance, float).reshape(6, 6)
    except (TypeError, ValueError) as error:
        raise InputError(f"covariance of the pose of {name} is not 6x6 numbers") from error
    if not np.isfinite(C).all():
        raise InputError(f"covariance of the pose of {name} holds NaN or infinity")
    if np.abs(C - C.T).max() > _ASYMMETRIC * np.abs(C).max():
        raise InputError(f"covariance of the pose of {name} is not symmetric")
    C = 0.5 * (C + C.T)
    try:
        np.linalg.cholesky(C)
    except np.linalg.LinAlgError as error:
        raise InputError(f"covariance of the pose of {name} is not positive definite") from error
    return C


def turned(covariance: np.ndarray, R_b_a: np.ndarray) -> np.ndarray:
    """(6, 6) about the axes of frame b, of one about the axes of frame a.

    >>> R_b_a = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> turned(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), R_b_a).diagonal().tolist()
    [2.0, 1.0, 3.0, 5.0, 4.0, 6.0]
    """
    turn = np.kron(np.eye(2), R_b_a)
    return turn @ covariance @ turn.T


class KnownCovariances:
    """Covariances of one vehicle's camera in home as they were said, by stamp; ``refused`` says why
    others were not.

    At most ``most`` are kept, the newest.
    """

    def __init__(self, most: Optional[int] = None):
        self._said: Deque[Tuple[float, np.ndarray]] = deque(maxlen=most)
        self.refused = ""

    def add(self, stamp_s: float, covariance: np.ndarray) -> None:
        """One that was ``checked``; stamps come in order."""
        self._said.append((stamp_s, covariance))

    def at(self, stamp_s: float) -> Optional[np.ndarray]:
        """The one said nearest to a picture's stamp; None where none was within half a second."""
        stamps = [s for s, _ in self._said]
        i = bisect_left(stamps, stamp_s)
        near = [self._said[k] for k in (i - 1, i) if 0 <= k < len(stamps)]
        found = min(near, key=lambda said: abs(said[0] - stamp_s), default=None)
        return None if found is None or abs(found[0] - stamp_s) > _NEAR_S else found[1]


def unknown_warning(configurations: Iterable, prior, refused: Iterable[str] = ()) -> List[str]:
    """Says, in words, which vehicles' pictures have no covariance, why, and the PosePrior that
    serves; empty where all have.

    ``configurations`` are of ConfigurationInput.
    """
    pictures = [p for c in configurations for p in (*c.references, *c.others)]
    without = sorted({p.vehicle for p in pictures if p.covariance is None})
    if not without:
        return []
    why = "; ".join(dict.fromkeys(r for r in refused if r)) or "no camera_pose near their stamps"
    assumed = f"{prior.position_m * 100:.0f} cm, {prior.position_share:.0%} of the baseline"
    return [
        f"how well the poses of {', '.join(without)} are known is not recorded ({why}): "
        f"{assumed} and {np.degrees(prior.rotation_rad):.1f} deg are assumed"
    ]


def carried(arm_home_m: np.ndarray) -> np.ndarray:
    """(6, 6): the error at a place ``arm_home_m`` away that is one rigid movement with an error
    here: d + w x arm.

    >>> (carried(np.array([2.0, 0.0, 0.0])) @ [0, 0, 0, 0, 0, 0.01]).round(3).tolist()
    [0.0, 0.02, 0.0, 0.0, 0.0, 0.01]
    """
    x, y, z = arm_home_m
    F = np.eye(6)
    F[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return F


def relative(reference, other) -> Optional[np.ndarray]:
    """(6, 6) of other's pose where the reference's is held, in home's axes; None where either
    picture has none.

    Both vehicles' errors are independent: home lies exactly in its reference vehicle's odometry,
    and the calibration's error stands in the other's alone (fcsv_tracking.chain). The reference's
    error moves the other camera the opposite way, its turn by the arm between them.
    """
    if reference.covariance is None or other.covariance is None:
        return None
    F = carried(other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3])
    return other.covariance + F @ reference.covariance @ F.T


def common(earlier, later) -> np.ndarray:
    """(6, 6) cross covariance of the errors in home of two pictures of one vehicle, (earlier,
    later).

    The odometry's error at the earlier picture is still there at the later one, carried along; what
    came in between is independent of it.
    """
    F = carried(later.T_home_cam[:3, 3] - earlier.T_home_cam[:3, 3])
    return earlier.covariance @ F.T


def relative_common(reference, a, b) -> np.ndarray:
    """(6, 6) cross covariance of the poses of ``a`` and ``b`` where the reference's is held; all
    need covariances.

    The reference's error is in both; the vehicle's, where it is one vehicle.
    """
    p_ref = reference.T_home_cam[:3, 3]
    F_a, F_b = (carried(p.T_home_cam[:3, 3] - p_ref) for p in (a, b))
    cross = F_a @ reference.covariance @ F_b.T
    if a.vehicle == b.vehicle:
        cross = cross + (common(a, b) if a.stamp_s <= b.stamp_s else common(b, a).T)
    return cross


def to_camera(picture, position_too: bool) -> np.ndarray:
    """(6, 6) that turns an error (d, w) about home's axes into (rotation in camera axes, position).

    The position is in camera axes too, or stays in home's.
    """
    turn, R_cam_home = np.zeros((6, 6)), picture.T_home_cam[:3, :3].T
    turn[:3, 3:], turn[3:, :3] = R_cam_home, R_cam_home if position_too else np.eye(3)
    return turn


def prior_covariance(reference, other, prior) -> np.ndarray:
    """(6, 6) of other's pose relative to the reference: rotation (rad, camera axes), position (m,
    home's axes).

    From the pictures' covariances; a PosePrior serves where they have none. Without the scale's
    (``of_scale``).
    """
    arm_m = other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]
    known = relative(reference, other)
    if known is not None:
        turn = to_camera(other, position_too=False)
        return turn @ known @ turn.T
    sigmas = [prior.rotation_rad, prior.position_sigma_m(float(np.linalg.norm(arm_m)))]
    return np.diag(np.repeat(sigmas, 3) ** 2)


def of_scale(arm_m: np.ndarray, scale_sigma: float) -> np.ndarray:
    """(6, 6), rotation first: what a scale known to ``scale_sigma`` (a share) makes of a position
    ``arm_m`` (3,) from the reference. The pictures fit as well at any scale, so it is added to
    whatever they say of the pose.

    >>> of_scale(np.array([2.0, 0.0, 0.0]), 0.05)[3:, 3:].diagonal().round(4).tolist()
    [0.01, 0.0, 0.0]
    """
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = scale_sigma**2 * np.outer(arm_m, arm_m)
    return covariance

# SPDX-License-Identifier: Apache-2.0
"""Rectification: two pictures turned into parallel ones whose rows (or columns) correspond.

Three ways, in the order in which the thesis took and left them: ``bouguet`` lays an axis along the
baseline (2.6 to 2.11), so that every error and every scatter of the position turns both pictures
(4.5); ``decoupled`` leaves the reference as it is (5.5 to 5.7), so that all follow its vibration;
``home`` turns each picture parallel to home's heading and the horizon by its own tracked pose (6.2,
6.3). docs/lab/study.md measures the three.
"""

from dataclasses import dataclass
from typing import Callable, Dict, Tuple

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_stereo.errors import MatchingError
from fcsv_stereo.model import Axis, Picture, Word

R_HOME_CAM = transforms.R_FLU_OPTICAL
_LEAST_SIDEWAYS = 0.05


@dataclass(frozen=True)
class RectifiedPair:
    """Two parallel views. ``R_home_rect`` turns their common axes into home; ``p_rect_other_m`` is
    the other camera's

    centre in the reference's rectified frame; K are 3x3; masks are True where a picture has a
    source.
    """

    axis: Axis
    reference: np.ndarray
    other: np.ndarray
    mask_reference: np.ndarray
    mask_other: np.ndarray
    K_reference: np.ndarray
    K_other: np.ndarray
    R_home_rect: np.ndarray
    p_rect_other_m: np.ndarray

    @property
    def axis_index(self) -> int:
        """0 where the baseline runs along x (columns differ), 1 along y."""
        return self.axis.coordinate

    @property
    def baseline_m(self) -> float:
        """Signed component of the baseline along the axis (5.7): positive to the right, or down."""
        return float(self.p_rect_other_m[self.axis_index])

    @property
    def infinity_px(self) -> float:
        """Disparity (px) of the sky: 0 where both principal points are the same."""
        return float(self.K_reference[self.axis_index, 2] - self.K_other[self.axis_index, 2])


def bouguet(reference: Picture, other: Picture, axis: Axis, tilt_rad: float = 0.0) -> RectifiedPair:
    """Bouguet's algorithm: both turned halfway to each other, then an axis laid along the baseline
    (2.6 to 2.11).

    2.6 is taken with the sign that keeps pictures upright (printed, a camera to the left turns them
    over), 2.8 is z x e1, and for a vertical baseline e2 lies along it instead. The focal length is
    the smaller one; principal points keep each picture's middle in the middle, as OpenCV does.
    Raises MatchingError where a camera stands ahead.
    """
    R_ref_other = reference.T_home_cam[:3, :3].T @ other.T_home_cam[:3, :3]
    r_2 = Rotation.from_rotvec(Rotation.from_matrix(R_ref_other).as_rotvec() / 2.0).as_matrix()
    r_1 = r_2.T  # (2.11) r_n takes camera n to the orientation halfway
    p_ref_other = reference.T_home_cam[:3, :3].T @ (
        other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]
    )
    R_rect = _along(r_1 @ p_ref_other, axis, f"{reference.name} and {other.name}")
    R_1, R_2 = R_rect @ r_1, R_rect @ r_2
    f = min(reference.camera.fx, other.camera.fx, reference.camera.fy, other.camera.fy)
    centres = [_centre(p, R, f) for p, R in ((reference, R_1), (other, R_2))]
    across = 1 - Axis(axis).coordinate
    centres[0][across] = centres[1][across] = (centres[0][across] + centres[1][across]) / 2.0
    K_1, K_2 = (np.array([[f, 0.0, c[0]], [0.0, f, c[1]], [0.0, 0.0, 1.0]]) for c in centres)
    (a, mask_a), (b, mask_b) = _warp(reference, K_1, R_1), _warp(other, K_2, R_2)
    return RectifiedPair(
        Axis(axis),
        a,
        b,
        mask_a,
        mask_b,
        K_1,
        K_2,
        reference.T_home_cam[:3, :3] @ R_1.T,
        R_1 @ p_ref_other,
    )


def decoupled(
    reference: Picture, other: Picture, axis: Axis, tilt_rad: float = 0.0
) -> RectifiedPair:
    """R_1 = I (5.5), R_2 = R_ref_other (5.6): the other parallel to the reference, which stays as
    it is.

    The baseline is its component along the axis alone (5.7).
    """
    return _parallel(reference, other, axis, reference.T_home_cam[:3, :3], tilt_rad)


def home(reference: Picture, other: Picture, axis: Axis, tilt_rad: float = 0.0) -> RectifiedPair:
    """Both parallel to home: level, with home's heading.

    6.2 is printed without the camera's place on the body, and 6.3 with the factors in the order of
    their inverses; derived, R_rect_cam = R_cam_home.T @ R_home_On @ R_On_Dn @ R_Dn_Cn with
    R_home_On the chain of calibrations, which is what the rotation of a picture's T_home_cam is.
    """
    return _parallel(reference, other, axis, R_HOME_CAM, tilt_rad)


class Rectification(Word):
    """The ways."""

    HOME = "home"
    DECOUPLED = "decoupled"
    BOUGUET = "bouguet"


#: rectifier(reference, other, axis, tilt_rad); the tilt is the nominal one, inward
RECTIFIERS: Dict[Rectification, Callable[..., RectifiedPair]] = {
    Rectification.HOME: home,
    Rectification.DECOUPLED: decoupled,
    Rectification.BOUGUET: bouguet,
}


def _parallel(
    reference: Picture, other: Picture, axis: Axis, R_home_rect: np.ndarray, tilt_rad: float
) -> RectifiedPair:
    """Both in the orientation of R_home_rect. An inward tilt moves the other's principal point, so
    that what only the tilted camera sees stays in its picture; disparities are smaller by f
    tan(tilt) then (3.5)."""
    K = reference.camera.K
    p = R_home_rect.T @ (other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3])
    i = Axis(axis).coordinate
    K_other = K.copy()
    K_other[i, 2] += np.sign(p[i]) * K[i, i] * np.tan(tilt_rad)
    a, mask_a = _warp(reference, K, R_home_rect.T @ reference.T_home_cam[:3, :3])
    b, mask_b = _warp(other, K_other, R_home_rect.T @ other.T_home_cam[:3, :3])
    return RectifiedPair(Axis(axis), a, b, mask_a, mask_b, K, K_other, R_home_rect, p)


def _along(p_mid_other: np.ndarray, axis: Axis, names: str) -> np.ndarray:
    """R_rect (2.10), 3x3, with e1 (horizontal) or e2 (vertical) along the baseline and e3 near the
    optical axis."""
    length = np.linalg.norm(p_mid_other)
    i = Axis(axis).coordinate
    if np.hypot(p_mid_other[0], p_mid_other[1]) < _LEAST_SIDEWAYS * length:
        raise MatchingError(
            f"{names}: one stands ahead of the other; Bouguet's rectification needs them side by side"
        )
    e = p_mid_other / length * (1.0 if p_mid_other[i] >= 0 else -1.0)
    z = np.array([0.0, 0.0, 1.0])
    across = np.cross(z, e) if i == 0 else np.cross(e, z)
    across /= np.linalg.norm(across)
    e1, e2 = (e, across) if i == 0 else (across, e)
    return np.stack([e1, e2, np.cross(e1, e2)])


def _centre(picture: Picture, R_rect_cam: np.ndarray, focal_px: float) -> np.ndarray:
    """The principal point (2, px) that puts the middle of the picture's rectified corners in the
    middle."""
    c = picture.camera
    corners = np.array(
        [[0, 0, 1], [c.width - 1, 0, 1], [0, c.height - 1, 1], [c.width - 1, c.height - 1, 1]],
        float,
    )
    rays = corners @ (R_rect_cam @ np.linalg.inv(c.K)).T
    middle = (rays[:, :2] / rays[:, 2:]).mean(axis=0)
    return np.array([(c.width - 1) / 2.0, (c.height - 1) / 2.0]) - focal_px * middle


def _warp(
    picture: Picture, K_rect: np.ndarray, R_rect_cam: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """The picture as a camera with K_rect, turned by R_rect_cam, would have taken it, and where it
    has a source."""
    H = K_rect @ R_rect_cam @ np.linalg.inv(picture.camera.K)
    size = (picture.camera.width, picture.camera.height)
    image = cv2.warpPerspective(picture.image, H, size, flags=cv2.INTER_CUBIC)
    whole = np.full(picture.image.shape[:2], 255, np.uint8)
    mask = cv2.warpPerspective(whole, H, size, flags=cv2.INTER_NEAREST) == 255
    return image, mask

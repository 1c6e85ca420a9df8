# SPDX-License-Identifier: Apache-2.0
"""Rectification: two pictures turned into parallel ones whose rows (or columns) correspond.

``home`` turns each picture parallel to home's heading and to the horizon by its own tracked pose
(thesis 6.2, 6.3): no picture follows the vibration of another. ``decoupled`` leaves the reference as it is and
turns the other parallel to it (5.5, 5.6). ``bouguet`` lays an axis along the baseline (2.6 to 2.11).
"""

from dataclasses import dataclass
from typing import Callable, Dict, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.inputs import Picture

R_HOME_CAM = transforms.R_FLU_OPTICAL


@dataclass(frozen=True)
class RectifiedPair:
    """Two parallel views. ``R_home_rect`` turns their common axes into home; ``p_rect_other_m`` is the other camera's

    centre in the reference's rectified frame; K are 3x3; masks are True where a picture has a source.
    """

    axis: str
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
        return 0 if self.axis == "horizontal" else 1

    @property
    def baseline_m(self) -> float:
        """Signed component of the baseline along the axis (5.7): positive to the right, or down."""
        return float(self.p_rect_other_m[self.axis_index])


def home(reference: Picture, other: Picture, axis: str) -> RectifiedPair:
    """Both parallel to home (6.2): level, looking along home's x."""
    return _parallel(reference, other, axis, R_HOME_CAM)


def decoupled(reference: Picture, other: Picture, axis: str) -> RectifiedPair:
    """The other parallel to the reference (5.5, 5.6)."""
    return _parallel(reference, other, axis, reference.T_home_cam[:3, :3])


def bouguet(reference: Picture, other: Picture, axis: str) -> RectifiedPair:
    """Bouguet's rectification (2.6 to 2.11) as OpenCV has it: half the rotation each, an axis along the baseline."""
    T_other_ref = transforms.invert(other.T_home_cam) @ reference.T_home_cam
    camera = reference.camera
    size = (camera.width, camera.height)
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        camera.K, None, other.camera.K, None, size, T_other_ref[:3, :3], T_other_ref[:3, 3], flags=0, alpha=-1
    )
    found = "horizontal" if abs(P2[0, 3]) >= abs(P2[1, 3]) else "vertical"
    images = [_warp(p, P[:, :3], R) for p, P, R in ((reference, P1, R1), (other, P2, R2))]
    R_home_rect = reference.T_home_cam[:3, :3] @ R1.T
    p = R_home_rect.T @ (other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3])
    (a, mask_a), (b, mask_b) = images
    return RectifiedPair(found, a, b, mask_a, mask_b, P1[:, :3], P2[:, :3], R_home_rect, p)


RECTIFIERS: Dict[str, Callable[[Picture, Picture, str], RectifiedPair]] = {
    "home": home,
    "decoupled": decoupled,
    "bouguet": bouguet,
}


def _parallel(reference: Picture, other: Picture, axis: str, R_home_rect: np.ndarray) -> RectifiedPair:
    K = reference.camera.K
    images = [_warp(p, K, R_home_rect.T @ p.T_home_cam[:3, :3]) for p in (reference, other)]
    p = R_home_rect.T @ (other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3])
    (a, mask_a), (b, mask_b) = images
    return RectifiedPair(axis, a, b, mask_a, mask_b, K, K, R_home_rect, p)


def _warp(picture: Picture, K_rect: np.ndarray, R_rect_cam: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """The picture as a camera with K_rect, turned by R_rect_cam, would have taken it, and where it has a source."""
    H = K_rect @ R_rect_cam @ np.linalg.inv(picture.camera.K)
    size = (picture.camera.width, picture.camera.height)
    image = cv2.warpPerspective(picture.image, H, size, flags=cv2.INTER_CUBIC)
    whole = np.full(picture.image.shape[:2], 255, np.uint8)
    mask = cv2.warpPerspective(whole, H, size, flags=cv2.INTER_NEAREST) == 255
    return image, mask

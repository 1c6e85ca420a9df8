# SPDX-License-Identifier: Apache-2.0
"""AprilTags (tag36h11) in a picture: corners by the AprilRobotics detector, pose by IPPE and
refinement."""

from dataclasses import dataclass
from typing import List, Mapping, Optional, Tuple

import cv2
import numpy as np
from pupil_apriltags import Detection, Detector

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.streams.flow import DropCounter
from fcsv_tracking.errors import TagError

FAMILY = "tag36h11"
# finds what the whole picture shows, 3 to 4 m away, in half of its time (docs/lab/tracking.md)
ON_BOARD_DECIMATE = 1.5
#: The detector puts pixel centres at (0.5, 0.5); ours are at whole numbers
#: (tests/fcsv_tracking/test_tags.py).
_PIXEL_CENTRE_PX = 0.5
_LEAST_MARGIN = 10.0
# about a tag that is looked at again: its white border and more
_LEAST_MARGIN_PX, _MARGIN_EDGES = 8.0, 0.3
_TILE_PX = 4  # the detector's thresholds are those of such tiles
# of the best plane's corners; the larger of the two counts
_MOST_RMS_PX, _MOST_RMS_SHARE = 1.0, 0.03


@dataclass(frozen=True)
class TagObservation:
    """One tag in one picture; corners (4,2) run bottom-left, bottom-right, top-right, top-left as
    printed."""

    id: int
    size_m: float
    corners_px: np.ndarray
    corners_normalized: np.ndarray
    T_cam_tag: np.ndarray
    T_cam_tag_other: Optional[np.ndarray]  # the second planar solution, where there is one
    reprojection_rms_px: float
    decision_margin: float
    hamming: int

    @property
    def edge_px(self) -> float:
        """Longest edge in the picture."""
        return longest_edge(self.corners_px)


def longest_edge(corners: np.ndarray) -> float:
    """Measures the longest edge of a tag's corners (4,2)."""
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max())


def corner_points(size_m: float) -> np.ndarray:
    """The corners (4,3) in the tag's frame (x right, y down, z into the tag), in the detector's
    order."""
    h = size_m / 2.0
    return np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])


class TagDetector:
    """Finds the tags of known size; a tag of another id or family is not there.

    Tags are sought in a picture shrunk by ``decimate``. With ``sharp`` each one found is looked at
    once more where it is, in the picture as it came: corners as without shrinking, at less than
    half of its time.
    """

    def __init__(self, sizes_m: Mapping[int, float], decimate: float = 1.0, sharp: bool = False):
        self._sizes_m = dict(sizes_m)
        #: Why quads were passed over, and how often.
        self.rejected = DropCounter()
        self._detector = _detector(decimate)
        self._sharp = _detector(1.0) if sharp and decimate > 1.0 else None

    def detect(self, gray: np.ndarray, camera: PinholeCamera) -> List[TagObservation]:
        """Observations in an undistorted or distorted picture (HxW uint8) of ``camera``.

        What is seen twice is neither: one id on two tags cannot be told apart. Raises TagError
        where the picture is none, or not the camera's size.
        """
        if gray.dtype != np.uint8 or gray.ndim != 2:
            raise TagError(f"picture must be HxW uint8, got {gray.shape} {gray.dtype}")
        if gray.shape != (camera.height, camera.width):
            raise TagError(
                f"picture is {gray.shape[1]}x{gray.shape[0]}, camera_info is of {camera.width}x{camera.height}: "
                f"calibrate at the size that is used"
            )
        found = []
        for raw in self._detector.detect(np.ascontiguousarray(gray)):
            size_m = self._sizes_m.get(raw.tag_id)
            if self._sharp is not None and size_m is not None:
                raw = self._look_again(gray, raw)
            if size_m is None:
                self.rejected.count("unknown id")
            elif raw.hamming > 1 or raw.decision_margin < _LEAST_MARGIN:
                self.rejected.count("unsure")
            else:
                corners_px = raw.corners - _PIXEL_CENTRE_PX
                sure = float(raw.decision_margin), int(raw.hamming)
                found.append(observation(int(raw.tag_id), size_m, corners_px, camera, *sure))
        return self._good([o for o in found if [p.id for p in found].count(o.id) == 1], len(found))

    def _look_again(self, gray: np.ndarray, raw: Detection) -> Detection:
        """The same tag in the picture as it came; as it was found, where it is not seen there."""
        margin_px = _LEAST_MARGIN_PX + _MARGIN_EDGES * longest_edge(raw.corners)
        low = np.maximum(raw.corners.min(axis=0) - margin_px, 0).astype(int) // _TILE_PX * _TILE_PX
        high = (raw.corners.max(axis=0) + margin_px).astype(int)
        part = np.ascontiguousarray(gray[low[1] : high[1], low[0] : high[0]])
        same = [r for r in self._sharp.detect(part) if r.tag_id == raw.tag_id]
        if len(same) != 1:
            return raw
        same[0].corners = same[0].corners + low
        return same[0]

    def _good(self, single: List[TagObservation], found: int) -> List[TagObservation]:
        """Those whose corners are a square's: a tag bent, half hidden or cut by a blade is not."""
        self.rejected.count("same id twice", found - len(single))
        square = [
            o
            for o in single
            if o.reprojection_rms_px < max(_MOST_RMS_PX, _MOST_RMS_SHARE * o.edge_px)
        ]
        self.rejected.count("not square", len(single) - len(square))
        return square


def _detector(decimate: float) -> Detector:
    # this binding lets other threads run while it looks, for up to half a second
    detector = Detector(families=FAMILY, nthreads=1, quad_decimate=decimate, refine_edges=True)
    detector.tag_families.clear()  # else its end frees a family that the C detector still uses
    return detector


def observation(
    tag_id: int,
    size_m: float,
    corners_px: np.ndarray,
    camera: PinholeCamera,
    margin: float = 100.0,
    hamming: int = 0,
) -> TagObservation:
    """Both planar poses to corners (4,2) in a picture of ``camera``."""
    normalized = camera.normalize(corners_px)
    solutions = planar_poses(normalized, size_m)
    best, rms = solutions[0]
    other = solutions[1][0] if len(solutions) > 1 else None
    f = (camera.fx + camera.fy) / 2.0
    return TagObservation(
        tag_id, size_m, corners_px, normalized, best, other, rms * f, margin, hamming
    )


def planar_poses(corners_normalized: np.ndarray, size_m: float) -> List[Tuple[np.ndarray, float]]:
    """T_cam_tag and rms (normalised units) of the planar solutions, best first (IPPE, refined)."""
    points = corner_points(size_m)
    image = corners_normalized.reshape(-1, 1, 2)
    # IPPE_SQUARE wants top-left, top-right, bottom-right, bottom-left with y up in the object:
    # plain IPPE does not
    _, rotations, translations, _ = cv2.solvePnPGeneric(
        points, image, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    solutions = []
    for rvec, tvec in zip(rotations, translations):
        rvec, tvec = cv2.solvePnPRefineLM(points, image, np.eye(3), None, rvec.copy(), tvec.copy())
        projected, _ = cv2.projectPoints(points, rvec, tvec, np.eye(3), None)
        rms = float(np.sqrt(np.mean(np.sum((projected - image) ** 2, axis=-1))))
        solutions.append((transforms.transform(cv2.Rodrigues(rvec)[0], tvec.ravel()), rms))
    return sorted(solutions, key=lambda s: s[1])

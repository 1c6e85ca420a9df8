# SPDX-License-Identifier: Apache-2.0
"""Do a camera's pictures agree with how a tracker says that it moved: a witness that the tracker's
drift cannot move.

Points of the scene are followed from one picture to a later one. The two poses say along which line
each point may have moved, whatever its depth: the epipolar line, from infinitely far away to 2 m
(epipolar.py). A tracker that drifts while the vehicle holds its place by it moves the camera, and
so all points off their lines, near ones first (one_way.py).
"""

import math
from typing import Optional, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.vehicles.telemetry import SceneLook
from fcsv_tracking.errors import TrackingError
from fcsv_tracking.scene.epipolar import off_lines
from fcsv_tracking.scene.one_way import one_way_ratio

SHARE_THAT_MAY_MOVE = 0.7  # of the points by themselves: people, leaves, another vehicle
_WIDTH_PX = 320  # of the pictures in which points are followed
_MOST_POINTS, _LEAST_POINTS = 60, 15
# after which other points are taken
_MOST_TURN_RAD, _MOST_WAY_M, _LONGEST_S = np.radians(10.0), 1.5, 3.0
_KEPT = 0.5  # share of the points; with fewer, others are taken
_THERE_AND_BACK_PX = 0.5


def look(
    span_s: float,
    xy_then: np.ndarray,
    xy_now: np.ndarray,
    T_now_then: np.ndarray,
    R_odom_now: np.ndarray,
) -> SceneLook:
    """What followed points (N, 2; N of one or more), as for off_lines(), say of a motion;
    ``R_odom_now`` (3, 3) turns from the camera now into the level odometry frame."""
    turn_rad = _turn_rad(T_now_then)
    off_rad = np.sort(off_lines(xy_then, xy_now, T_now_then))
    most_rad = float(off_rad[int((1.0 - SHARE_THAT_MAY_MOVE) * len(off_rad))])
    one_way = one_way_ratio(xy_then, xy_now, T_now_then, R_odom_now, turn_rad)
    return SceneLook(span_s, most_rad, turn_rad, len(xy_then), one_way)


def outlived(span_s: float, T_now_then: np.ndarray) -> bool:
    """Whether so much time, way or turn lies between two pictures that other points are to be
    taken."""
    way_m = math.hypot(*T_now_then[:3, 3].tolist())
    return span_s > _LONGEST_S or way_m > _MOST_WAY_M or _turn_rad(T_now_then) > _MOST_TURN_RAD


def _turn_rad(T_now_then: np.ndarray) -> float:
    (a, b, c), (d, e, f), (g, h, i) = T_now_then[:3, :3].tolist()
    return math.atan2(math.hypot(h - f, c - g, d - b), a + e + i - 1.0)


class SceneWatch:
    """Told pictures and poses of one camera, it follows points by the pyramid of Lucas and Kanade
    (OpenCV)."""

    def __init__(self) -> None:
        # compiled now, not at the first picture
        look(0.0, *np.zeros((2, _LEAST_POINTS, 2)), np.eye(4), -np.eye(3))
        self.begin_again()

    def begin_again(self) -> None:
        """The tracker's frame was begun anew: poses of before are of another."""
        # stamp, T_odom_cam, points then (N, 2)
        self._then: Optional[Tuple[float, np.ndarray, np.ndarray]] = None
        self._last: Optional[np.ndarray] = None  # the last picture, grey and small
        self._points = np.empty((0, 2), np.float32)  # where they are in it
        self._alive = np.empty(0, int)  # which of the points then they are

    def observe(
        self, stamp_s: float, grey: np.ndarray, camera: PinholeCamera, T_odom_cam: np.ndarray
    ) -> Optional[SceneLook]:
        """A picture (H, W; uint8), and the pose of its camera's optical frame. None where points
        were only taken now, or too few are left. Raises TrackingError where the camera is of
        another size."""
        if grey.shape != (camera.height, camera.width):
            have = f"{grey.shape[1]}x{grey.shape[0]}"
            raise TrackingError(
                f"picture is {have}, its camera_info {camera.width}x{camera.height}"
            )
        shrunk = min(1.0, _WIDTH_PX / grey.shape[1])
        size = (int(round(grey.shape[1] * shrunk)), int(round(grey.shape[0] * shrunk)))
        small, camera = cv2.resize(grey, size, interpolation=cv2.INTER_AREA), camera.resized(*size)
        if (
            self._then is None
            or self._last is None
            or self._last.shape != small.shape
            or stamp_s <= self._then[0]
        ):
            return self._restart(stamp_s, small, T_odom_cam)
        then_s, T_odom_then, points_then = self._then
        self._follow(small)
        T_now_then = transforms.invert(T_odom_cam) @ T_odom_then
        span_s, kept = stamp_s - then_s, self._alive
        if len(kept) < max(_LEAST_POINTS, _KEPT * len(points_then)) or outlived(span_s, T_now_then):
            return self._restart(stamp_s, small, T_odom_cam)
        xy = (camera.normalize(p) for p in (points_then[kept], self._points))
        return look(span_s, *xy, T_now_then, T_odom_cam[:3, :3])

    def _restart(self, stamp_s: float, small: np.ndarray, T_odom_cam: np.ndarray) -> None:
        points = cv2.goodFeaturesToTrack(small, _MOST_POINTS, 0.01, 12)
        self._last = small
        self._points = np.empty((0, 2), np.float32) if points is None else points.reshape(-1, 2)
        self._alive = np.arange(len(self._points))
        self._then = (stamp_s, T_odom_cam, self._points.copy())

    def _follow(self, small: np.ndarray) -> None:
        """Points in the newer picture; those that do not come back to where they were are
        dropped."""
        before, self._last = self._last, small
        if not len(self._points):
            return
        moved, there, _ = cv2.calcOpticalFlowPyrLK(before, small, self._points, None)
        again, back, _ = cv2.calcOpticalFlowPyrLK(small, before, moved, None)
        good = (there.ravel() == 1) & (back.ravel() == 1)
        good &= np.linalg.norm(again - self._points, axis=1) < _THERE_AND_BACK_PX
        self._points, self._alive = moved[good], self._alive[good]

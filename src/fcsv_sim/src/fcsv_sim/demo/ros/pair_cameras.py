# SPDX-License-Identifier: Apache-2.0
"""What a pair's flight hears of one vehicle: where the tracker says its camera is, and pictures with their poses."""

import threading
from collections import deque
from typing import Callable, Deque, List, Optional, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, Image

from fcsv_geometry.errors import GeometryError, PoseUnavailable
from fcsv_geometry.ros import conversions
from fcsv_geometry.trajectory import Trajectory
from fcsv_msgs.msg import RecorderStatus

_GAP_S = 0.4  # between two poses of a hovering vehicle that a picture may fall into
_KEEP_S = 6.0
_FRESH_S = 0.8  # poses come with gaps; no vehicle is flown by an older one
_MOST_SIGMA_DEG = 3.0  # a heading that is a guess is no pose
_SPEED_OVER_S = 0.5

#: A picture, its camera's description, and T_home_cam.
Posed = Tuple[Image, CameraInfo, np.ndarray]


class PairCamera:
    """Poses are interpolated to a picture's stamp, never extrapolated: a picture waits for the pose after it."""

    def __init__(self, name: str, on_pose: Callable[[str, PoseWithCovarianceStamped], None]):
        self.name = name
        self._on_new_pose = on_pose
        self._lock = threading.Lock()
        self._track = Trajectory(gap_s=_GAP_S, keep_s=_KEEP_S)
        self._waiting: Deque[Tuple[Image, CameraInfo]] = deque(maxlen=8)
        self._posed: List[Posed] = []
        self._info: Optional[CameraInfo] = None
        self.pictures = 0
        self._recording = False
        at = f"/{name}/camera/color"
        self._status = rospy.Publisher(f"/{name}/recorder/status", RecorderStatus, queue_size=1, latch=True)
        self._say_recording()
        rospy.Subscriber(f"/{name}/camera_pose", PoseWithCovarianceStamped, self._on_pose, queue_size=50)
        rospy.Subscriber(f"{at}/camera_info", CameraInfo, self._on_info, queue_size=2)
        rospy.Subscriber(f"{at}/image_raw", Image, self._on_picture, queue_size=4, buff_size=8 << 20)

    # -- where it is ------------------------------------------------------------------------------------------------

    def latest(self) -> Optional[Tuple[float, np.ndarray]]:
        """Newest stamp (s) and T_home_cam; None before the first."""
        with self._lock:
            return self._track.latest() if len(self._track) else None

    def age_s(self, now_s: float) -> float:
        """Of the newest pose; infinite before the first."""
        latest = self.latest()
        return np.inf if latest is None else now_s - latest[0]

    def known(self, now_s: float) -> bool:
        """Whether there is a pose of this moment."""
        return self.age_s(now_s) < _FRESH_S

    def speed_mps(self) -> float:
        """Over the last half second, infinite where poses do not reach back so far."""
        with self._lock:
            try:
                stamp_s, T = self._track.latest()
                before = self._track.at(stamp_s - _SPEED_OVER_S)
            except PoseUnavailable:
                return np.inf
        return float(np.linalg.norm(T[:3, 3] - before[:3, 3])) / _SPEED_OVER_S

    # -- pictures ---------------------------------------------------------------------------------------------------

    def record(self, on: bool) -> None:
        """Keep pictures from now on, or no more; what was kept and not taken is gone."""
        with self._lock:
            self._recording = on
            self._waiting.clear()
            self._posed.clear()
        self._say_recording()

    def kept(self) -> List[Posed]:
        """Pictures since record(True) whose pose is known, in order of time."""
        with self._lock:
            return list(self._posed)

    def _say_recording(self) -> None:
        """A simulated camera takes its time for a picture only where it is kept."""
        self._status.publish(RecorderStatus(pictures_on=self._recording, pictures=self.pictures))

    def _on_info(self, message: CameraInfo) -> None:
        self._info = message

    def _on_picture(self, message: Image) -> None:
        self.pictures += 1
        with self._lock:
            if self._recording and self._info is not None:
                self._waiting.append((message, self._info))

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        try:
            T_home_cam = conversions.pose_to_transform(message.pose.pose)
        except GeometryError as error:
            rospy.logwarn_throttle(5.0, f"{self.name}: camera_pose: {error}")
            return
        rotation = np.reshape(message.pose.covariance, (6, 6)).diagonal()[3:]
        if np.degrees(np.sqrt(rotation.max())) > _MOST_SIGMA_DEG:
            return
        with self._lock:
            if not self._track.add(message.header.stamp.to_sec(), T_home_cam):
                return
            self._give_poses()
        self._on_new_pose(self.name, message)

    def _give_poses(self) -> None:
        newest_s = self._track.latest()[0]
        while self._waiting and self._waiting[0][0].header.stamp.to_sec() <= newest_s:
            image, info = self._waiting.popleft()
            stamp_s = image.header.stamp.to_sec()
            try:
                self._posed.append((image, info, self._track.at(stamp_s)))
            except PoseUnavailable as error:
                rospy.loginfo("%s: a picture is left out: %s", self.name, error)

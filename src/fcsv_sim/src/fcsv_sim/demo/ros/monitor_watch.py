# SPDX-License-Identifier: Apache-2.0
"""What the demo keeps of live monitoring: each depth image as it was published, with what was said of it."""

import threading
from pathlib import Path
from typing import Callable, Dict

import cv2
import rospy
from sensor_msgs.msg import CameraInfo, Image

from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import MapState
from fcsv_sim.demo.monitored import Frame, save


class MonitorWatch:
    """Writes FOLDER/STAMP.npz (``monitored.Frame``) and FOLDER/STAMP.jpg; on a master that this process is on."""

    def __init__(self, folder: Path, reference: str, say: Callable[[str], None]):
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._reference, self._say = folder, reference, say
        self._lock = threading.Lock()
        self._depths: Dict[float, Image] = {}
        self._cameras: Dict[float, CameraInfo] = {}
        self._states: Dict[float, MapState] = {}
        self._told = ""
        rospy.Subscriber("/map/depth", Image, lambda m: self._take(self._depths, m.header.stamp, m))
        rospy.Subscriber("/map/camera_info", CameraInfo, lambda m: self._take(self._cameras, m.header.stamp, m))
        rospy.Subscriber("/map/state", MapState, self._on_state)
        rospy.Subscriber("/map/monitor", Image, self._on_picture)

    def _on_state(self, message: MapState) -> None:
        if message.state == "ready":
            self._take(self._states, message.reference, message)
        elif message.state == "failed" and message.detail != self._told:
            self._told = message.detail
            self._say(f"monitoring: {message.detail}")

    def _take(self, where: Dict, stamp, message) -> None:
        """Parts of a frame come in any order; the state is said again and again."""
        with self._lock:
            key = round(stamp.to_sec(), 3)
            where.setdefault(key, message)
            parts = [each.get(key) for each in (self._depths, self._cameras, self._states)]
            if any(p is None for p in parts):
                return
            depth, camera, state = parts
            if depth == "kept":
                return
            self._depths[key] = "kept"
        save(self._folder, Frame(
            self._reference, depth.header.stamp.to_sec(), conversions.image_to_array(depth),
            conversions.camera_from_info(camera), state.detail, state.skew_s, state.rate_hz, state.processing_s,
            state.latency_s,
        ))  # fmt: skip

    def _on_picture(self, message: Image) -> None:
        rgb = conversions.image_to_array(message)
        cv2.imwrite(str(self._folder / f"{message.header.stamp.to_sec():.3f}.jpg"), rgb[..., ::-1])

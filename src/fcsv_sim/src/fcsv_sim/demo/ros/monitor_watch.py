# SPDX-License-Identifier: Apache-2.0
"""What the demo keeps of live monitoring: each depth image as it was published, with what was said
of it."""

import threading
from pathlib import Path
from typing import Any, Callable, Dict, Set

import cv2
import rospy
from sensor_msgs.msg import CameraInfo, Image

from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import MapState
from fcsv_sim.demo.monitored import Frame, save

_PARTS = (Image, CameraInfo, MapState)


class MonitorWatch:
    """Writes FOLDER/STAMP.npz (``monitored.Frame``) and FOLDER/STAMP.jpg; on a master that this
    process is on."""

    def __init__(self, folder: Path, reference: str, say: Callable[[str], None]):
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._reference, self._say = folder, reference, say
        self._lock = threading.Lock()
        self._parts: Dict[float, Dict[type, Any]] = {}  # of frames that are not whole yet, by stamp
        self._kept: Set[float] = set()
        self._told = ""
        rospy.Subscriber("/map/depth", Image, lambda m: self._keep(m.header.stamp, m))
        rospy.Subscriber("/map/camera_info", CameraInfo, lambda m: self._keep(m.header.stamp, m))
        rospy.Subscriber("/map/state", MapState, self._on_state)
        rospy.Subscriber("/map/monitor", Image, self._on_picture)

    def _on_state(self, message: MapState) -> None:
        if message.state == "ready":
            self._keep(message.reference, message)
        elif message.state == "failed" and message.detail != self._told:
            self._told = message.detail
            self._say(f"monitoring: {message.detail}")

    def _keep(self, stamp, message) -> None:
        """Parts of a frame come in any order; the state is said again and again."""
        key = round(stamp.to_sec(), 3)
        with self._lock:
            if key in self._kept:
                return
            parts = self._parts.setdefault(key, {})
            parts.setdefault(type(message), message)
            if len(parts) < len(_PARTS):
                return
            self._kept.add(key)
            del self._parts[key]
        depth, camera, state = (parts[kind] for kind in _PARTS)
        save(
            self._folder,
            Frame(
                self._reference,
                depth.header.stamp.to_sec(),
                conversions.image_to_array(depth),
                conversions.camera_from_info(camera),
                state.detail,
                state.skew_s,
                state.rate_hz,
                state.processing_s,
                state.latency_s,
            ),
        )

    def _on_picture(self, message: Image) -> None:
        rgb = conversions.image_to_array(message)
        cv2.imwrite(str(self._folder / f"{message.header.stamp.to_sec():.3f}.jpg"), rgb[..., ::-1])

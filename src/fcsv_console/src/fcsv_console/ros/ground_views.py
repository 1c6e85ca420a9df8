# SPDX-License-Identifier: Apache-2.0
"""Fields of view of the mocap and the gimbals, from what the node markers tells of them and where
tf2 has them."""

from typing import Callable, Optional, Tuple

import numpy as np
import rospy
import tf2_ros
from visualization_msgs.msg import Marker, MarkerArray

from fcsv_console.model import facts as f
from fcsv_geometry import frames, transforms
from fcsv_geometry.errors import FcsvError, GeometryError
from fcsv_geometry.ros import conversions

TOPIC = "/tracking/markers"
MOCAP, GIMBALS = "mocap view", "gimbal views"  # namespaces of the node markers


class GroundViewHearing:
    """``put`` is told twice a second, of each camera whose place in home is known. tf2 is heard
    only where there are such cameras."""

    def __init__(self, put: Callable[[f.Fact], None]):
        self._put = put
        self._buffer = tf2_ros.Buffer()
        self._listener: Optional[tf2_ros.TransformListener] = None
        self._subscriber = rospy.Subscriber(TOPIC, MarkerArray, self._on_markers, queue_size=1)

    def close(self) -> None:
        """End the subscriptions."""
        self._subscriber.unregister()
        if self._listener is not None:
            self._listener.unregister()

    def _on_markers(self, message: MarkerArray) -> None:
        views = [m for m in message.markers if m.ns in (MOCAP, GIMBALS)]
        if views and self._listener is None:
            self._listener = tf2_ros.TransformListener(self._buffer)
        for marker in views:
            try:
                self._put(self._seen(marker))
            except tf2_ros.TransformException:
                continue  # where it stands in home is not known: it is not drawn
            except FcsvError as error:
                self._put(f.Unusable("control", TOPIC, str(error)))

    def _seen(self, marker: Marker) -> f.SeenFrom:
        """A mocap stands; a gimbal turns, and its reading has an age."""
        frame = marker.header.frame_id
        if marker.ns == MOCAP:
            return seen(marker, self._transform(frames.HOME, frame)[0])
        T_ground_cam, stamp_s = self._transform(frames.GROUND, frame)
        T_home_ground, _ = self._transform(frames.HOME, frames.GROUND)
        return seen(marker, T_home_ground @ T_ground_cam, max(0.0, rospy.get_time() - stamp_s))

    def _transform(self, target: str, source: str) -> Tuple[np.ndarray, float]:
        """T_target_source, the newest, and its stamp."""
        found = self._buffer.lookup_transform(target, source, rospy.Time(0))
        return conversions.transform_from_msg(found.transform), found.header.stamp.to_sec()


def seen(marker: Marker, T_home_frame: np.ndarray, age_s: float = 0.0) -> f.SeenFrom:
    """A marker's pyramid in home. Raises GeometryError where it is none."""
    points = np.array([(p.x, p.y, p.z) for p in marker.points]).reshape(-1, 3)
    if len(points) != 16:
        raise GeometryError(f"{marker.ns} has {len(points)} points: no pyramid of four sides")
    found = transforms.apply(T_home_frame @ conversions.pose_to_transform(marker.pose), points)
    eye, *corners = (tuple(map(float, p)) for p in (found[0], *found[1::4]))
    gimbal_of = marker.header.frame_id.split("/")[0] if marker.ns == GIMBALS else ""
    return f.SeenFrom(gimbal_of, eye, tuple(corners), age_s)

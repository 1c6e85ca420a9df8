# SPDX-License-Identifier: Apache-2.0
"""/map/baselines/*: the points of each axis, and of each baseline, made only for who listens,
whenever he begins to."""

import threading
from typing import Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np
import rospy
from sensor_msgs.msg import PointCloud2

from fcsv_geometry import frames
from fcsv_stereo.in_flight.baseline_clouds import chosen, groups
from fcsv_stereo.model import Cloud
from fcsv_stereo.model.words import Axis
from fcsv_stereo.ros.map_messages import cloud_message

PREFIX = "/map/baselines/"


class BaselineTopics(rospy.SubscribeListener):
    """``/map/baselines/horizontal`` and ``/map/baselines/vertical`` from the start; with the map's
    growth also a topic for each baseline. Who begins to listen gets the newest map at once. Points
    are in ``frame``."""

    def __init__(self, frame: str = frames.HOME):
        super().__init__()
        self._frame = frame
        self._lock = threading.Lock()
        self._cloud: Optional[Cloud] = None
        self._baselines: Sequence[Tuple[str, float]] = ()
        self._stamp_s = 0.0
        self._groups: Dict[str, List[int]] = {}
        self._publishers: Dict[str, rospy.Publisher] = {}
        self._advertise(axis.value for axis in Axis)

    def show(self, cloud: Cloud, baselines: Sequence[Tuple[str, float]], stamp_s: float) -> None:
        """Shows the cloud in place of the map before. ``baselines``: (axis, length in m) of each
        pair that points may come of."""
        with self._lock:
            self._cloud, self._baselines, self._stamp_s = cloud, list(baselines), stamp_s
            gone = set(self._groups)
            self._groups = groups(self._baselines)
            # a list begun anew takes its baselines along
            names = [*self._groups, *(gone - set(self._groups))]
        self._advertise(names)
        for name in names:
            if self._publishers[name].get_num_connections():
                self._publishers[name].publish(self._message(name))

    def peer_subscribe(
        self, topic_name: str, _topic_publish: Callable, peer_publish: Callable
    ) -> None:
        """rospy's: somebody begins to listen."""
        with self._lock:
            known = self._cloud is not None
        if known:
            peer_publish(self._message(rospy.resolve_name(topic_name)[len(PREFIX) :]))

    def _advertise(self, names) -> None:
        for name in names:
            if name not in self._publishers:
                self._publishers[name] = rospy.Publisher(
                    PREFIX + name, PointCloud2, queue_size=1, subscriber_listener=self
                )

    def _message(self, name: str) -> PointCloud2:
        with self._lock:
            cloud, pairs, stamp_s = self._cloud, self._groups.get(name, []), self._stamp_s
            lengths_m = np.array([length for _, length in self._baselines])
        points = chosen(cloud, pairs)
        return cloud_message(cloud, stamp_s, points, lengths_m, self._frame)

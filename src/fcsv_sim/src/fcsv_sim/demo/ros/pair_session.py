# SPDX-License-Identifier: Apache-2.0
"""The session of a pair that a tracker follows: pictures with the poses that the tracker gave, as `map` reads them.

Every picture is written with a pose of the body of its own stamp (odometry/body). The frame of those poses is one for
both vehicles, so /calibration says that their odometry frames coincide and /home that home is that frame: the map comes
out in it.
"""

import os
import threading
from pathlib import Path
from typing import Dict

import numpy as np
import rosbag
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from fcsv_control.mission.standing import CaptureWindow
from fcsv_control.ros.mission_node import capture_message
from fcsv_control.session import new_session, save_session, utc_now
from fcsv_geometry import frames, transforms
from fcsv_geometry.mission import Mission
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicle import VehicleGeometry
from fcsv_msgs.msg import Calibration, CalibrationLink, Home
from fcsv_tracking.ros.static_frames import fixed_parts

_CONTROL = "control"


class PairSession:
    """SESSION/ with its bags; close() gives them their names, also after a flight that was cut short."""

    def __init__(self, folder: Path, mission: Mission, vehicles: Dict[str, VehicleGeometry], seed: int):
        self._folder, self._mission, self._vehicles = Path(folder), mission, vehicles
        self._session = new_session(mission, list(vehicles), utc_now(), seed)
        save_session(folder, self._session)
        self._bags = {n: rosbag.Bag(str(self._active(n)), "w") for n in self._session.bags}
        self._T_session_home = np.eye(4)
        self._lock = threading.Lock()

    def _active(self, machine: str) -> Path:
        return self._folder / f"{self._session.bags[machine]}.active"

    def begin(self, now_s: float, T_session_home: np.ndarray) -> None:
        """Home is set: what does not change from here on."""
        self._T_session_home = T_session_home
        reference, here = self._mission.reference, conversions.transform_to_pose(np.eye(4))
        header = conversions.header(now_s, frames.odom(reference))
        links = [CalibrationLink(parent=reference, child=n, child_odom_in_parent_odom=here)
                 for n in self._vehicles if n != reference]  # fmt: skip
        self._write(_CONTROL, "/home", Home(header, reference, here))
        self._write(_CONTROL, "/calibration", Calibration(header, links))
        for name, vehicle in self._vehicles.items():
            self._write(name, "/tf_static", TFMessage(fixed_parts(vehicle)))

    def picture(self, name: str, image: Image, info: CameraInfo, T_home_cam: np.ndarray) -> None:
        """A picture and where its camera was by the tracker."""
        T_body_cam = self._vehicles[name].T_body_cam
        T_session_body = self._T_session_home @ T_home_cam @ transforms.invert(T_body_cam)
        pose = Odometry(header=image.header, child_frame_id=frames.base_link(name))
        pose.header.frame_id = frames.odom(name)
        pose.pose.pose = conversions.transform_to_pose(T_session_body)
        self._write(name, f"/{name}/camera/color/camera_info", info)
        self._write(name, f"/{name}/camera/color/image_raw", image)
        self._write(name, f"/{name}/odometry/body", pose)

    def camera_pose(self, name: str, message: PoseWithCovarianceStamped) -> None:
        """As the tracker gave it, in the mission's home."""
        self._write(_CONTROL, f"/{name}/camera_pose", message)

    def capture(self, window: CaptureWindow, now_s: float) -> None:
        self._write(_CONTROL, "/mission/capture", capture_message(self._mission, window, now_s))

    def _write(self, machine: str, topic: str, message) -> None:
        with self._lock:  # poses come in other threads, also while the bags are closed
            bag = self._bags.get(machine)
            if bag is not None:
                bag.write(topic, message, rospy.Time.now())

    def close(self) -> None:
        """Safe to call again."""
        with self._lock:
            while self._bags:
                machine, bag = self._bags.popitem()
                bag.close()
                os.replace(self._active(machine), self._folder / self._session.bags[machine])

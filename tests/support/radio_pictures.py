# SPDX-License-Identifier: Apache-2.0
"""What the radio brings of vehicles that see synthetic walls: calibration and home, pictures with
their poses."""

import cv2
import numpy as np

from fcsv_geometry import transforms
from support.scenes import CAMERA, camera_pose, photograph

# not uav1, uav2: other tests may use those on the same master
NAMES = ("l_one", "l_two", "l_three")
PLACES = {"l_one": (0.0, 0.0, 0.0), "l_two": (0.0, -1.0, 0.0), "l_three": (0.0, 0.0, 1.0)}
T_HOME_ODOM = {
    "l_one": transforms.from_xyz_yaw([3.0, 1.0, 0.0], 0.4),
    "l_two": transforms.from_xyz_yaw([-2.0, 0.0, 1.0], -1.0),
    "l_three": np.eye(4),
}


class RadioPictures:
    """Publishes on a real master; ``close`` at the end. ``off_m``: (3,; home) by how much each
    tracker is wrong."""

    def __init__(self):
        import rospy

        from fcsv_msgs.msg import Calibration, CapturedPicture, Home

        latched = {"queue_size": 5, "latch": True}
        self.off_m = {}
        self.calibration = rospy.Publisher("/calibration", Calibration, **latched)
        self.home = rospy.Publisher("/home", Home, **latched)
        self.pictures = {
            # a burst of nine must not lose its oldest where this process has to wait
            n: rospy.Publisher(f"/{n}/capture/picture", CapturedPicture, queue_size=50)
            for n in NAMES
        }

    def listened_to(self, names):
        """Whether a node has subscribed to the pictures of these."""
        return all(self.pictures[n].get_num_connections() for n in names)

    def frames(self):
        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import Calibration, CalibrationLink, Home

        T = T_HOME_ODOM
        links = []
        for parent, child in zip(NAMES, NAMES[1:]):
            link = CalibrationLink(parent=parent, child=child)
            link.child_odom_in_parent_odom = conversions.transform_to_pose(
                transforms.invert(T[parent]) @ T[child]
            )
            links.append(link)
        self.calibration.publish(Calibration(links=links))
        home = conversions.transform_to_pose(transforms.invert(T["l_one"]))
        self.home.publish(Home(reference="l_one", home_in_odom=home))

    def picture(self, name, stamp_s, jpeg=None):
        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import CapturedPicture

        T_home_cam = camera_pose(PLACES[name])
        if jpeg is None:
            bgr = cv2.cvtColor(photograph(T_home_cam), cv2.COLOR_RGB2BGR)
            jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
        message = CapturedPicture(vehicle=name, format="jpeg", data=jpeg)
        message.header = conversions.header(stamp_s, f"{name}/camera_optical")
        message.camera = conversions.info_from_camera(CAMERA, stamp_s, "")
        believed = T_home_cam.copy()
        believed[:3, 3] += self.off_m.get(name, 0.0)
        message.camera_in_odom = conversions.transform_to_pose(
            transforms.invert(T_HOME_ODOM[name]) @ believed
        )
        self.pictures[name].publish(message)

    def close(self):
        for each in (self.calibration, self.home, *self.pictures.values()):
            each.unregister()

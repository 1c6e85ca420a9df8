# SPDX-License-Identifier: Apache-2.0
"""The node robot_tags on a master: detections of vehicles become fixes, and with the wheels a pose."""

import time

import numpy as np
import pytest
from support.waiting import within

from fcsv_geometry import transforms
from fcsv_tracking.robot_tags import load_robot_tags
from fcsv_tracking.tags import corner_points

pytestmark = pytest.mark.ros
until = within(30.0)
FOCAL_PX = 602.0
#: of each vehicle's odometry in home, and of its camera in that: 3 m up, level, looking along x
T_HOME_ODOM = transforms.from_xyz_yaw([2.0, -1.0, 3.0], 0.3)
T_ODOM_CAM = transforms.invert(T_HOME_ODOM) @ transforms.transform(
    transforms.R_FLU_OPTICAL, [0.0, 0.0, 3.0]
)


def detections(name, tag, T_home_robot, stamp_s):
    """The message of a picture in which a vehicle sees one tag of the robot."""
    from fcsv_geometry.ros import conversions
    from fcsv_msgs.msg import TagDetection, TagDetections

    T_cam_tag = transforms.invert(T_HOME_ODOM @ T_ODOM_CAM) @ T_home_robot @ tag.T_body_tag
    p = transforms.apply(T_cam_tag, corner_points(tag.size_m))
    seen = TagDetection(id=tag.id, size_m=tag.size_m)
    seen.corners_normalized = (p[:, :2] / p[:, 2:]).ravel().tolist()
    seen.tag_in_camera = conversions.transform_to_pose(T_cam_tag)
    header = conversions.header(stamp_s, f"{name}/camera_optical")
    message = TagDetections(header=header, vehicle=name, focal_px=FOCAL_PX, detections=[seen])
    message.camera_in_odom = conversions.transform_to_pose(T_ODOM_CAM)
    return message


class Fleet:
    """Two vehicles that hold, the robot's wheels, and what the nodes make of them."""

    def __init__(self, tag):
        import rospy
        import tf2_ros
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from nav_msgs.msg import Odometry

        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import TagDetections

        self.tag, self.names = tag, ("uav1", "uav2")
        self.tf = tf2_ros.StaticTransformBroadcaster()
        self.tf.sendTransform(
            [
                conversions.transform_stamped(T_HOME_ODOM, rospy.get_time(), "home", f"{n}/odom")
                for n in self.names
            ]
        )
        located = PoseWithCovarianceStamped
        talk = lambda topic, kind: rospy.Publisher(topic, kind, queue_size=5)  # noqa: E731
        self.seen = {n: talk(f"/{n}/tags/detections", TagDetections) for n in self.names}
        self.poses = {n: talk(f"/{n}/camera_pose", located) for n in self.names}
        self.wheels = talk("/odom", Odometry)
        self.fixes, self.robot, self.health = [], [], []
        self.heard = [
            rospy.Subscriber("/robot_fix", located, self.fixes.append),
            rospy.Subscriber("/robot_pose", located, self.robot.append),
            rospy.Subscriber("/diagnostics", DiagnosticArray, self.health.append),
        ]

    def look(self, name, x_m, y_m, with_pose=True, age_s=0.0):
        """One picture of a vehicle; the robot stands, its wheels say so."""
        from fcsv_guidance.place.tracker import WheelOdometry
        from fcsv_guidance.ros import ground_messages
        from fcsv_tracking.ros.camera_message import camera_message

        stamp_s, T = time.time() - age_s, transforms.from_xyz_yaw([x_m, y_m, 0.0], np.radians(140))
        if with_pose:
            covariance = np.diag(np.square([0.05, 0.05, 0.05, 0.005, 0.005, 0.008]))
            self.poses[name].publish(camera_message(stamp_s, T_HOME_ODOM @ T_ODOM_CAM, covariance))
        wheels = WheelOdometry(time.time(), 0.0, 0.0, 0.0)
        self.wheels.publish(ground_messages.odometry_message(wheels, "robot/odom", "robot/base"))
        time.sleep(0.05)
        self.seen[name].publish(detections(name, self.tag, T, stamp_s))
        time.sleep(0.1)

    def map_says(self, name, x_m):
        """A map found the vehicle's camera so far ahead of where its tracker tells."""
        import rospy

        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import RefinedCameras

        told = T_HOME_ODOM @ T_ODOM_CAM
        true = transforms.from_xyz_yaw([x_m, 0.0, 0.0], 0.0) @ told
        stamp, pose = rospy.Time.from_sec(time.time()), conversions.transform_to_pose
        header = conversions.header(time.time(), "home")
        message = RefinedCameras(header, [name], [stamp], [pose(told)], [pose(true)])
        self.map = rospy.Publisher("/map/refined", RefinedCameras, queue_size=1, latch=True)
        self.map.publish(message)

    def at(self):
        """Of the newest fix."""
        place = self.fixes[-1].pose.pose.position
        return place.x, place.y

    def said(self, words):
        return any(words in s.message for m in self.health for s in m.status)

    def dropped(self, what):
        return any(
            v.key == f"dropped: {what}" for m in self.health for s in m.status for v in s.values
        )


@pytest.fixture
def fleet(ros_master, start_node, root):
    robot = str(root / "config/robots/rescue.yaml")
    made = Fleet(load_robot_tags(robot, {})[40])
    vehicles_dir = str(root / "config/vehicles")
    params = {"vehicles": ["uav1", "uav2"], "vehicles_dir": vehicles_dir, "robot": robot}
    params["rules"] = {"silent_s": 2.0}
    start_node("fcsv_guidance", "robot_tags", params=params)
    start_node("fcsv_guidance", "robot_place")
    publishers = [*made.seen.values(), *made.poses.values()]
    until(lambda: all(p.get_num_connections() for p in publishers), what="robot_tags")
    until(made.wheels.get_num_connections, what="robot_place")
    yield made
    for each in (*publishers, made.wheels, *made.heard):
        each.unregister()


def test_what_vehicles_read_becomes_the_robots_pose(fleet):
    """A vehicle without a place is dropped; two vehicles in turn give fixes and a pose; a second
    robot with the same tag stops both."""
    until(lambda: fleet.said("no vehicle has read a tag of the robot"), what="that nobody sees it")
    fleet.look("uav1", 9.0, 1.0, with_pose=False)
    until(lambda: fleet.dropped("vehicle's place is stale"), what="that its place is stale")
    assert not fleet.fixes
    turns = iter(range(10**6))
    until(lambda: fleet.look(fleet.names[next(turns) % 2], 9.0, 1.0) or fleet.robot, what="a pose")
    fix, pose = fleet.fixes[-1], fleet.robot[-1]
    for found in (fix, pose):
        assert found.header.frame_id == "home"
        at = found.pose.pose.position
        assert (at.x, at.y) == pytest.approx((9.0, 1.0), abs=0.01)
    # of the vehicle's own place at least: 5 cm and, across, 9 m times 0.008 rad
    assert 0.05**2 < fix.pose.covariance[0] < 0.5**2
    assert fix.pose.covariance[7] > 0.05**2 + (9.0 * 0.008) ** 2
    fleet.map_says("uav1", 0.4)
    until(lambda: fleet.look("uav1", 9.0, 1.0) or fleet.at() == pytest.approx((9.4, 1.0), abs=0.01))
    # a refined pose and a tag 9 m away
    assert fleet.fixes[-1].pose.covariance[7] < 0.05**2 + (9.0 * 0.008) ** 2
    for _ in range(3):
        fleet.look("uav1", 9.0, 1.0)
        fleet.look("uav2", 9.0, 6.0)
    until(lambda: fleet.said("two robots have one tag"), what="two robots")
    count = len(fleet.fixes)
    fleet.look("uav1", 9.0, 1.0)
    assert len(fleet.fixes) == count

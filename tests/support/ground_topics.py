# SPDX-License-Identifier: Apache-2.0
"""What mission, agent, guardian and recorder hear of a tracker on the ground, whichever it is."""

import numpy as np

from fcsv_geometry import transforms
from support.waiting import within

until = within(30.0)


class GroundTopics:
    """Listens from its making; ``check`` once home is set."""

    def __init__(self, names):
        import rospy
        from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
        from nav_msgs.msg import Odometry

        from fcsv_msgs.msg import Calibration, Epoch, Epochs, Home

        self.names, self._newest, self._heard = names, {}, []
        topics = [
            ("/calibration", Calibration),
            ("/calibration_epochs", Epochs),
            ("/home_epochs", Epochs),
        ]
        topics.append(("/home", Home))
        for n in names:
            topics += [
                (f"/{n}/odometry/state", Odometry),
                (f"/{n}/odometry/body", Odometry),
                (f"/{n}/odometry/epoch", Epoch),
                (f"/{n}/mavros/vision_pose/pose", PoseStamped),
                (f"/{n}/camera_pose", PoseWithCovarianceStamped),
            ]
        for topic, kind in topics:
            keep = lambda m, topic=topic: self._newest.__setitem__(topic, m)  # noqa: E731
            self._heard.append(rospy.Subscriber(topic, kind, keep, queue_size=5))

    def __getitem__(self, topic):
        return self._newest[topic]

    def check(self, vehicles, bound_m):
        """One level frame: by it and /home every camera is where camera_pose says, and one epoch
        holds for all."""
        import rospy

        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import MissionState
        from fcsv_msgs.srv import Calibrate, SetHome

        answer = rospy.ServiceProxy("/calibrate", Calibrate)([], 0.0)
        assert answer.success, answer.message
        assert not rospy.ServiceProxy("/calibrate", Calibrate)(
            ["nobody", self.names[0]], 0.0
        ).success
        wanted = [
            f"/{n}/{t}"
            for n in self.names
            for t in (
                "odometry/state",
                "odometry/body",
                "odometry/epoch",
                "mavros/vision_pose/pose",
                "camera_pose",
            )
        ]
        wanted += ["/calibration", "/calibration_epochs", "/home", "/home_epochs"]
        until(lambda: all(t in self._newest for t in wanted), what=f"all of {wanted}")
        link = self["/calibration"].links[0]
        assert (link.parent, link.child) == self.names[:2]
        assert np.array_equal(
            conversions.pose_to_transform(link.child_odom_in_parent_odom), np.eye(4)
        )
        epochs = {self[f"/{n}/odometry/epoch"].epoch for n in self.names}
        for what in ("/calibration_epochs", "/home_epochs"):
            assert (
                len(epochs) == 1
                and set(self[what].epochs) == epochs
                and set(self[what].vehicles) == set(self.names)
            )
        T_odom_home = conversions.pose_to_transform(self["/home"].home_in_odom)
        assert np.linalg.norm(T_odom_home[2, :2]) < 1e-6  # home is level in it
        for n in self.names:
            until(
                lambda n=n: self._apart_m(n, vehicles[n], T_odom_home) < bound_m,
                what=f"{n}'s odometry and camera",
            )
            message = self[f"/{n}/odometry/state"]
            assert (
                message.header.frame_id == f"{n}/odom"
                and message.child_frame_id == f"{n}/base_link"
            )
            # what guardians take for full confidence
            assert 0.0 < message.pose.covariance[0] < 0.01
        states = rospy.Publisher("/mission/state", MissionState, queue_size=1, latch=True)
        states.publish(MissionState(phase_name="CONFIGURATIONS"))
        home, refused = rospy.ServiceProxy("/set_home", SetHome), []

        def says_no():
            refused[:] = [
                home(self.names[0]).message,
                rospy.ServiceProxy("/calibrate", Calibrate)([], 0.0).message,
            ]
            return all("while the mission flies the vehicles" in text for text in refused)

        until(says_no, what="no new home or calibration in flight")
        states.publish(MissionState(phase_name="DONE"))
        states.unregister()

    def _apart_m(self, name, vehicle, T_odom_home):
        """By odometry of the camera pose's stamp, as near as there is one."""
        from fcsv_geometry.ros import conversions

        camera, odometry = self[f"/{name}/camera_pose"], self[f"/{name}/odometry/state"]
        if abs((camera.header.stamp - odometry.header.stamp).to_sec()) > 1e-6:
            return np.inf
        T = (
            transforms.invert(T_odom_home)
            @ conversions.pose_to_transform(odometry.pose.pose)
            @ vehicle.T_body_cam
        )
        return float(np.linalg.norm((T - conversions.pose_to_transform(camera.pose.pose))[:3]))

    def close(self):
        for each in self._heard:
            each.unregister()

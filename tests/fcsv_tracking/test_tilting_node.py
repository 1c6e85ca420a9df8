# SPDX-License-Identifier: Apache-2.0
"""The tilting rig's node on a master: a simulated bus behind it, the live map after it."""

import time

import numpy as np
import pytest
import yaml
from support.scenes import CAMERA, NEAR_M, photograph
from support.waiting import within

from fcsv_geometry import transforms
from fcsv_sim.gimbal.dynamixel_bus import SimulatedBus
from fcsv_tracking.tilting.aim import crossing
from fcsv_tracking.tilting.rig import SIDES, TiltAngles, load_rig

pytestmark = [pytest.mark.ros, pytest.mark.slow]
LOOKED_AT_M = 1.2
SCALE = NEAR_M / LOOKED_AT_M  # the scene of the walls, as a model of a tenth
until = within(60.0)


def small_rig(root, folder):
    document = yaml.safe_load((root / "config/tilting/rig.yaml").read_text())
    c = CAMERA
    lens = {
        "width": c.width,
        "height": c.height,
        **{k: float(getattr(c, k)) for k in ("fx", "fy", "cx", "cy")},
    }
    for side in SIDES:
        document[side]["camera"] = dict(lens)
    document["name"] = "t_rig"
    (folder / "rig.yaml").write_text(yaml.safe_dump(document))
    return folder / "rig.yaml"


@pytest.mark.slow_motion
def test_it_turns_to_the_distance_and_its_pictures_become_live_depth(start_node, root, tmp_path):
    import rospy
    import tf2_ros
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from sensor_msgs.msg import Image, JointState, Range

    from fcsv_geometry.ros import conversions
    from fcsv_tracking.ros import joint_messages

    path = small_rig(root, tmp_path)
    rig = load_rig(path)
    joints, depths, poses = [], [], []
    heard = [
        rospy.Subscriber("/t_rig/joint_states", JointState, joints.append),
        rospy.Subscriber("/map/depth", Image, depths.append),
        rospy.Subscriber("/t_rig_right/camera_pose", PoseWithCovarianceStamped, poses.append),
    ]
    distance = rospy.Publisher("/t_rig/distance", Range, queue_size=5)
    command = rospy.Publisher("/t_rig/command", JointState, queue_size=5)
    cameras = {
        s: rospy.Publisher(f"/t_rig_{s}/camera/image_raw", Image, queue_size=5) for s in SIDES
    }
    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer)
    with SimulatedBus([1, 2]) as bus:
        params = {"rig_file": str(path), "port": bus.port, "rate_hz": 20.0, "follow_map": False}
        process = start_node("fcsv_tracking", "tilting", params=params)
        names = [rig.camera_name(s) for s in SIDES]
        start_node(
            "fcsv_stereo",
            "live_map",
            ns="t_map",
            params={"vehicles": names, "monitor": True, "refine_every": 20, "bars": True},
        )
        until(
            lambda: joints and distance.get_num_connections() and command.get_num_connections(),
            what="joints",
        )

        command.publish(joint_messages.to_message(time.time(), "t_rig/rig", [0.3, 0.1], SIDES))
        until(
            lambda: np.allclose(joints[-1].position, [0.3, 0.1], atol=0.004),
            what="the angles by hand",
        )
        for wrong in (float("nan"), -1.0):
            distance.publish(
                Range(header=conversions.header(time.time(), "t_rig/rig"), range=wrong)
            )
        distance.publish(
            Range(header=conversions.header(time.time(), "t_rig/rig"), range=LOOKED_AT_M)
        )
        goal = crossing(rig, LOOKED_AT_M)
        until(
            lambda: np.allclose(joints[-1].position, goal, atol=0.004),
            what="the angles for the distance",
        )

        def photographed():
            now_s, angles = time.time(), TiltAngles(*joints[-1].position)
            for side in SIDES:
                T = rig.T_rig_cam(side, angles)
                T[:3, 3] *= SCALE
                frame = f"t_rig_{side}/camera_optical"
                cameras[side].publish(
                    conversions.array_to_image(photograph(T), "rgb8", now_s, frame)
                )

        until(lambda: len(depths) >= 2, 60.0, lambda: process.tail(20), photographed, every_s=0.4)
        depth = conversions.image_to_array(depths[-1])
        middle = depth[100:140, 140:180]
        assert abs(np.nanmedian(middle) / LOOKED_AT_M - 1.0) < 0.05  # JPEG, one pair
        assert np.linalg.eigvalsh(np.array(poses[-1].pose.covariance).reshape(6, 6)).min() > 0
        stamp = poses[-1].header.stamp
        until(lambda: buffer.can_transform("home", "t_rig_right/camera_optical", stamp), what="tf")
        found = conversions.transform_from_msg(
            buffer.lookup_transform("home", "t_rig_right/camera_optical", stamp).transform
        )
        assert (
            transforms.rotation_angle(found, conversions.pose_to_transform(poses[-1].pose.pose))
            < 0.01
        )
        assert process.returncode is None
        process.stop(grace_s=10.0)
        until(lambda: not any(s.axis.torque for s in bus.servos.values()), what="torque off")
    listener.unregister()
    for each in (*heard, distance, command, *cameras.values()):
        each.unregister()

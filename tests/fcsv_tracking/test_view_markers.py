# SPDX-License-Identifier: Apache-2.0
"""Fields of view of gimbals and mocap as markers: the right frame, the right opening, from the node
on its topic."""

import numpy as np
import pytest
from support.waiting import within

from fcsv_geometry import frames
from fcsv_geometry import transforms as tf
from fcsv_geometry.camera import PinholeCamera

CAMERA = PinholeCamera.from_fov(1920, 1080, np.radians(21.5))
until = within(60.0)


def ends(marker):
    """Points (N, 3) of a view's lines in the marker's frame, its apex left out."""
    from fcsv_geometry.ros import conversions

    p = np.array([[q.x, q.y, q.z] for q in marker.points])
    return tf.apply(conversions.pose_to_transform(marker.pose), p[np.linalg.norm(p, axis=1) > 0])


def test_a_gimbal_sees_along_its_optical_axis_as_wide_as_its_camera_says():
    from fcsv_tracking.ros.tracking_markers import gimbal_views

    views = gimbal_views({"tello2": CAMERA, "tello1": CAMERA})
    assert [v.header.frame_id for v in views] == [
        frames.gimbal_optical(n) for n in ("tello1", "tello2")
    ]
    assert all(v.frame_locked for v in views) and len({v.id for v in views}) == 2
    p = ends(views[0])
    assert (p[:, 2] == p[0, 2]).all() and p[0, 2] > 0
    across_deg = 2.0 * np.degrees(np.arctan(np.abs(p[:, 0]).max() / p[0, 2]))
    assert across_deg == pytest.approx(21.5, abs=1e-6)
    assert np.abs(p[:, 1]).max() / np.abs(p[:, 0]).max() == pytest.approx(1080 / 1920)


def test_before_home_vehicles_stand_in_a_column_and_move_by_their_odometry(root):
    from fcsv_geometry.vehicles.vehicle import load_vehicles
    from fcsv_tracking.ros.vehicle_markers import assumed_place, vehicle_markers

    uav2 = load_vehicles(root / "config" / "vehicles", ["uav2"])["uav2"]
    T = assumed_place(1, 8.0, tf.from_xyz_yaw([0.5, 0.0, 2.0], np.pi / 2))
    assert np.allclose(T[:3, 3], [-3.0, 0.0, -6.0])  # from the ground up, behind the first
    from fcsv_geometry.ros import conversions

    body, tag, sight, label = vehicle_markers(uav2, 1, T)
    assert {m.header.frame_id for m in (body, tag, sight, label)} == {
        frames.HOME
    } and "home is not set" in label.text
    assert np.allclose(conversions.pose_to_transform(tag.pose), T @ uav2.T_body_tag, atol=1e-9)
    assert np.allclose(conversions.pose_to_transform(sight.pose), T @ uav2.T_body_cam, atol=1e-9)
    locked = vehicle_markers(uav2, 1)
    assert [m.header.frame_id for m in locked] == [
        frames.base_link("uav2"),
        frames.tag("uav2"),
        frames.camera_optical("uav2"),
        frames.base_link("uav2"),
    ] and all(m.frame_locked for m in locked)
    # each replaces what was drawn before
    assert [m.id for m in locked] == [m.id for m in (body, tag, sight, label)]


def test_the_mocap_looks_along_its_x():
    from fcsv_tracking.ros.tracking_markers import mocap_view

    p = ends(mocap_view("mocap", (47.0, 43.0)))
    assert (p[:, 0] > 0).all() and np.allclose(p[:, 0], p[0, 0])
    for axis, fov_deg in ((1, 47.0), (2, 43.0)):
        assert 2 * np.degrees(np.arctan(np.abs(p[:, axis]).max() / p[0, 0])) == pytest.approx(
            fov_deg, abs=1e-6
        )


@pytest.mark.ros
@pytest.mark.slow
def test_the_node_draws_them_beside_the_ellipsoids(start_node, root):
    """The mocap's at once, a gimbal's once its camera_info is there, and none from one that is not
    calibrated."""
    import rospy
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from sensor_msgs.msg import CameraInfo
    from tf2_msgs.msg import TFMessage
    from visualization_msgs.msg import MarkerArray

    from fcsv_geometry.ros import conversions

    got = []
    rospy.Subscriber("/tracking/markers", MarkerArray, got.append)
    infos = {
        n: rospy.Publisher(f"/{n}/gimbal/camera/camera_info", CameraInfo, queue_size=2, latch=True)
        for n in ("tello1", "tello2")
    }
    infos["tello1"].publish(conversions.info_from_camera(CAMERA, 1.0, "tello1/gimbal_optical"))
    infos["tello2"].publish(CameraInfo(width=1920, height=1080))
    vehicles = []
    rospy.Subscriber("/tracking/vehicles", MarkerArray, vehicles.append)
    start_node(
        "fcsv_tracking",
        "markers",
        params={
            "vehicles": ["tello1", "tello2"],
            "vehicles_dir": str(root / "config" / "vehicles"),
            "mocap_fov_deg": [47.0, 43.0],
            "fixed_parts": True,
        },
    )
    told = []
    rospy.Subscriber("/tf_static", TFMessage, told.append)  # late, as rviz is beside a bag
    wanted = {"view", "tello1/camera_optical", "tello2/tag"}
    until(
        lambda: wanted <= {t.child_frame_id for m in told for t in m.transforms},
        what="what does not move",
    )
    until(lambda: vehicles and len(vehicles[-1].markers) == 8, what="both vehicles")
    # it is not set: their frames have no place
    assert {m.header.frame_id for m in vehicles[-1].markers} == {"home"}
    assert got and not got[-1].markers
    home = rospy.Publisher(
        "/tello1/camera_pose", PoseWithCovarianceStamped, queue_size=1, latch=True
    )
    pose = PoseWithCovarianceStamped().pose
    home.publish(conversions.header(1.0, "home"), pose)  # no rotation: dropped
    pose.pose.orientation.w = 1.0
    home.publish(conversions.header(1.0, "home"), pose)
    drawn = {
        ("covariance of tello1", "home"),
        ("gimbal views", "tello1/gimbal_optical"),
        ("mocap view", "mocap"),
    }
    until(lambda: {(m.ns, m.header.frame_id) for m in got[-1].markers} == drawn, what="both views")
    until(
        lambda: "tello1/base_link" in {m.header.frame_id for m in vehicles[-1].markers},
        what="its own frame",
    )
    assert {m.header.frame_id for m in vehicles[-1].markers if m.ns == "tello2"} == {"home"}


@pytest.mark.ros
@pytest.mark.slow
def test_a_field_of_view_that_is_none_is_refused(start_node, root):
    params = {
        "vehicles": ["tello1"],
        "vehicles_dir": str(root / "config" / "vehicles"),
        "mocap_fov_deg": [470.0, 43.0],
    }
    process = start_node("fcsv_tracking", "markers", params=params)
    until(lambda: process.returncode is not None, what="the end of the node")
    assert process.returncode == 2 and "mocap_fov_deg" in process.tail(20)

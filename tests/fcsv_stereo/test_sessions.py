# SPDX-License-Identifier: Apache-2.0
"""Sessions: small real bags, whole and broken."""

import numpy as np
import pytest
import rosbag
import rospy
from geometry_msgs.msg import PoseWithCovariance
from nav_msgs.msg import Odometry
from scenes import CAMERA, camera_pose, photograph, true_depth
from tf2_msgs.msg import TFMessage

from fcsv_geometry import frames, transforms
from fcsv_geometry.ros import conversions
from fcsv_msgs.msg import Calibration, CalibrationLink, Capture, Configuration, Home
from fcsv_stereo import pipeline
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.errors import InputError
from fcsv_stereo.output import read_ply
from fcsv_stereo.ros.session_bags import read_session
from fcsv_stereo.thesis import ThesisOptions

T0 = 1000.0
T_BODY_CAM = transforms.from_xyz_rpy([0.1, 0.0, 0.02], [0, 0, 0]) @ transforms.transform(
    transforms.R_FLU_OPTICAL, np.zeros(3)
)
T_O1_HOME = transforms.from_xyz_yaw([2.0, -1.0, 5.0], 0.6)
T_O1_O2 = transforms.from_xyz_yaw([-3.0, 4.0, 0.5], -1.1)
T_HOME_CAM = {"uav1": camera_pose([0, 0, 0], (0.2, 0.1, -0.3)), "uav2": camera_pose([0, -0.8, 0], (-0.2, 0.2, 0.3))}


def odom_cam(vehicle):
    T_odom_home = T_O1_HOME if vehicle == "uav1" else transforms.invert(T_O1_O2) @ T_O1_HOME
    return T_odom_home @ T_HOME_CAM[vehicle]


def write_session(
    folder, drop=(), encoding="rgb8", window=(T0, T0 + 1.0), stamp_offset_s=0.0, encode=None, windows=None
):
    """A session of one configuration, or of as many as ``windows``; ``drop`` leaves topics out (by their end).

    ``encode`` makes what a picture holds of its RGB; without it ``encoding`` is only what it says.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for vehicle in T_HOME_CAM:
        with rosbag.Bag(str(folder / f"{vehicle}.bag"), "w") as bag:
            write_vehicle(bag, vehicle, drop, encoding, stamp_offset_s, encode)
    with rosbag.Bag(str(folder / "control.bag"), "w") as bag:
        write_control(bag, drop, windows or [window])
    (folder / "session.yaml").write_text("version: 1\nbags: {uav1: uav1.bag, uav2: uav2.bag, control: control.bag}\n")
    return folder


def put(bag, topic, message, stamp_s, drop):
    if not any(topic.endswith(d) for d in drop):
        bag.write(topic, message, rospy.Time.from_sec(stamp_s))


def write_vehicle(bag, vehicle, drop, encoding, stamp_offset_s, encode):
    fixed = conversions.transform_stamped(T_BODY_CAM, T0, frames.base_link(vehicle), frames.camera_optical(vehicle))
    put(bag, "/tf_static", TFMessage([fixed]), T0, drop)
    T_odom_body = odom_cam(vehicle) @ transforms.invert(T_BODY_CAM)
    for i in range(60):
        t = T0 - 0.5 + i * 0.05
        odometry = Odometry(header=conversions.header(t, frames.odom(vehicle)))
        odometry.pose = PoseWithCovariance(pose=conversions.transform_to_pose(T_odom_body))
        put(bag, f"/{vehicle}/odometry/body", odometry, t, drop)
    picture = photograph(T_HOME_CAM[vehicle])
    for i in range(4):
        t = T0 + 0.1 + 0.25 * i + stamp_offset_s
        frame_id = f"{vehicle}/camera_color_optical_frame"
        if encode is None:
            image = conversions.array_to_image(picture, "rgb8", t, frame_id)
            image.encoding = encoding
        else:
            image = conversions.array_to_image(encode(picture), encoding, t, frame_id)
        put(bag, f"/{vehicle}/camera/color/image_raw", image, t, drop)
        info = conversions.info_from_camera(CAMERA, t, image.header.frame_id)
        put(bag, f"/{vehicle}/camera/color/camera_info", info, t, drop)


def write_control(bag, drop, windows):
    link = CalibrationLink(
        parent="uav1", child="uav2", child_odom_in_parent_odom=conversions.transform_to_pose(T_O1_O2)
    )
    put(bag, "/calibration", Calibration(conversions.header(T0, "uav1/odom"), [link]), T0, drop)
    home = Home(conversions.header(T0, "uav1/odom"), "uav1", conversions.transform_to_pose(T_O1_HOME))
    put(bag, "/home", home, T0, drop)
    for index, window in enumerate(windows):
        capture = Capture(header=conversions.header(T0, ""), index=index, reference="uav1", vehicle="uav2")
        name = f"horizontal 0.8 m{f' ({index})' if index else ''}"
        capture.configuration = Configuration(name, Configuration.HORIZONTAL, 0.8, 0.0, 1.0)
        capture.start, capture.stop = (rospy.Time.from_sec(t) for t in window)
        put(bag, "/mission/capture", capture, T0, drop)


OPTIONS = ThesisOptions(threshold=ErrorThreshold(5.0, False))


def test_a_session_becomes_a_map(tmp_path):
    session = write_session(tmp_path / "session")
    out = tmp_path / "map"
    document = pipeline.run(session, out, "thesis", OPTIONS, None, lambda *_: None)
    depth = np.load(out / "depth.npy")
    truth = true_depth(T_HOME_CAM["uav1"])
    known = np.isfinite(depth)
    assert known.mean() > 0.5 and np.median(np.abs(depth - truth)[known] / truth[known]) < 0.08
    assert np.allclose(document["reference"]["T_home_cam"], T_HOME_CAM["uav1"], atol=1e-6)
    cloud = read_ply(out / "map.ply")
    assert len(cloud) == document["points"] and cloud.points_home_m[:, 0].max() < 30.0
    assert (out / "report.html").stat().st_size > 10000
    pipeline.run(session, out, "thesis", OPTIONS, None, lambda *_: None)  # an earlier map is replaced


def test_one_bag_that_holds_everything_is_a_session(tmp_path):
    session = write_session(tmp_path / "session")
    merged = tmp_path / "all.bag"
    with rosbag.Bag(str(merged), "w") as target:
        for name in ("uav1", "uav2", "control"):
            with rosbag.Bag(str(session / f"{name}.bag")) as source:
                for topic, message, t in source.read_messages():
                    target.write(topic, message, t)
    given = read_session(merged)
    assert len(given.configurations[0].references) == 4 and given.truth_folder is None


@pytest.mark.parametrize("changes, words", [
    ({"drop": ("capture",)}, ["/mission/capture", "no configuration was recorded"]),
    ({"drop": ("/calibration",)}, ["/calibration", "never calibrated"]),
    ({"drop": ("/home",)}, ["/home", "never set"]),
    ({"drop": ("camera_info",)}, ["camera_info", "missing"]),
    ({"drop": ("odometry/body",)}, ["odometry/body", "missing"]),
    ({"drop": ("/tf_static",)}, ["/tf_static", "base_link"]),
    ({"drop": ("image_raw",)}, ["no configuration has pictures"]),
    ({"encoding": "yuv422"}, ["image_raw", "yuv422", "rgb8"]),
    ({"window": (T0 + 50, T0 + 51)}, ["overlap in time"]),
    ({"stamp_offset_s": 0.6, "drop": ("odometry/body",)}, ["odometry/body"]),
])  # fmt: skip
def test_bad_sessions_are_named_in_one_line(tmp_path, changes, words):
    session = write_session(tmp_path / "session", **changes)
    with pytest.raises(InputError) as error:
        pipeline.run(session, tmp_path / "map", "thesis", OPTIONS, None, lambda *_: None)
    assert "\n" not in str(error.value) and all(w in str(error.value) for w in words), str(error.value)
    assert [p.name for p in tmp_path.iterdir()] == ["session"]


def test_a_truncated_bag(tmp_path):
    session = write_session(tmp_path / "session")
    path = session / "uav2.bag"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputError, match=r"uav2\.bag: is truncated .*rosbag reindex"):
        read_session(session)


def test_a_missing_and_an_unclosed_bag(tmp_path):
    session = write_session(tmp_path / "session")
    (session / "uav2.bag").rename(session / "uav2.bag.active")
    with pytest.raises(InputError, match="never closed"):
        read_session(session)
    (session / "uav2.bag.active").unlink()
    with pytest.raises(InputError, match=r"uav2\.bag is missing"):
        read_session(session)


def test_pictures_without_odometry_are_left_out_and_said(tmp_path):
    session = write_session(tmp_path / "session", stamp_offset_s=2.0, window=(T0 + 1.5, T0 + 3.0))
    given = read_session(session)
    assert any("no odometry at their stamp" in w for w in given.warnings)
    assert len(given.configurations[0].references) < 4


def test_neither_session_nor_photographs(tmp_path):
    with pytest.raises(InputError, match="neither a session"):
        pipeline.load(tmp_path)
    with pytest.raises(InputError, match="does not exist"):
        pipeline.load(tmp_path / "nowhere")

# SPDX-License-Identifier: Apache-2.0
"""uav.launch of a real vehicle: which driver starts, with which settings and names; wrong choices
are errors."""

import pytest
from support.launched import fake_realsense, launched
from support.mavros_package import installed, stand_in


@pytest.fixture(scope="module")
def launch(root, tmp_path_factory):
    """launch(*arguments) of uav.launch with realsense2_camera installed; ``without`` it where
    asked."""
    packages = fake_realsense(tmp_path_factory.mktemp("packages"))

    def load(*arguments, without=False):
        given = ("uav:=uav1", *arguments)
        return launched(root / "launch/uav.launch", *given, packages=None if without else packages)

    return load


def test_the_thesis_cameras_start_by_serial_number_under_the_names_of_the_driver(launch):
    found = launch(
        "camera_serial:=0123456789", "odometry_serial:=2322110", "exposure_us:=2000", "gain:=32"
    )
    params = found["params"]
    camera, t265 = "/uav1/camera/realsense2_camera/", "/uav1/t265/realsense2_camera/"
    assert [
        params[camera + n]
        for n in ("serial_no", "device_type", "tf_prefix", "enable_color", "respawn")
    ] == ["0123456789", "d4", "uav1/camera", "True", "true"]
    assert [
        params[t265 + n]
        for n in ("serial_no", "device_type", "tf_prefix", "enable_pose", "publish_odom_tf")
    ] == ["2322110", "t265", "uav1/t265", "true", "false"]
    # colour: exposure in 100 us; the projector is off
    assert params["/uav1/camera/rgb_camera/enable_auto_exposure"] is False
    assert (params["/uav1/camera/rgb_camera/exposure"], params["/uav1/camera/rgb_camera/gain"]) == (
        20,
        32,
    )
    assert params["/uav1/camera/stereo_module/emitter_enabled"] == 0
    assert "/uav1/camera/stereo_module/exposure" not in params
    watched = [params[f"/uav1/driver_watch/devices/{d}/topic"] for d in ("camera", "odometry")]
    assert watched == ["camera/color/camera_info", "t265/odom/sample"]
    names = (
        params["/uav1/driver_watch/devices/odometry/nodes"]
        + params["/uav1/driver_watch/devices/camera/nodes"]
    )
    assert names and {"/uav1/" + n for n in names} <= set(found["nodes"])
    for device, prefix in (("camera", camera), ("odometry", t265)):
        assert f"/uav1/{params[f'/uav1/driver_watch/devices/{device}/reset']}" == prefix + "reset"


def test_the_autopilots_port_reaches_either_flight_link(root, tmp_path):
    """Whose stream rates the profile means."""
    packages = fake_realsense(tmp_path / "packages")
    if not installed():
        stand_in(packages, "exit 1")
    for link in ("mavlink", "mavros"):
        params = launched(
            root / "launch/uav.launch",
            "uav:=uav1",
            f"flight_link:={link}",
            "autopilot_port:=1",
            "fcu_url:=/dev/ttyTHS1:921600",
            packages=packages,
        )["params"]
        assert params["/uav1/flight_link/autopilot_port"] == 1
        assert params["/uav1/flight_link/fcu_url"] == "/dev/ttyTHS1:921600"


def test_infrared_stands_in_the_place_of_colour(launch):
    found = launch("infrared:=true", "exposure_us:=2000", "gain:=32")
    params, load = found["params"], found["nodes"]["/uav1/camera/realsense2_camera"]
    assert load["remaps"] == {
        "infra1/image_rect_raw": "color/image_raw",
        "infra1/camera_info": "color/camera_info",
    }
    camera = "/uav1/camera/realsense2_camera/"
    assert [params[camera + n].lower() for n in ("enable_infra1", "enable_color")] == [
        "true",
        "false",
    ]
    stereo = [
        params[f"/uav1/camera/stereo_module/{n}"]
        for n in ("enable_auto_exposure", "exposure", "gain")
    ]
    assert stereo == [False, 2000, 32] and not any("/rgb_camera/" in n for n in params)
    assert launch()["nodes"]["/uav1/camera/realsense2_camera"]["remaps"] == {}


def test_depth_is_recorded_where_the_near_field_is_wanted(launch):
    """In the pixels of the pictures; nothing of it runs or is recorded otherwise."""
    driver, topics = "/uav1/camera/realsense2_camera/", "/uav1/recorder/topics"
    off, on = launch()["params"], launch("near:=true")["params"]
    assert topics not in off and [
        off[driver + n].lower() for n in ("enable_depth", "align_depth")
    ] == ["false", "false"]
    assert on[topics] == [
        f"/uav1/camera/aligned_depth_to_color/{n}" for n in ("image_raw", "camera_info")
    ]
    shape = [
        on[driver + n].lower()
        for n in ("enable_depth", "align_depth", "depth_width", "depth_height", "depth_fps")
    ]
    assert shape == ["true", "true", "848", "480", "6"]
    infrared = launch("near:=true", "infrared:=true")
    assert infrared["params"][driver + "align_depth"].lower() == "false"
    assert (
        infrared["params"][driver + "depth_width"]
        == infrared["params"][driver + "infra_width"]
        == "640"
    )
    assert (
        infrared["params"][driver + "depth_fps"] == infrared["params"][driver + "infra_fps"] == "30"
    )
    throttle = infrared["nodes"]["/uav1/depth_throttle"]["args"].split()
    assert throttle[1::2] == [
        "camera/depth/image_rect_raw",
        "camera/aligned_depth_to_color/image_raw",
    ]
    simulated = launch("sim:=true", "near:=true", without=True)["params"]
    assert simulated["/uav1/camera/near"] is True and simulated[topics] == on[topics]


def test_exposure_is_automatic_unless_given(launch):
    params = launch()["params"]
    assert params["/uav1/camera/rgb_camera/enable_auto_exposure"] is True
    assert (
        "/uav1/camera/rgb_camera/exposure" not in params
        and "/uav1/camera/rgb_camera/gain" not in params
    )


def test_other_cameras_and_trackers_need_no_realsense(launch):
    found = launch(
        "camera:=usb_cam",
        "video_device:=/dev/video7",
        "odometry:=topic",
        "odometry_topic:=/vins/odometry",
        "exposure_us:=5000",
        "gain:=3",
        without=True,
    )
    nodes, params = found["nodes"], found["params"]
    assert nodes["/uav1/camera/usb_cam"]["remaps"] == {
        "usb_cam/image_raw": "color/image_raw",
        "usb_cam/camera_info": "color/camera_info",
    }
    usb_cam = [
        params[f"/uav1/camera/usb_cam/{n}"]
        for n in ("video_device", "autoexposure", "exposure", "gain")
    ]
    assert usb_cam == ["/dev/video7", False, 50, 3]
    assert nodes["/uav1/odometry_relay"]["args"] == "/vins/odometry t265/odom/sample"
    # somebody else's: told, not touched
    assert "/uav1/driver_watch/devices/odometry/nodes" not in params


def test_a_topic_of_the_right_name_is_taken_as_it_is(launch):
    nodes = launch("camera:=topic", "odometry:=topic", without=True)["nodes"]
    assert not [n for n in nodes if n.endswith("_relay")] and "/uav1/driver_watch" in nodes
    nodes = launch(
        "camera:=topic", "odometry:=topic", "image_topic:=/a", "camera_info_topic:=/b", without=True
    )["nodes"]
    assert nodes["/uav1/camera_relay"]["args"] == "/a camera/color/image_raw"
    assert nodes["/uav1/camera_info_relay"]["args"] == "/b camera/color/camera_info"


@pytest.mark.parametrize(
    "arguments, without, said",
    [
        (["camera:=webcam"], False, ["camera:=webcam", "known are realsense, usb_cam, topic"]),
        (["odometry:=t625"], False, ["odometry:=t625", "known are t265, topic"]),
        ([], True, ["realsense2_camera"]),
        (["exposure_us:=fast"], False, ["fast"]),
    ],
)
def test_a_wrong_choice_or_a_missing_package_is_named(launch, arguments, without, said):
    error = launch(*arguments, without=without).get("error", "")
    assert error and all(word in error for word in said), error


def test_a_simulated_vehicle_has_no_drivers(launch):
    nodes = launch("sim:=true", without=True)["nodes"]
    assert "/uav1/driver_watch" not in nodes and "/uav1/t265" in nodes

# SPDX-License-Identifier: Apache-2.0
"""The user's own camera in the simulation: its rays, what is refused and why, and that every
vehicle gets it."""

import xml.etree.ElementTree as xml
from dataclasses import replace

import numpy as np
import pytest
from support.towns import street_renderer
from support.waiting import within

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.camera_file import read_camera, write_camera
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.demo import demo
from fcsv_sim.demo.fleet import SimulatedFleet
from fcsv_sim.demo.own_camera import own_camera
from fcsv_sim.errors import SimulationError
from fcsv_sim.render import lens
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera

until = within(60.0)

NO = (0.0,) * 5
OWN = PinholeCamera(800, 600, 640.0, 641.0, 404.0, 296.0, (-0.23, 0.07, 0.0008, -0.0005, 0.0))
#: A webcam whose corners OpenCV's five steps of inversion miss by 48 px, and one whose outermost
#: corners fold.
WIDE, FOLDED = (-0.28, 0.07, 0.0, 0.0, 0.0), (-0.30, 0.09, 0.0, 0.0, -0.011)
RATIONAL = (1.0, 0.3, 0.0, 0.0, 0.01, 1.4, 0.6, 0.05)


@pytest.fixture(autouse=True)
def free_processors(monkeypatch):
    """Tests that run beside these take nothing from a demo: tests/fcsv_sim/test_crowd.py."""
    monkeypatch.setattr(demo.CrowdWatch, "look_before", lambda self, say: None)


def camera(focal_px, distortion, width=640, height=480):
    return PinholeCamera(
        width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, distortion
    )


def off_px(c, directions):
    """(H,W): how far each ray is seen from its own pixel."""
    v, u = np.mgrid[: c.height, : c.width]
    seen = c.project(directions.reshape(-1, 3)).reshape(c.height, c.width, 2)
    return np.linalg.norm(seen - np.dstack([u, v]), axis=2)


@pytest.mark.parametrize(
    "c", [camera(602.0, NO), CameraParameters().model], ids=["pinhole", "usual"]
)
def test_lenses_that_opencv_inverts_have_its_rays_to_the_last_bit(c):
    directions, seen = lens.directions(c)
    assert np.array_equal(directions, c.rays()) and seen.all()


@pytest.mark.parametrize(
    "c, dark",
    [
        (OWN, 0.0),
        (camera(300.0, WIDE), 0.0),
        (camera(420.0, RATIONAL), 0.0),
        (camera(350.0, FOLDED), 0.0052),
    ],
)
def test_every_pixels_ray_is_seen_in_its_pixel_or_there_is_none(c, dark):
    """To 1/1000 px, below which OpenCV's own rays are kept."""
    directions, seen = lens.directions(c)
    assert off_px(c, directions)[seen].max() <= 1e-3
    assert 1.0 - seen.mean() == pytest.approx(dark, abs=2e-4)
    assert seen[c.height // 4 : -c.height // 4].all() and np.array_equal(
        directions[..., 2], np.ones(seen.shape)
    )


def test_opencv_alone_would_have_drawn_the_corners_of_a_webcam_wrong():
    """What the inversion is for."""
    c = camera(300.0, WIDE)
    assert np.nanmax(off_px(c, c.rays())) > 10.0


def test_pixels_without_a_ray_are_black_and_without_depth():
    c = camera(87.5, FOLDED, 160, 120)
    _, seen = lens.directions(c)
    T_world_cam = transforms.from_xyz_rpy([1, 0, 8], [0, 0, 0]) @ transforms.transform(
        transforms.R_FLU_OPTICAL, np.zeros(3)
    )
    renderer = street_renderer()
    rgb, depth = renderer.render(T_world_cam, c, samples=1)
    assert not seen.all() and (rgb[~seen] == 0).all() and np.isnan(depth[~seen]).all()
    assert rgb[seen].mean() > 40 and np.isfinite(depth[seen]).mean() > 0.3
    whole, _ = renderer.render(T_world_cam, camera(87.5, NO, 160, 120), samples=1)
    assert (whole[~seen] > 0).any()  # the next camera has all of its pixels


def test_a_point_is_where_the_camera_model_says(root):
    """Undistorted by its own calibration a picture is the one of the same camera without
    distortion.

    To 12 levels in the median pixel: one pixel's blur by resampling at the town's edges.
    """
    c = camera(160.0, WIDE, 320, 240)
    T_world_cam = transforms.from_xyz_rpy([1, 0, 8], [0, 0, 0]) @ transforms.transform(
        transforms.R_FLU_OPTICAL, np.zeros(3)
    )
    renderer = street_renderer()
    straight = c.undistort(renderer.render(T_world_cam, c)[0]).astype(float)
    wanted = renderer.render(T_world_cam, c.undistorted())[0].astype(float)
    inside = np.ones(straight.shape[:2], bool) if c.blank() is None else ~c.blank()
    assert np.median(np.abs(straight - wanted)[inside]) < 3.0
    assert np.mean(np.abs(straight - wanted)[inside] > 40.0) < 0.05


@pytest.mark.parametrize(
    "c, words",
    [
        (
            camera(3000.0, NO, 3840, 2160),
            ["3840x2160", "too long to render", "divide size, fx, fy, cx, cy"],
        ),
        (camera(90.0, NO, 100, 80), ["100x80", "too small"]),
        (camera(240.0, FOLDED), ["folds", "% of the pixels have no ray", "rational_polynomial"]),
    ],
)
def test_what_cannot_be_rendered_is_refused_by_name(c, words):
    with pytest.raises(SimulationError) as error:
        lens.require_can_be_rendered(c)
    assert all(w in str(error.value) for w in words)


def test_a_picture_at_the_bound_is_rendered():
    lens.require_can_be_rendered(camera(1500.0, NO, 1920, 1200))


@pytest.fixture
def column(root):
    mission = load_mission(root / "config/missions/short.yaml")
    return mission, load_vehicles(root / "config/vehicles", ["uav1", "uav2"])


def test_the_own_camera_is_that_of_the_file_at_a_rate_that_its_size_allows(column, tmp_path):
    write_camera(tmp_path / "own.yaml", "front", OWN)
    own = own_camera(str(tmp_path / "own.yaml"), *column)
    assert own.camera == OWN and own.rate_hz == pytest.approx(
        5.5 * 640 * 480 / (800 * 600), abs=0.01
    )
    assert "'front'" in own.words and "800x600, f 640 px, 3.52 pictures" in own.words
    write_camera(tmp_path / "small.yaml", "front", camera(320.0, NO, 320, 240))
    assert own_camera(str(tmp_path / "small.yaml"), *column).rate_hz == 5.5


@pytest.mark.parametrize(
    "change, words",
    [
        (
            ("plumb_bob", "equidistant"),
            "'equidistant' is of a fisheye; only pinhole cameras are known: undistort",
        ),
        (("plumb_bob", "field_of_view"), "distortion model 'field_of_view' is not known"),
        (("image_width: 800", "image_width: 8000"), "is it in mm, or of a smaller picture?"),
        (("camera_matrix", "K"), "'camera_matrix' is missing"),
    ],
)
def test_a_file_that_cannot_be_simulated_is_one_line_and_starts_nothing(
    tmp_path, capsys, change, words
):
    path = tmp_path / "own.yaml"
    write_camera(path, "front", OWN)
    path.write_text(path.read_text().replace(*change))
    assert demo.main(["--camera", str(path), "--out", str(tmp_path / "out"), "--speed", "1"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"demo: --camera {path}: ") and said.count("\n") == 1 and words in said
    assert not (tmp_path / "out").exists()


def test_a_lens_too_wide_to_see_the_tag_is_refused_with_a_spacing_that_helps(column, tmp_path):
    mission, vehicles = column
    write_camera(tmp_path / "wide.yaml", "wide", camera(200.0, NO))
    with pytest.raises(
        SimulationError,
        match=r"tag of uav1 \(0.16 m\) is 10 px large at column_spacing_m 3.5.*2.9 m",
    ):
        own_camera(str(tmp_path / "wide.yaml"), mission, vehicles)
    own_camera(str(tmp_path / "wide.yaml"), replace(mission, column_spacing_m=2.9), vehicles)


@pytest.mark.parametrize(
    "system, words",
    [
        ("mocap", "system mocap flies Tellos, which have their own"),
        ("tilting", "tilting has the cameras of its rig"),
    ],
)
def test_systems_with_cameras_of_their_own_refuse_it(tmp_path, capsys, system, words):
    assert (
        demo.main(
            [
                "--system",
                system,
                "--camera",
                "own.yaml",
                "--out",
                str(tmp_path / "out"),
                "--speed",
                "1",
            ]
        )
        == 2
    )
    assert words in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_every_vehicle_is_launched_with_it(root, tmp_path, monkeypatch):
    """Its file and its rate, under arguments that the launch file has and hands to the simulated
    camera."""
    write_camera(tmp_path / "own.yaml", "front", OWN)
    plans = []
    monkeypatch.setattr(demo, "run", lambda system, plan, say, **_: plans.append(plan) or 0)
    arguments = [
        "--camera",
        str(tmp_path / "own.yaml"),
        "--mission",
        "at_once",
        "--out",
        str(tmp_path / "out"),
    ]
    assert demo.main([*arguments, "--speed", "1"]) == 0
    fleet = SimulatedFleet(plans[0])
    given = [fleet._vehicle_args(name, k) for k, name in enumerate(plans[0].vehicles)]
    assert len(given) == 3
    assert {(a["sim_camera"], a["camera_rate_hz"]) for a in given} == {
        (tmp_path / "own.yaml", plans[0].camera.rate_hz)
    }
    launch = xml.parse(root / "launch/uav.launch").getroot()
    parameters = {
        p.get("name"): p.get("value")
        for n in launch.iter("node")
        if n.get("type") == "camera"
        for p in n
    }
    assert (
        parameters["calibration"] == "$(arg sim_camera)"
        and parameters["rate_hz"] == "$(arg camera_rate_hz)"
    )


def test_without_it_the_launch_files_have_their_own_default(tmp_path, monkeypatch):
    plans = []
    monkeypatch.setattr(demo, "run", lambda system, plan, say, **_: plans.append(plan) or 0)
    assert demo.main(["--out", str(tmp_path / "out"), "--speed", "1"]) == 0
    assert plans[0].camera is None and "sim_camera" not in SimulatedFleet(plans[0])._vehicle_args(
        "uav1", 0
    )


def test_the_simulated_camera_takes_its_lens(tmp_path):
    write_camera(tmp_path / "own.yaml", "front", OWN)
    parameters = CameraParameters(lens=read_camera(tmp_path / "own.yaml")[1])
    assert parameters.model == OWN
    c = SimulatedCamera(
        street_renderer(),
        transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3)),
        parameters,
        1,
    )
    shot = c.shoot(0.0, transforms.from_xyz_rpy([1, 0, 8], [0, 0, 0]), samples=1)
    assert shot.rgb.shape == (600, 800, 3) and c.model == OWN


@pytest.mark.ros
def test_the_node_publishes_pictures_and_camera_info_of_the_file(start_node, root, tmp_path):
    import time

    import rospy
    from sensor_msgs.msg import CameraInfo, Image

    from fcsv_geometry.ros import conversions
    from fcsv_sim.truth import TruthWriter

    small = camera(250.0, (-0.23, 0.07, 0.0, 0.0, 0.0), 320, 240)
    write_camera(tmp_path / "own.yaml", "front", small)
    images, infos, writer = [], [], TruthWriter(tmp_path, "uav1")
    subscribers = [
        rospy.Subscriber("/uav1/camera/color/image_raw", Image, images.append),
        rospy.Subscriber("/uav1/camera/color/camera_info", CameraInfo, infos.append),
    ]
    start_node(
        "fcsv_sim",
        "camera",
        ns="uav1",
        params={
            "vehicle": "uav1",
            "vehicles": ["uav1"],
            "vehicles_dir": str(root / "config/vehicles"),
            "sim_dir": str(tmp_path),
            "calibration": str(tmp_path / "own.yaml"),
        },
    )
    until(
        lambda: images and infos,
        what="a picture",
        meanwhile=lambda: writer.write(
            time.time(), transforms.from_xyz_yaw([0, 0, 8], 0.0), np.zeros(3)
        ),
        every_s=0.01,
    )
    for subscriber in subscribers:
        subscriber.unregister()
    assert (images[0].width, images[0].height) == (320, 240)
    assert conversions.camera_from_info(infos[0]) == small

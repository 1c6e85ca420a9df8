# SPDX-License-Identifier: Apache-2.0
"""Where camera and tag sit, from a simulated vehicle moved by hand with the odometry of a simulated
T265."""

import dataclasses
import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.config import ConfigError
from fcsv_geometry.vehicles.tracker import T265_PROFILE, TrackerProfile
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.sensors.t265 import T265
from fcsv_tracking.errors import ExtrinsicsRefused
from fcsv_tracking.mounts.hand_eye import TagView, first_solution
from fcsv_tracking.mounts.refine import calibrate_mount
from fcsv_tracking.mounts.vehicle_file import mount_of, write_mount
from fcsv_tracking.tags import corner_points

CAMERA = PinholeCamera.from_fov(640, 480, np.radians(56.0))
SIZE_M = 0.16
EXACT = TrackerProfile(
    scale=0.0,
    walk_m_per_sqrt_m=0.0,
    heading_deg_per_sqrt_m=0.0,
    level_deg=0.0,
    position_noise_m=0.0,
    attitude_noise_deg=0.0,
)
T_BODY_T265 = transforms.from_xyz_rpy([0.06, 0.0, -0.05], np.radians([0.0, 90.0, 0.0]))


def true_mount(part, random):
    """Where nobody put it on purpose: centimetres and degrees off the drawing."""
    off = transforms.from_xyz_rpy(random.normal(0, 0.02, 3), np.radians(random.normal(0, 2.0, 3)))
    vehicle = VEHICLE()
    return off @ (vehicle.T_body_cam if part == "camera" else vehicle.T_body_tag)


def VEHICLE():
    from fcsv_sim.trials.formation import formation_vehicle

    return formation_vehicle(1)


@dataclasses.dataclass
class ByHand:
    """Half a minute: about a metre in front of what stands still, turned by ``turns_deg`` about
    body x, y, z."""

    seed: int
    part: str = "camera"
    turns_deg: tuple = (18.0, 15.0, 15.0)
    noise_px: float = 0.15
    errors: TrackerProfile = T265_PROFILE
    seconds: float = 30.0

    def __post_init__(self):
        self.random = np.random.default_rng(self.seed)
        self.T_body_part = true_mount(self.part, self.random)
        self.phases = self.random.uniform(0, 2 * np.pi, 6)

    def body(self, t_s):
        """T_world_body: the part stays towards world's x, where the fixed thing is."""
        turn = np.radians(self.turns_deg) * np.sin(
            np.array([1.1, 0.9, 0.7]) * t_s + self.phases[:3]
        )
        place = np.array([0.15, 0.15, 0.1]) * np.sin(
            np.array([0.5, 0.6, 0.8]) * t_s + self.phases[3:]
        )
        turned = transforms.from_xyz_rpy(place, turn)
        return (
            turned
            if self.part == "camera"
            else turned @ transforms.from_xyz_yaw(np.zeros(3), np.pi)
        )

    def views(self, rate_hz=3.0):
        vehicle = VEHICLE()
        T_flu_optical = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
        facing = transforms.from_xyz_rpy([1.1, 0.0, 0.0], [0.0, 0.05, np.pi + 0.1])
        T_flu_tag = dataclasses.replace(vehicle, tag=type(vehicle.tag)((0.0, 0.0, 0.0))).T_body_tag
        T_world_fixed = facing @ (T_flu_tag if self.part == "camera" else T_flu_optical)
        tracker, found = T265(self.errors, T_BODY_T265, self.seed), []
        for i in range(int(self.seconds * 200)):
            t_s, T_world_body = i / 200, self.body(i / 200)
            T_odom_body = tracker.odometry(t_s, T_world_body)[0] @ transforms.invert(T_BODY_T265)
            if i % int(200 / rate_hz):
                continue
            T_world_part = T_world_body @ self.T_body_part
            T_cam_tag = transforms.invert(T_world_part) @ T_world_fixed
            T_cam_tag = T_cam_tag if self.part == "camera" else transforms.invert(T_cam_tag)
            uv = CAMERA.project(transforms.apply(T_cam_tag, corner_points(SIZE_M)))
            if np.isfinite(uv).all() and (uv > 2).all() and (uv < [637, 477]).all():
                uv = uv + self.random.normal(0, self.noise_px, (4, 2))
                found.append(TagView(t_s, CAMERA.normalize(uv), SIZE_M, CAMERA.fx, T_odom_body))
        return found


def error_of(solution, truth):
    """(6,) in the part's own axes, as the covariance has it."""
    T = transforms.invert(solution.T_body_part) @ truth
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec()])


@pytest.mark.parametrize("part", ["camera", "tag"])
def test_exact_without_noise(part):
    hand = ByHand(1, part, noise_px=0.0, errors=EXACT)
    views = hand.views()
    X, _ = first_solution(part, views)
    assert np.allclose(X, hand.T_body_part, atol=1e-4)  # Shah's closed form on exact poses
    solution = calibrate_mount(part, views)
    assert np.allclose(solution.T_body_part, hand.T_body_part, atol=1e-6) and solution.rejected == 0


@pytest.mark.slow
@pytest.mark.parametrize("part", ["camera", "tag"])
def test_figures_and_consistency_with_a_drifting_tracker(part):
    """Eight hands, half a minute each. Median error within the rules' bounds on 1 sigma (1 cm, 0.4
    deg), each inside three times what the solution says of itself; mean of 48 normalised squares at
    most 1.7 (chi square, 99.9 %)."""
    normalised, errors = [], []
    for seed in range(8):
        hand = ByHand(20 + seed, part)
        solution = calibrate_mount(part, hand.views())
        error = error_of(solution, hand.T_body_part)
        errors.append((np.linalg.norm(error[:3]), np.degrees(np.linalg.norm(error[3:]))))
        assert (
            errors[-1][0] < 3 * solution.position_std_m
            and errors[-1][1] < 3 * solution.rotation_std_deg
        )
        normalised.append(error @ np.linalg.solve(solution.covariance, error) / 6)
    print(part, np.round(errors, 4), np.round(normalised, 2))
    assert (np.median(errors, axis=0) < [0.01, 0.4]).all()
    assert 0.2 < np.mean(normalised) < 1.7, normalised


def test_wrong_views_are_left_out():
    hand = ByHand(3)
    views = hand.views()
    for i in (5, 17, 40):
        views[i] = dataclasses.replace(
            views[i], corners_normalized=views[i].corners_normalized + 0.04
        )
    solution = calibrate_mount("camera", views)
    assert (
        solution.rejected >= 3 and np.linalg.norm(error_of(solution, hand.T_body_part)[:3]) < 0.01
    )


@pytest.mark.parametrize(
    "kwargs, word",
    [
        ({"turns_deg": (0.0, 0.0, 20.0)}, r"one axis alone, near its z \(yaw\)"),
        ({"turns_deg": (0.0, 20.0, 0.0)}, r"one axis alone, near its y \(pitch\)"),
        ({"turns_deg": (0.5, 0.5, 0.5)}, "hardly turns"),
        ({"seconds": 4.0}, "views of the tag are usable"),
    ],
)
def test_degenerate_motion_is_refused_and_named(kwargs, word):
    with pytest.raises(ExtrinsicsRefused, match=word):
        calibrate_mount("camera", ByHand(4, **kwargs).views())


def test_a_tag_of_another_size_is_refused():
    """Half the size: the tag seems half as far, which the way that the vehicle moves
    contradicts."""
    views = [dataclasses.replace(v, size_m=SIZE_M / 2) for v in ByHand(5).views()]
    with pytest.raises(ExtrinsicsRefused):
        calibrate_mount("camera", views)


def test_what_should_stand_still_but_moved_is_refused():
    hand = ByHand(6)
    views = hand.views()
    shift = transforms.from_xyz_yaw([0.0, 0.4, 0.0], 0.3)
    views = [
        dataclasses.replace(v, T_odom_body=shift @ v.T_odom_body) if i % 2 else v
        for i, v in enumerate(views)
    ]
    with pytest.raises(ExtrinsicsRefused):
        calibrate_mount("camera", views)


class TestVehicleFile:
    def solution(self, part="camera"):
        hand = ByHand(7, part)
        return calibrate_mount(part, hand.views())

    @pytest.mark.parametrize("part", ["camera", "tag"])
    def test_the_file_keeps_everything_else(self, root, tmp_path, part):
        solution, target = self.solution(part), tmp_path / "uav1.yaml"
        shutil.copy(root / "config" / "vehicles" / "uav1.yaml", target)
        before = target.read_text().split("\n")
        written = write_mount(target, target, solution)
        after = target.read_text().split("\n")
        changed = [b for a, b in zip(before, after) if a != b]
        assert len(before) == len(after) and len(changed) == 1 and "1 sigma" in changed[0]
        vehicle = load_vehicles(tmp_path, ["uav1"])["uav1"]
        assert vehicle == written and getattr(vehicle, part) == mount_of(vehicle, solution)
        T = vehicle.T_body_cam if part == "camera" else vehicle.T_body_tag
        assert np.allclose(T, solution.T_body_part, atol=2e-5)  # metres to 5 places, degrees to 4

    def test_a_mount_over_several_lines(self, root, tmp_path):
        text = (root / "config" / "vehicles" / "uav1.yaml").read_text()
        line = next(t for t in text.split("\n") if t.startswith("camera:"))
        source = tmp_path / "uav1.yaml"
        source.write_text(
            text.replace(line, "camera:\n  xyz_m: [0.1, 0.0, 0.0]\n  rpy_deg: [0.0, 0.0, 0.0]")
        )
        write_mount(source, source, self.solution())
        assert load_vehicles(tmp_path, ["uav1"])["uav1"].radius_m == 0.25

    def test_what_is_no_vehicle_is_refused(self, tmp_path):
        (tmp_path / "uav1.yaml").write_text("camera: 3\n")
        with pytest.raises(ConfigError):
            write_mount(tmp_path / "uav1.yaml", tmp_path / "uav1.yaml", self.solution())


@pytest.mark.slow
def test_the_command_from_a_bag(root, tmp_path, capsys):
    """Rendered tags in a bag with odometry and camera_info; the mount comes back within three of
    its own sigma."""
    rosbag = pytest.importorskip("rosbag")
    import rospy
    from nav_msgs.msg import Odometry
    from support.tag_pictures import render

    from fcsv_geometry.ros import conversions
    from fcsv_tracking.commands.calibrate_mounts import main

    hand, part = ByHand(9, noise_px=0.0), "camera"
    facing = transforms.from_xyz_rpy([1.1, 0.0, 0.0], [0.0, 0.05, np.pi + 0.1])
    vehicle = VEHICLE()
    T_world_tag = (
        facing @ dataclasses.replace(vehicle, tag=type(vehicle.tag)((0.0, 0.0, 0.0))).T_body_tag
    )
    tracker = T265(TrackerProfile(), T_BODY_T265, 9)
    with rosbag.Bag(str(tmp_path / "uav1.bag"), "w") as bag:
        for i in range(25 * 200):
            stamp_s = 1000.0 + i / 200
            message = Odometry(
                header=conversions.header(stamp_s, "uav1/odom"), child_frame_id="uav1/base_link"
            )
            T_odom_t265 = tracker.odometry(i / 200, hand.body(i / 200))[0]
            message.pose.pose = conversions.transform_to_pose(
                T_odom_t265 @ transforms.invert(T_BODY_T265)
            )
            bag.write("/uav1/odometry/body", message, message.header.stamp)
            if i % 100 == 0:
                T_cam_tag = transforms.invert(hand.body(i / 200) @ hand.T_body_part) @ T_world_tag
                picture = conversions.array_to_image(
                    render(T_cam_tag, SIZE_M, 7, CAMERA), "mono8", stamp_s, "camera"
                )
                info = conversions.info_from_camera(CAMERA, stamp_s, "camera")
                bag.write("/uav1/camera/color/image_raw", picture, rospy.Time.from_sec(stamp_s))
                bag.write("/uav1/camera/color/camera_info", info, rospy.Time.from_sec(stamp_s))
    arguments = [
        str(tmp_path / "uav1.bag"),
        "--vehicle",
        "uav1",
        "--part",
        part,
        "--vehicles-dir",
        str(root / "config" / "vehicles"),
        "-o",
        str(tmp_path / "uav1.yaml"),
    ]
    assert main([*arguments, "--tag-id", "7", "--tag-size-m", "0.16"]) == 0, capsys.readouterr()
    said = capsys.readouterr().out
    std_mm = float(said.split("1 sigma): ")[1].split(" mm")[0])
    found = load_vehicles(tmp_path, ["uav1"])["uav1"].T_body_cam
    assert np.linalg.norm((found - hand.T_body_part)[:3, 3]) < 3e-3 * std_mm < 0.03
    assert main([*arguments, "--tag-id", "8", "--tag-size-m", "0.16"]) == 2
    assert "tag 8 is in none of" in capsys.readouterr().err
    assert main(arguments) == 2 and "--tag-id" in capsys.readouterr().err

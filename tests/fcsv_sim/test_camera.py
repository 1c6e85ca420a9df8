# SPDX-License-Identifier: Apache-2.0
"""The simulated camera: noise, exposure, repeatability, and its node on a master."""

import csv
import threading
import time

import numpy as np
import pytest
from support.towns import street_renderer
from support.waiting import within

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.truth import TruthWriter

until = within(60.0)

T_BODY_CAM = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
ABOVE_FIELD = transforms.from_xyz_rpy([1, 0, 8], [0, 0, 0])


@pytest.fixture(scope="module")
def renderer():
    return street_renderer()


def shoot(renderer, seed=1, count=1, **parameters):
    camera = SimulatedCamera(renderer, T_BODY_CAM, CameraParameters(**parameters), seed)
    return camera, [camera.shoot(0.2 * i, ABOVE_FIELD, samples=1) for i in range(count)]


def test_a_seed_repeats_its_pictures_and_another_does_not(renderer):
    first, again, other = (shoot(renderer, seed, 2)[1] for seed in (1, 1, 2))
    assert all(np.array_equal(a.rgb, b.rgb) for a, b in zip(first, again))
    assert not np.array_equal(first[0].rgb, other[0].rgb)
    assert not np.array_equal(first[0].rgb, first[1].rgb)


def test_noise_is_as_large_as_it_says(renderer):
    fixed = {"mount_deg": 0.0, "blur_px": 0.0, "vignetting": 0.0, "exposure_limits": (1.0, 1.0)}
    clean = shoot(renderer, read_noise=0.0, shot_noise=0.0, **fixed)[1][0].rgb / 255.0
    noisy = shoot(renderer, read_noise=0.004, shot_noise=0.011, **fixed)[1][0].rgb / 255.0
    inside = (clean > 0.05) & (clean < 0.9)
    # and rounding, twice
    expected = np.sqrt(0.004**2 + 0.011**2 * clean[inside].mean() + 2 / 12 / 255**2)
    assert abs(np.std((noisy - clean)[inside]) / expected - 1) < 0.05
    assert abs(np.mean((noisy - clean)[inside])) < 1e-3


def test_exposure_settles_with_a_lag_and_keeps_its_limits(renderer):
    camera, shots = shoot(renderer, count=14, brightness=0.4)
    means = [s.rgb.mean() / 255 for s in shots]
    assert abs(means[-1] - 0.4) < 0.02
    # the first picture sets the exposure at once, later ones follow slowly: no jump back and forth
    assert np.abs(np.diff(means[2:])).max() < 0.05
    assert shoot(renderer, count=3, brightness=0.9, exposure_limits=(0.5, 1.2))[0].exposure == 1.2
    assert shoot(renderer, count=3, brightness=0.1, exposure_limits=(0.5, 1.2))[0].exposure == 0.5


def test_mount_adds_only_a_hundredth_of_a_degree(renderer):
    camera = SimulatedCamera(renderer, T_BODY_CAM, CameraParameters(), 3)
    angles = []
    for i in range(12):
        T_world_cam = camera.shoot(0.2 * i, ABOVE_FIELD).T_world_cam
        angles.append(np.degrees(transforms.rotation_angle(T_world_cam, ABOVE_FIELD @ T_BODY_CAM)))
        assert np.allclose(T_world_cam[:3, 3], ABOVE_FIELD[:3, 3])
    assert 0.005 < np.mean(angles) < 0.08  # three axes of 0.02 deg: 0.032 on average


def test_parameters_out_of_range_are_refused():
    with pytest.raises(ValueError, match="read_noise"):
        CameraParameters(read_noise=-1.0)
    with pytest.raises(ValueError, match="exposure_limits"):
        CameraParameters(exposure_limits=(2.0, 1.0))


class Hovering:
    """Two vehicles in a column, their truth written at 100 Hz until closed."""

    def __init__(self, folder):
        self._writers = {n: TruthWriter(folder, n) for n in ("uav1", "uav2")}
        self.poses = {
            "uav1": transforms.from_xyz_yaw([0, 0, 8], 0.0),
            "uav2": transforms.from_xyz_yaw([-3.5, 0, 8], 0),
        }
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._over.wait(0.01):
            for name, writer in self._writers.items():
                writer.write(time.time(), self.poses[name], np.zeros(3))

    def close(self):
        self._over.set()
        self._thread.join()


@pytest.mark.ros
def test_node_publishes_pictures_infos_and_truth(start_node, root, tmp_path):
    import cv2
    import rospy
    from sensor_msgs.msg import CameraInfo, Image

    from fcsv_geometry.ros import conversions
    from fcsv_tracking.tags import TagDetector

    hovering = Hovering(tmp_path)
    images, infos, depths, depth_infos = [], [], [], []
    aligned = "/uav2/camera/aligned_depth_to_color/"
    subscribers = [
        rospy.Subscriber(aligned + "image_raw", Image, depths.append),
        rospy.Subscriber(aligned + "camera_info", CameraInfo, depth_infos.append),
        rospy.Subscriber("/uav2/camera/color/image_raw", Image, images.append),
        rospy.Subscriber("/uav2/camera/color/camera_info", CameraInfo, infos.append),
    ]
    folder = str(root / "config" / "vehicles")
    params = {
        "vehicle": "uav2",
        "vehicles": ["uav1", "uav2"],
        "vehicles_dir": folder,
        "sim_dir": str(tmp_path),
        "seed": 1,
        "rate_hz": 4.0,
        "near": True,
    }
    try:
        start_node("fcsv_sim", "camera", ns="uav2", params=params)
        until(lambda: len(images) >= 6, what="six pictures")
    finally:
        hovering.close()
        for subscriber in subscribers:
            subscriber.unregister()
    stamps = [m.header.stamp for m in images]
    assert {s.to_nsec() for s in stamps} & {m.header.stamp.to_nsec() for m in infos}
    assert (
        images[0].header.frame_id == infos[0].header.frame_id == "uav2/camera_color_optical_frame"
    )
    assert (images[0].encoding, images[0].width, images[0].height) == ("rgb8", 640, 480)
    assert conversions.camera_from_info(infos[0]) == CameraParameters().model
    # depth of some of the pictures, in their pixels, as realsense2_camera gives it: mm; uav1's back
    # is 3.2 m ahead
    depth_stamps = [m.header.stamp.to_nsec() for m in depths if m.header.stamp >= stamps[0]]
    assert set(depth_stamps) <= {s.to_nsec() for s in stamps} and len(depth_stamps) >= 2
    assert np.diff(depth_stamps).min() > 0.37e9
    assert (depths[0].encoding, depths[0].width, depths[0].height) == ("16UC1", 640, 480)
    assert conversions.camera_from_info(depth_infos[0]) == CameraParameters().model
    millimetres = conversions.image_to_array(depths[-1], "16UC1")
    assert 1000 < np.median(millimetres[millimetres > 0]) < 10000
    gray = cv2.cvtColor(conversions.image_to_array(images[-1], "bgr8"), cv2.COLOR_BGR2GRAY)
    assert [d.id for d in TagDetector({1: 0.16}).detect(gray, CameraParameters().model)] == [1]
    # periods are skipped when the machine is busy, never queued: no two pictures closer than most
    # of a period
    gaps = np.diff([s.to_sec() for s in stamps])
    assert gaps.min() > 0.1
    with open(tmp_path / "truth_cameras_uav2.csv", newline="") as notes:
        rows = {r["stamp_s"]: r for r in csv.DictReader(notes)}
    T_world_cam = hovering.poses["uav2"] @ load_vehicles(folder, ["uav2"])["uav2"].T_body_cam
    for stamp in stamps:
        row = rows[f"{stamp.secs}.{stamp.nsecs:09d}"]
        T = transforms.from_xyz_quaternion(
            [float(row[k]) for k in "xyz"], [float(row[k]) for k in ("qx", "qy", "qz", "qw")]
        )
        assert row["vehicle"] == "uav2" and np.allclose(T[:3, 3], T_world_cam[:3, 3], atol=1e-6)
        assert transforms.rotation_angle(T, T_world_cam) < np.radians(0.2)

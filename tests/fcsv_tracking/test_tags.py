# SPDX-License-Identifier: Apache-2.0
"""Tag detection: the detector's pixel convention, poses, and photographs of printed tags."""

import re
import threading

import cv2
import numpy as np
import pytest
import yaml
from support.tag_pictures import CAMERA, pose, render

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_tracking.errors import TagError
from fcsv_tracking.tags import TagDetector, corner_points, planar_poses


@pytest.mark.parametrize(
    "distance_m, yaw_deg, roll_deg", [(2.0, 20, 5), (3.5, 0, 0), (3.5, -30, 10), (4.0, 25, -7)]
)
def test_pose_and_corners_are_unbiased(distance_m, yaw_deg, roll_deg):
    detector = TagDetector({1: 0.16})
    errors = []
    for shift in np.linspace(0, 0.01, 12):  # through a few subpixel phases
        T = pose(distance_m, yaw_deg, 0.1 + shift, -0.05 + 0.7 * shift, roll_deg)
        (seen,) = detector.detect(render(T), CAMERA)
        truth = CAMERA.project(transforms.apply(T, corner_points(0.16)))
        errors.append(seen.corners_px - truth)
        assert seen.id == 1 and np.abs(seen.corners_px - truth).max() < 0.5
        assert np.linalg.norm(seen.T_cam_tag[:3, 3] - T[:3, 3]) < 0.03 * distance_m
    # a wrong pixel convention would show as a common half pixel; an exactly upright tag leaves 0.07
    # px
    assert np.abs(np.mean(errors, axis=(0, 1))).max() < 0.12


def test_both_planar_solutions_are_offered():
    T = pose(3.5, 15)
    p = transforms.apply(T, corner_points(0.16))
    solutions = planar_poses(p[:, :2] / p[:, 2:], 0.16)
    assert len(solutions) == 2 and np.allclose(solutions[0][0], T, atol=1e-4)
    assert solutions[1][1] > solutions[0][1]


def test_other_ids_sizes_and_families_are_not_there():
    picture = render(pose(3.0))
    assert TagDetector({2: 0.16}).detect(picture, CAMERA) == []
    # a wrong size is a wrong distance, nothing else
    (twice,) = TagDetector({1: 0.32}).detect(picture, CAMERA)
    assert twice.T_cam_tag[2, 3] == pytest.approx(6.0, rel=0.02)


def test_mirrored_or_hidden_tags_are_not_found():
    picture = render(pose(3.0))
    assert TagDetector({1: 0.16}).detect(picture[:, ::-1].copy(), CAMERA) == []
    picture[:, 330:] = 120
    assert TagDetector({1: 0.16}).detect(picture, CAMERA) == []


@pytest.mark.parametrize(
    "distance_m, yaw_deg, roll_deg", [(2.0, 20, 5), (3.5, -30, 10), (4.0, 25, -7)]
)
def test_sought_in_a_smaller_picture_and_looked_at_again_corners_are_the_same(
    distance_m, yaw_deg, roll_deg
):
    picture = render(pose(distance_m, yaw_deg, roll_deg=roll_deg))
    whole, shrunk, sharp = (
        TagDetector({1: 0.16}, *how).detect(picture, CAMERA)[0].corners_px
        for how in ((), (1.5,), (1.5, True))
    )
    assert np.abs(sharp - whole).max() < 0.01 and not np.allclose(shrunk, whole, atol=0.01)


def test_a_tag_at_the_edge_of_the_picture_keeps_what_was_found():
    picture = render(pose(1.0, x=-0.43))
    (found,) = TagDetector({1: 0.16}, 1.5, True).detect(picture, CAMERA)
    assert found.corners_px[:, 0].min() < 20


def test_wrong_pictures_are_refused():
    with pytest.raises(TagError, match="HxW uint8"):
        TagDetector({1: 0.16}).detect(np.zeros((480, 640, 3), np.uint8), CAMERA)


class TestPhotographs:
    """Printed tags, 65 mm, turned by known angles (see the data's README)."""

    def load(self, shared_data, key):
        info = yaml.safe_load((shared_data / "apriltags" / "test_info.yaml").read_text())[key]
        K = np.array(info["K"]).reshape(3, 3)
        camera = PinholeCamera(info["width"], info["height"], K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        return info, camera

    def test_angles(self, shared_data):
        info, camera = self.load(shared_data, "rotation_test")
        detector = TagDetector(dict.fromkeys(range(587), info["tag_size"]))
        seen = {}
        for path in sorted((shared_data / "apriltags").glob("test_image_rotation_*.png")):
            angle_deg = int(re.search(r"_(-?\d+)\.png", path.name).group(1))
            (tag,) = detector.detect(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), camera)
            normal = tag.T_cam_tag[:3, 2]
            seen[angle_deg] = np.degrees(np.arctan2(normal[0], normal[2]))
        assert len(seen) == 7
        sign = np.sign(sum(a * s for a, s in seen.items()))
        errors = {a: abs(sign * s - a) for a, s in seen.items()}
        assert max(errors.values()) <= 3.5, errors

    def test_several_at_once(self, shared_data):
        info, camera = self.load(shared_data, "multiple_tags_test")
        detector = TagDetector(dict.fromkeys(range(587), info["tag_size"]))
        for path in sorted((shared_data / "apriltags").glob("test_image_multiple_*.png")):
            ids = [
                t.id for t in detector.detect(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), camera)
            ]
            assert len(ids) >= 4 and len(set(ids)) == len(ids), (path.name, ids)


def test_others_run_while_it_looks():
    """A node's readings and commands go on meanwhile: a large picture takes tens of times as long
    as one of them."""
    camera = PinholeCamera(1920, 1080, 5000.0, 5000.0, 960.0, 540.0)
    noise = np.random.default_rng(0).integers(0, 256, (1080, 1920)).astype(np.uint8)
    detector, turns, done = TagDetector({1: 0.08}), [0], threading.Event()

    def turn():
        while not done.wait(0.001):
            turns[0] += 1

    other = threading.Thread(target=turn)
    other.start()
    begun = turns[0]
    detector.detect(noise, camera)
    during = turns[0] - begun
    done.set()
    other.join()
    assert during >= 3


def test_many_detectors_come_and_go():
    gray = np.zeros((48, 64), np.uint8)
    for _ in range(20):
        assert (
            TagDetector({1: 0.08}).detect(gray, PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5)) == []
        )

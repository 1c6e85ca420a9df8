# SPDX-License-Identifier: Apache-2.0
"""The near field in a map: joined with distant configurations, from a session's bags, by the
command."""

import sys

import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose
from support.sessions import T0, T_HOME_CAM, write_session

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo import pipeline
from fcsv_stereo.cli import main
from fcsv_stereo.errors import InputError
from fcsv_stereo.map_files.output import read_ply
from fcsv_stereo.model import Cloud, ImageEntry, MapResult, Reference
from fcsv_stereo.model.kinds import DepthKind
from fcsv_stereo.near import NEAR_BASELINE, DepthFrame, DepthSensor, NearVolume, join, with_near
from fcsv_stereo.report.near import near_field
from fcsv_stereo.report.sections import ReportData
from fcsv_stereo.sessions.read import read_session
from fcsv_stereo.thesis import ThesisOptions

GROUND_M = -1.5  # home's z
POSE = camera_pose([0, 0, 0])


def ground_depth(T_home_cam, camera=CAMERA, most_m=9.0):
    """(H,W) uint16 mm of level ground 1.5 m below home as a depth camera sees it, nothing beyond
    its range."""
    rays = camera.rays() @ T_home_cam[:3, :3].T
    with np.errstate(divide="ignore"):
        z = (GROUND_M - T_home_cam[2, 3]) / rays[..., 2]
    return np.where((z > 0) & (z < most_m), 1000.0 * z, 0.0).astype(np.uint16)


def ground(frames=4, sigma_m=0.01):
    volume, C = NearVolume(DepthSensor()), np.diag([sigma_m**2] * 3 + [1e-4**2] * 3)
    for i in range(frames):
        T = camera_pose([0, 0.1 * i, 0])
        volume.integrate(DepthFrame.of_millimetres("uav1", float(i), ground_depth(T), CAMERA, T, C))
    return volume.surface()


def far(depth_m, sigma_m):
    """A map whose reference camera stands in home; ``depth_m`` and ``sigma_m`` (H,W) or numbers."""
    shape = (CAMERA.height, CAMERA.width)
    depth, sigma = (np.broadcast_to(np.float32(x), shape).copy() for x in (depth_m, sigma_m))
    image = np.full((*shape, 3), (200, 10, 30), np.uint8)
    reference = Reference("uav1/0", 0.0, "uav1", image, CAMERA, POSE)
    known = np.isfinite(depth)
    points = transforms.apply(POSE, (CAMERA.rays() * depth[..., None])[known]).astype(np.float32)
    cloud = Cloud(points, image[known], sigma[known], np.zeros(len(points), np.uint8))
    images = [ImageEntry("uav1/0", "uav1", 0.0, POSE, POSE)]
    return MapResult("joint", reference, images, [], depth, sigma, cloud, {"match": 1.0})


def test_what_the_map_does_not_see_comes_from_the_near_field():
    result = far(np.nan, np.nan)
    joined = join(result, ground(), {"uav1": 4}, [result.reference])
    stands = np.isfinite(joined.depth)
    true = ground_depth(POSE) / 1000.0
    assert joined.near.new == joined.near.pixels == stands.sum() > 5000
    assert np.abs(joined.depth - true)[stands & (true > 0)].max() < 0.25
    assert (joined.kind[stands] == DepthKind.NEAR).all() and (
        joined.kind[~stands] != DepthKind.NEAR
    ).all()
    assert (joined.cloud.baseline_index == NEAR_BASELINE).all() and joined.near.step is None
    assert np.abs(joined.cloud.points_home_m[:, 2] - GROUND_M).max() < 0.1
    shown = (joined.cloud.colors == (200, 10, 30)).all(axis=1)
    assert shown.mean() > 0.7 and (joined.cloud.colors[~shown] == 128).all()


def test_the_surer_stands_and_nothing_is_twice():
    true = ground_depth(POSE) / 1000.0
    seen = np.where(true > 0, true, np.nan)
    unsure, sure = (
        join(far(seen, 1.0), ground(), {"uav1": 4}),
        join(far(seen, 1e-4), ground(), {"uav1": 4}),
    )
    both = unsure.near.shared
    assert both > 5000 and unsure.near.pixels == both and sure.near.pixels < 0.1 * both
    left = (unsure.cloud.baseline_index != NEAR_BASELINE).sum()
    assert left < 0.1 * np.isfinite(seen).sum()
    # of the near field only what the reference camera does not see, and what it sees less well, is
    # added
    assert (sure.cloud.baseline_index == NEAR_BASELINE).sum() < 0.5 * (
        unsure.cloud.baseline_index == NEAR_BASELINE
    ).sum()
    assert (sure.cloud.baseline_index != NEAR_BASELINE).sum() > 0.9 * np.isfinite(seen).sum()


@pytest.mark.parametrize("scale", [1.0, 1.1, 0.9])
def test_the_seam_says_by_how_much_they_differ(scale):
    true = ground_depth(POSE) / 1000.0
    seam = join(far(np.where(true > 0, scale * true, np.nan), 0.01), ground(), {"uav1": 4}).near
    assert seam.step == pytest.approx(scale - 1.0, abs=0.01) and seam.apart == pytest.approx(
        abs(scale - 1.0), abs=0.01
    )
    assert 3.0 < seam.from_m < seam.to_m < 9.5
    assert seam.agree > 0.9 if scale == 1.0 else seam.agree < 0.6


def test_what_only_noise_brought_into_range_is_not_there():
    """A sensor that ends at 10 m tells of a wall at 9.6 m only what is measured too near; at 9 m it
    is believed."""
    camera = PinholeCamera(32, 24, 60.0, 60.0, 15.5, 11.5)
    found = {}
    for wall_m in (9.0, 9.6):
        volume = NearVolume(DepthSensor())
        for i in range(4):
            depth = np.full((24, 32), 1000.0 * wall_m, np.uint16)
            volume.integrate(
                DepthFrame.of_millimetres(
                    "uav1", float(i), depth, camera, POSE, np.diag([1e-4] * 6)
                )
            )
        found[wall_m] = len(volume.surface())
    assert found[9.0] > 1000 and found[9.6] == 0


def test_the_far_map_hides_nothing_that_stands_before_or_behind_it():
    """Beyond the map's depth the near field may see what the reference camera does not; before it,
    the surer stands."""
    # surer than all: the ground beyond 4 m is behind it, the ground before contradicts it
    wall = far(4.0, 1e-4)
    cloud = join(wall, ground(), {"uav1": 4}).cloud
    z = cloud.points_home_m[cloud.baseline_index == NEAR_BASELINE][:, 0]
    assert (z > 4.0).mean() > 0.9


def test_a_map_without_a_near_field_stays_as_it_is():
    result = far(5.0, 0.1)
    joined = join(result, NearVolume().surface(), {})
    assert np.array_equal(joined.depth, result.depth) and np.array_equal(joined.kind, result.kind)
    assert len(joined.cloud) == len(result.cloud) and joined.near.points == 0


def test_the_report_says_what_it_brought_and_warns_of_a_seam():
    result = far(12.0, 0.1)
    heading, table, *said = near_field(
        ReportData(join(result, ground(), {"uav1": 4, "uav2": 2}), [], [])
    )
    assert (
        "differ by +" in heading.text
        and ("frames summed", "uav1: 4, uav2: 2") in table.rows
        and said
    )
    assert near_field(ReportData(result, [], [])) == []


def mapped(session, out, **options):
    return pipeline.run(
        pipeline.MapRequest(session, out, "thesis", ThesisOptions(matcher="sgbm"), **options)
    )


def test_a_session_that_holds_depth_is_mapped_with_it(tmp_path):
    session = write_session(
        tmp_path / "session", depth=ground_depth, covariance=np.diag([1e-4] * 3 + [1e-6] * 3)
    )
    document, out = mapped(session, tmp_path / "map"), tmp_path / "map"
    assert (
        document["near"]["frames"] == {"uav1": 3, "uav2": 3} and document["timing_s"]["near"] > 0.0
    )
    cloud, kind = read_ply(out / "map.ply"), np.load(out / "kind.npy")
    of_near = cloud.baseline_index == NEAR_BASELINE
    assert (
        of_near.sum() == document["near"]["points"] > 1000
        and (kind == DepthKind.NEAR).sum() == document["near"]["pixels"]
    )
    assert np.abs(np.median(cloud.points_home_m[of_near, 2]) - GROUND_M) < 0.03
    assert (
        document["kinds"]["near"] > 0.05 and 'id="near-field"' in (out / "report.html").read_text()
    )
    assert any("3 depth frames of uav1 have no odometry" in w for w in document["warnings"])


def test_without_depth_or_with_no_near_a_session_is_mapped_as_ever(tmp_path):
    plain = mapped(write_session(tmp_path / "plain"), tmp_path / "a")
    assert "near" not in plain and "near" not in plain["kinds"]
    session = write_session(tmp_path / "session", depth=ground_depth)
    assert (
        main(
            [
                str(session),
                "-o",
                str(tmp_path / "b"),
                "--method",
                "thesis",
                "--matcher",
                "sgbm",
                "--no-near",
            ]
        )
        == 0
    )
    for name in ("map.ply", "depth.npy", "kind.npy"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_another_vehicle_is_not_of_the_map():
    depth = np.full((CAMERA.height, CAMERA.width), 5.0, np.float32)
    depth[100:140, 140:180] = 2.0
    frame = DepthFrame("uav1", 0.0, depth, CAMERA, POSE, np.eye(6))
    left = frame.without([np.array([2.0, 0.0, 0.0])], 0.6).depth_m
    assert not np.isfinite(left[100:140, 140:180]).any() and (left[:60] == 5.0).all()
    assert (
        frame.without([np.array([-9.0, 0.0, 0.0])], 0.6) is frame
        and frame.without([], 0.6) is frame
    )


def test_frames_say_where_the_other_vehicle_is(tmp_path):
    """uav2 hovers 0.8 m beside uav1: what uav1 sees there is left out of its frames."""
    near = read_session(write_session(tmp_path / "session", depth=ground_depth)).near
    places = near._others("uav1", T0 + 0.5)
    assert (
        np.allclose(places, [T_HOME_CAM["uav2"][:3, 3]], atol=1e-6)
        and near._others("uav1", T0 + 9.0) == []
    )


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda d: d.astype(np.float32) / 1000, "encoding '32FC1' is not depth in mm"),
        (lambda d: d[:100], "is 320x100, its camera 320x240"),
    ],
)
def test_depth_that_is_none_is_refused(tmp_path, change, words):
    session = write_session(tmp_path / "session", depth=lambda T: change(ground_depth(T)))
    with pytest.raises(InputError, match=words):
        mapped(session, tmp_path / "map")
    assert not (tmp_path / "map").exists()


def test_a_vehicle_whose_covariance_is_not_known_has_that_of_a_flight(tmp_path):
    frame = next(
        read_session(write_session(tmp_path / "session", depth=ground_depth)).near.frames()
    )
    assert np.sqrt(frame.covariance[0, 0]) == pytest.approx(0.15, abs=0.02)


def test_without_open3d_the_map_says_that_it_has_no_near_field(monkeypatch, tmp_path):
    given = read_session(write_session(tmp_path / "session", depth=ground_depth))
    monkeypatch.setitem(sys.modules, "open3d", None)
    result = with_near(far(5.0, 0.1), given)
    assert result.near is None and result.warnings == [
        "no near field: open3d is not installed: pip install open3d"
    ]


def test_frames_of_nothing_are_a_warning(tmp_path):
    given = read_session(
        write_session(tmp_path / "session", depth=lambda T: np.zeros_like(ground_depth(T)))
    )
    result = with_near(far(5.0, 0.1), given)
    assert result.near is None and any("no near field" in w for w in result.warnings)

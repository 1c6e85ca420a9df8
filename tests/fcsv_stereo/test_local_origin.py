# SPDX-License-Identifier: Apache-2.0
"""Models far from their world's origin: the same map, in full coordinates wherever a format has
them."""

import doctest
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.scenes import given

from fcsv_geometry import transforms
from fcsv_stereo import pipeline
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.map_files import output
from fcsv_stereo.model import Reference
from fcsv_stereo.posed import local_origin
from fcsv_stereo.posed.local_origin import moved, with_local_origin
from fcsv_stereo.products import clouds, write_products
from fcsv_stereo.report import figures
from fcsv_stereo.thesis import ThesisOptions, map_thesis

UTM_M = np.array([389012.0, 5819034.0, 41.0])


def at(scene, place_m):
    pictures = {
        id(p): replace(p, T_home_cam=moved(p.T_home_cam, place_m))
        for c in scene.configurations
        for p in (*c.references, *c.others)
    }
    configurations = [
        replace(
            c,
            references=[pictures[id(p)] for p in c.references],
            others=[pictures[id(p)] for p in c.others],
        )
        for c in scene.configurations
    ]
    return replace(scene, configurations=configurations)


@pytest.fixture(scope="module")
def scene():
    return given(((0, -1.2, 0), "horizontal"), ((0, 0, 0.8), "vertical"), kind="photographs")


def mapped(scene):
    options = ThesisOptions(threshold=ErrorThreshold(5.0, False))
    return replace(map_thesis(scene, options, lambda *_: None), origin_m=scene.origin_m)


@pytest.fixture(scope="module")
def results(scene):
    """At home, and in UTM."""
    return mapped(scene), mapped(with_local_origin(at(scene, UTM_M)))


def test_examples():
    assert doctest.testmod(local_origin).failed == 0 and doctest.testmod(clouds).failed == 0


def test_only_far_models_are_shifted(scene):
    assert with_local_origin(scene) is scene
    far = with_local_origin(at(scene, UTM_M))
    assert (
        np.all(far.origin_m == np.round(far.origin_m)) and np.abs(far.origin_m - UTM_M).max() < 10.0
    )
    assert np.allclose(
        far.configurations[0].others[0].T_home_cam[:3, 3] + far.origin_m,
        scene.configurations[0].others[0].T_home_cam[:3, 3] + UTM_M,
        atol=1e-8,
    )


def test_the_map_is_the_same(results, wrong_input):
    near, far = results
    both = np.isfinite(near.depth) & np.isfinite(far.depth)
    assert both.sum() > 0.999 * np.isfinite(near.depth).sum() > 10000
    assert np.abs(far.depth[both] / near.depth[both] - 1.0).max() < 1e-4
    wrong_input("COLMAP models", "a model in UTM", "read right")


def test_every_file_has_full_coordinates_or_says_the_shift(scene, results, tmp_path):
    import laspy
    import tifffile

    near, far = results
    expected = near.cloud.points_home_m.astype(float) + UTM_M
    write_products(
        ["pcd", "laz", "orthophoto", "colmap", "pairs"],
        far,
        with_local_origin(at(scene, UTM_M)),
        tmp_path,
    )
    output.write_arrays(far, tmp_path)
    path = tmp_path / "map.ply"
    ply = output.read_ply(path).points_home_m.astype(float) + output.read_ply_origin(path)
    las = laspy.read(tmp_path / "map.laz")
    assert b"# origin_m 3890" in (tmp_path / "map.pcd").read_bytes()[:300]
    for points, atol in ((ply, 2e-3), (np.column_stack([las.x, las.y, las.z]), 2e-3)):
        for percent in (1, 50, 99):  # the products' points are merged ones
            a, b = (np.percentile(p, percent, axis=0) for p in (points, expected))
            assert np.allclose(a, b, atol=0.01)
        assert np.abs(points.mean(axis=0) - expected.mean(axis=0)).max() < 10 * atol
    a, _, _, e, x0, y0 = (float(v) for v in (tmp_path / "orthophoto.pgw").read_text().split())
    with tifffile.TiffFile(tmp_path / "height.tif") as file:
        height, tie = file.asarray(), file.pages[0].geotiff_tags["ModelTiepoint"]
    assert tie[3:5] == [pytest.approx(x0 - a / 2), pytest.approx(y0 - e / 2)]
    low, high = np.percentile(expected, [0.1, 99.9], axis=0)
    assert low[0] - a < x0 < low[0] + 2 * a and high[1] - 2 * a < y0 < high[1] + a
    assert low[2] - 1 < np.nanmedian(height) < high[2] + 1
    points = np.loadtxt(tmp_path / "colmap" / "points3D.txt", usecols=(1, 2, 3))
    assert np.allclose(points.mean(axis=0), expected.mean(axis=0), atol=0.05)
    back = pipeline.load(tmp_path / "colmap")
    again = moved(back.configurations[0].references[0].T_home_cam, back.origin_m)
    assert back.origin_m.any() and np.allclose(
        again, moved(far.reference.T_home_cam, far.origin_m), atol=1e-7
    )
    for path in (tmp_path / "pairs").rglob("calibration.yaml"):
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        T_home_rect = storage.getNode("T_home_rect").mat()
        assert np.abs(T_home_rect[:3, 3] - UTM_M).max() < 2.0


def test_report_json_has_the_models_world(results):
    near, far = results
    document = json.loads(json.dumps(output.report_document(far)))
    assert document["origin_m"] == far.origin_m.tolist()
    for a, b in zip(output.report_document(near)["images"], document["images"]):
        for key in ("T_home_cam", "prior_T_home_cam"):
            assert np.allclose(moved(np.array(a[key]), UTM_M), b[key], atol=1e-8)
    assert "origin_m" not in output.report_document(near)


@pytest.mark.parametrize("reach", [1e-3, 0.5, 7.0, 60.0, 900.0, 6.4e6])
def test_rings_are_few(reach):
    figure, axes = figures.plt.subplots()
    figures._rings(axes, reach, 60)
    assert 2 <= len(axes.lines) <= 9
    figures.plt.close(figure)


def looking(rpy_deg, optical=True):
    T = transforms.from_xyz_rpy([3.0, 4.0, 50.0], np.radians(rpy_deg))
    return T @ transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3)) if optical else T


@pytest.mark.parametrize(
    "given, T_home_cam, level, down",
    [
        ("ahead", looking([0, 0, 30]), True, False),
        ("obliquely down", looking([0, 40, 200]), True, False),
        ("straight down", looking([0, 90, 0]), True, True),
        ("straight down, heading west", looking([0, 89, 90]), True, True),
        ("down, stored on its side", looking([90, 80, 0]), True, True),
        ("a world on its side", looking([90, 0, 0]), False, False),
        ("COLMAP's first camera as the world", np.eye(4), False, False),
        (
            "a world with y down, turned",
            looking([0, 30, 0], optical=False) @ np.diag([1.0, 1, 1, 1]),
            False,
            False,
        ),
        ("upside down: z is down", looking([180, 0, 0]), False, False),
    ],
)
def test_where_homes_z_may_point_up(results, given, T_home_cam, level, down, tmp_path, wrong_input):
    near, _ = results
    reference = replace(near.reference, T_home_cam=T_home_cam)
    assert isinstance(reference, Reference) and (reference.is_level, reference.looks_down) == (
        level,
        down,
    )
    turn = T_home_cam @ transforms.invert(near.reference.T_home_cam)
    points = transforms.apply(turn, near.cloud.points_home_m.astype(float)).astype(np.float32)
    result = replace(
        near,
        reference=reference,
        cloud=replace(near.cloud, points_home_m=points),
        warnings=[],
        unseen=[],
    )
    write_products(["orthophoto"], result, None, tmp_path)
    assert any("does not point up" in w for w in result.warnings) != level
    assert any("points at the camera" in w for w in result.unseen) == down
    if given == "straight down":
        wrong_input("Poses and maps", "pictures that look straight down", "read right")
    figure = figures.from_above(result, False)
    (axes,) = figure.axes
    shown = axes.collections[0].get_offsets()
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    inside = (shown[:, 0] > x0) & (shown[:, 0] < x1) & (shown[:, 1] > y0) & (shown[:, 1] < y1)
    assert inside.mean() > 0.9
    figures.plt.close(figure)

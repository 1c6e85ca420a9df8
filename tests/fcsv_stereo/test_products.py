# SPDX-License-Identifier: Apache-2.0
"""Products: read back by other readers, they hold what the map holds."""

import doctest
import resource
from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.scenes import CAMERA, camera_pose, given, true_depth

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import ConfigError
from fcsv_stereo import pipeline
from fcsv_stereo.equations import ErrorThreshold, depth_error
from fcsv_stereo.errors import InputError, MatchingError, OutputError
from fcsv_stereo.map_files import output
from fcsv_stereo.model import Cloud, MapInput, Reference, concatenate
from fcsv_stereo.posed import colmap
from fcsv_stereo.products import (
    ALL,
    FILES,
    PRODUCTS,
    names,
    parse_products,
    pictures,
    write_products,
)
from fcsv_stereo.products.clouds import write_laz, write_pcd
from fcsv_stereo.products.from_above import rasterize, write_from_above
from fcsv_stereo.products.points import merge_duplicates
from fcsv_stereo.rectify import bouguet
from fcsv_stereo.thesis import ThesisOptions, map_thesis

TWO = (((0, -0.8, 0), "horizontal"), ((0, 0, 0.8), "vertical"))


@pytest.fixture(scope="module")
def scene():
    return given(*TWO)


@pytest.fixture(scope="module")
def result(scene):
    return map_thesis(scene, ThesisOptions(threshold=ErrorThreshold(5.0, False)), lambda *_: None)


def cloud_of(points, sigma, colors=None, baseline=None):
    n = len(points)
    colors = np.full((n, 3), 100, np.uint8) if colors is None else np.asarray(colors, np.uint8)
    baseline = np.zeros(n, np.uint8) if baseline is None else np.asarray(baseline, np.uint8)
    return Cloud(np.asarray(points, np.float32), colors, np.asarray(sigma, np.float32), baseline)


@pytest.mark.parametrize("module", [names, pictures])
def test_names(module):
    done = doctest.testmod(module)
    assert done.attempted and not done.failed


def test_unknown_products_are_named():
    assert parse_products("all") == list(ALL) and set(PRODUCTS) - set(ALL) == {"ground"}
    with pytest.raises(InputError, match="'obj' is not one of pcd, laz"):
        parse_products("laz,obj")


def test_pcd_as_open3d_reads_it(result, tmp_path):
    import open3d as o3d

    write_pcd(result.cloud, tmp_path / "map.pcd")
    read = o3d.t.io.read_point_cloud(str(tmp_path / "map.pcd"))
    assert np.array_equal(read.point.positions.numpy(), result.cloud.points_home_m)
    assert np.array_equal(read.point.colors.numpy(), result.cloud.colors)
    assert np.array_equal(read.point["sigma"].numpy().ravel(), result.cloud.sigma_m)


def test_laz_with_sigma(result, tmp_path):
    import laspy

    write_laz(result.cloud, tmp_path / "map.laz")
    read = laspy.read(str(tmp_path / "map.laz"))
    assert np.abs(read.xyz - result.cloud.points_home_m).max() < 0.00051  # stored to a millimetre
    assert np.array_equal(read["sigma"], result.cloud.sigma_m)
    assert np.array_equal(read["baseline"], result.cloud.baseline_index)
    assert np.array_equal(
        np.stack([read.red, read.green, read.blue], 1) // 257, result.cloud.colors
    )
    assert (tmp_path / "map.laz").stat().st_size < 0.7 * len(read.points) * 35  # it is compressed


def test_a_laz_that_the_disk_does_not_take_is_said_and_not_there(tmp_path):
    """Files may not become larger than 50 kB here; the cloud is larger."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    points = np.random.default_rng(0).normal(size=(400_000, 3)).astype(np.float32)
    rest = np.zeros((len(points), 3), np.uint8), points[:, 0] ** 2, np.ones(len(points), np.uint8)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        with pytest.raises(OSError, match="map.laz: .*is the disk full"):
            write_laz(Cloud(points, *rest), tmp_path / "map.laz")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_duplicates_become_their_weighted_mean(result):
    reference = replace(result.reference, T_home_cam=camera_pose([0, 0, 0]))
    ray = np.array([1.0, 0.5 / CAMERA.fx, 0.5 / CAMERA.fx])  # of a pixel's middle
    # two of one pixel that agree (20 and 21 m), one behind them that does not, one beside, two
    # behind the camera
    points = [20 * ray, 21 * ray, 40 * ray, 20 * ray + [0, 1, 0], -5 * ray, -5 * ray]
    cloud = cloud_of(points, [1.0, 2.0, 1.0, 1.0, 1.0, 1.0], baseline=[0, 1, 2, 3, 4, 5])
    merged = merge_duplicates(cloud, reference)
    assert sorted(merged.baseline_index) == [0, 2, 3, 4, 5]  # the two behind the camera stay two
    at = int(np.flatnonzero(merged.baseline_index == 0)[0])
    assert np.allclose(merged.points_home_m[at], 20.2 * ray, atol=1e-4)  # weights 1 and 1/4
    assert merged.sigma_m[at] == pytest.approx(1.0 / np.sqrt(1.25))
    assert np.all(np.delete(merged.sigma_m, at) == 1.0)


def test_one_map_has_no_duplicates_and_the_same_twice_is_the_same(result):
    once = merge_duplicates(result.cloud, result.reference)
    assert len(once) == len(result.cloud)
    twice = merge_duplicates(concatenate([result.cloud, result.cloud]), result.reference)
    assert len(twice) == len(result.cloud)
    assert np.allclose(
        np.sort(twice.points_home_m[:, 0]), np.sort(result.cloud.points_home_m[:, 0]), atol=1e-4
    )


def test_many_maps_of_a_place_do_not_pretend_to_be_exact(result):
    clouds = [result.cloud] * 30
    merged = merge_duplicates(concatenate(clouds), result.reference)
    assert merged.sigma_m.min() >= 0.499 * result.cloud.sigma_m.min()


def test_from_above_takes_the_highest_and_lies_where_it_says(tmp_path):
    import tifffile

    x, y = np.meshgrid(np.arange(0.025, 30, 0.05), np.arange(-7.975, 8, 0.05))
    z = np.where((x > 10) & (x < 12) & (y > 2) & (y < 5), 3.0, -1.0)
    top = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    below = top[::7] - [0, 0, 1.5]
    colors = np.where(top[:, 2:] > 0, [[200, 0, 0]], [[0, 90, 0]])
    cloud = cloud_of(
        np.vstack([top, below]), np.ones(len(top) + len(below)), np.vstack([colors, colors[::7]])
    )
    write_from_above(cloud, tmp_path)
    a, d, b, e, cx, cy = (float(v) for v in (tmp_path / "orthophoto.pgw").read_text().split())
    picture = cv2.imread(str(tmp_path / "orthophoto.png"), cv2.IMREAD_UNCHANGED)
    assert a == -e > 0 and b == d == 0 and max(picture.shape[:2]) <= 1501
    with tifffile.TiffFile(tmp_path / "height.tif") as file:
        height, page = file.asarray(), file.pages[0]
        assert page.geotiff_tags["ModelPixelScale"][:2] == [a, a]
        tie = page.geotiff_tags["ModelTiepoint"]
        assert "forward" in page.geotiff_tags["GTCitationGeoKey"] and np.isnan(
            float(page.tags[42113].value)
        )
    assert height.shape == picture.shape[:2] and (cx, cy) == (
        pytest.approx(tie[3] + a / 2),
        pytest.approx(tie[4] - a / 2),
    )
    for x_m, y_m, z_m, bgr in ((11.0, 3.5, 3.0, [0, 0, 200]), (20.0, -5.0, -1.0, [0, 90, 0])):
        column, row = round((x_m - cx) / a), round((y_m - cy) / e)
        assert height[row, column] == pytest.approx(z_m) and list(picture[row, column]) == [
            *bgr,
            255,
        ]


def test_what_was_not_seen_is_empty_and_few_points_do(tmp_path):
    raster = rasterize(cloud_of([[0, 0, 1], [10, 10, 2]], [1, 1]), cell_m=1.0)
    assert np.isfinite(raster.height).sum() <= 2 and raster.height.shape[0] > 8
    write_from_above(cloud_of([[5.0, 1.0, 2.0]], [1.0]), tmp_path)
    assert cv2.imread(str(tmp_path / "orthophoto.png"), cv2.IMREAD_UNCHANGED).shape == (1, 1, 4)


def test_colmap_model_comes_back_as_it_went(scene, result, tmp_path):
    turn = transforms.from_xyz_rpy([0.01, 0.02, -0.01], [0.001, -0.002, 0.003])
    images = [
        e if e.name == "uav1/0" else replace(e, T_home_cam=e.T_home_cam @ turn)
        for e in result.images
    ]
    moved = replace(result, images=images)
    write_products(["colmap"], moved, scene, tmp_path)
    back = colmap.read_photographs(tmp_path / "colmap")
    read = {p.name: p for c in back.configurations for p in (*c.references, *c.others)}
    assert set(read) == {"uav1_0.png", "uav2_0.png", "uav2_1.png"}
    assert back.configurations[0].references[0].name == "uav1_0.png"
    for e in images:
        p = read[e.name.replace("/", "_") + ".png"]
        assert np.allclose(p.T_home_cam, e.T_home_cam, atol=1e-9)
        assert p.camera == CAMERA or np.allclose(p.camera.K, CAMERA.K, atol=1e-9)
    assert np.array_equal(read["uav1_0.png"].image, result.reference.image)
    axes = [c.configuration.axis for c in back.configurations]
    assert axes == ["horizontal", "vertical"]
    lines = (tmp_path / "colmap" / "points3D.txt").read_text().splitlines()
    assert len(lines) - 1 == len(result.cloud) and len(lines[1].split()) == 8


def test_pairs_reproject_to_the_walls(tmp_path):
    """A camera on the left, one on the right, one above, one below: Q and T_home_rect of each give
    points in home."""
    offsets = (
        ((0, -0.8, 0), "horizontal"),
        ((0, 0.8, 0), "horizontal"),
        ((0, 0, 0.8), "vertical"),
        ((0, 0, -0.8), "vertical"),
    )
    scene = given(*offsets)
    result = map_thesis(scene, ThesisOptions(threshold=ErrorThreshold(5.0, False)), lambda *_: None)
    write_products(["pairs"], result, scene, tmp_path)
    folders = sorted((tmp_path / "pairs").iterdir())
    assert len(folders) == 4
    for folder in folders:
        storage = cv2.FileStorage(str(folder / "calibration.yaml"), cv2.FILE_STORAGE_READ)
        axis = storage.getNode("axis").string()
        Q, T_home_rect = storage.getNode("Q").mat(), storage.getNode("T_home_rect").mat()
        first, second = ("left", "right") if axis == "horizontal" else ("top", "bottom")
        a, b = (cv2.imread(str(folder / f"{n}.png"), cv2.IMREAD_GRAYSCALE) for n in (first, second))
        if axis == "vertical":
            a, b = a.T.copy(), b.T.copy()
        disparity = (
            cv2.StereoSGBM_create(0, 64, 7, 400, 1600, 1, uniquenessRatio=10).compute(a, b) / 16.0
        )
        disparity = (disparity.T if axis == "vertical" else disparity).astype(np.float32)
        known = disparity > 4
        assert known.mean() > 0.4
        points = transforms.apply(T_home_rect, cv2.reprojectImageTo3D(disparity.copy(), Q)[known])
        near = np.minimum(abs(points[:, 0] - 12.0), abs(points[:, 0] - 20.0))
        # SGBM: to half a pixel and better
        assert np.median(near) < 0.5 * depth_error(20.0, 0.8, CAMERA.fx)


def test_a_pair_that_cannot_be_rectified_is_left_out_and_said(scene, result, tmp_path, monkeypatch):
    def refuse(first, second, axis):
        if axis == "vertical":
            raise MatchingError("one stands ahead of the other")
        return bouguet(first, second, axis)

    monkeypatch.setattr("fcsv_stereo.products.rectified.bouguet", refuse)
    copy = replace(result, warnings=[])
    write_products(["pairs"], copy, scene, tmp_path)
    assert [p.name for p in (tmp_path / "pairs").iterdir()] == ["01_horizontal_0"]
    assert (
        len(copy.warnings) == 1 and "vertical 1 is left out (one stands ahead" in copy.warnings[0]
    )


def test_the_command_writes_products_all_or_nothing(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "load", lambda path, reference, view: scene)
    options = ThesisOptions(threshold=ErrorThreshold(5.0, False))
    out = tmp_path / "map"
    for products in (list(ALL), []):  # the second run takes the first one's place, products and all
        pipeline.run(pipeline.MapRequest(tmp_path, out, "thesis", options, products=products))
        expected = {*output.FILES, *(f for p in products for f in PRODUCTS[p])}
        assert {p.name for p in out.iterdir()} == expected
    assert set(FILES) == {f for files in PRODUCTS.values() for f in files}

    def broken(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("fcsv_stereo.products.clouds.write_laz", broken)
    with pytest.raises(OutputError, match="laz: cannot be written .*No space left"):
        pipeline.run(
            pipeline.MapRequest(tmp_path, tmp_path / "other", "thesis", options, products=["laz"])
        )
    assert [p.name for p in tmp_path.iterdir()] == ["map"]


def test_the_ground_of_a_map_lies_in_its_folder_and_report(root, scene, tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "load", lambda path, reference, view: scene)
    options, robot = (
        ThesisOptions(threshold=ErrorThreshold(5.0, False)),
        root / "config/robots/rescue.yaml",
    )
    out = tmp_path / "map"
    document = pipeline.run(
        pipeline.MapRequest(tmp_path, out, "thesis", options, products=["ground"], robot=robot)
    )
    written = {path.name for path in (out / "ground").iterdir()}
    assert {
        "map.pgm",
        "map.yaml",
        "map.bt",
        "map.ot",
        "stand.tif",
        "ground.png",
        "ground.json",
    } <= written
    assert "free to stand on" in document["ground"]["summary"]
    page = (out / "report.html").read_text()
    assert 'id="ground"' in page and document["ground"]["summary"].split(":")[0] in page


def test_a_robot_is_asked_for_and_read_before_anything_is_mapped(root, tmp_path, monkeypatch):
    def never(*_):
        raise AssertionError("it was mapped")

    monkeypatch.setattr(pipeline, "load", never)
    asked = pipeline.MapRequest(tmp_path, tmp_path / "map", "thesis", ThesisOptions())
    with pytest.raises(InputError, match="ground needs a robot; add --robot FILE"):
        pipeline.run(replace(asked, products=["ground"]))
    with pytest.raises(InputError, match="add --products ground"):
        pipeline.run(replace(asked, robot=root / "config/robots/rescue.yaml"))
    (tmp_path / "wrong.yaml").write_text("name: wrong\nradius_m: -1\n")
    with pytest.raises(ConfigError, match="wrong.yaml"):
        pipeline.run(replace(asked, products=["ground"], robot=tmp_path / "wrong.yaml"))


def test_a_world_on_its_side_is_said(scene, result, tmp_path):
    turn = transforms.from_xyz_rpy([0, 0, 0], [np.pi / 2, 0, 0])
    lying = replace(result.reference, T_home_cam=turn @ result.reference.T_home_cam)
    for i, (reference, count) in enumerate(((result.reference, 0), (lying, 1))):
        copy = replace(result, reference=reference, warnings=[])
        (tmp_path / str(i)).mkdir()
        write_products(["orthophoto"], copy, scene, tmp_path / str(i))
        assert len(copy.warnings) == count and all("does not point up" in w for w in copy.warnings)


def test_a_map_of_sky_has_no_products(scene, result, tmp_path):
    empty = replace(result, cloud=cloud_of(np.zeros((0, 3)), []))
    with pytest.raises(OutputError, match="holds no points .*pcd, laz"):
        write_products(["pcd", "laz"], empty, scene, tmp_path)
    with pytest.raises(OutputError, match="'uav1/0' of the map is not among the pictures"):
        write_products(["colmap"], result, MapInput("session", []), tmp_path)
    assert true_depth(result.reference.T_home_cam).shape == result.depth.shape


def ply_as_its_header_says(path):
    """Columns by property name, read with nothing but the header: (names and types, name:
    values)."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    (count,) = (int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    properties = [tuple(line.split()[1:]) for line in lines if line.startswith("property")]
    values = np.frombuffer(
        body, [(name, {"float": "<f4", "uchar": "u1"}[kind]) for kind, name in properties]
    )
    assert len(values) == count
    return properties, values


def test_a_map_keeps_the_names_and_types_of_its_properties(result, tmp_path):
    """Other programs find x, y, z, colours, sigma and baseline under the names and types that they
    always had."""
    path, cloud = tmp_path / "map.ply", result.cloud
    expected = [
        *(("float", n) for n in "xyz"),
        *(("uchar", n) for n in ("red", "green", "blue")),
        ("float", "sigma"),
        ("uchar", "baseline"),
    ]
    output.write_ply(cloud, path)
    properties, values = ply_as_its_header_says(path)
    assert properties == expected
    for i, name in enumerate("xyz"):
        assert np.array_equal(values[name], cloud.points_home_m[:, i])
    for i, name in enumerate(("red", "green", "blue")):
        assert np.array_equal(values[name], cloud.colors[:, i])
    assert np.array_equal(values["sigma"], cloud.sigma_m) and np.array_equal(
        values["baseline"], cloud.baseline_index
    )
    back = output.read_ply(path)
    for name in cloud.__dataclass_fields__:
        a, b = getattr(back, name), getattr(cloud, name)
        assert np.array_equal(a, b) and a.dtype == b.dtype and a.shape == b.shape
    nothing = Cloud(*(getattr(cloud, n)[:0] for n in cloud.__dataclass_fields__))
    output.write_ply(nothing, path)
    assert ply_as_its_header_says(path)[0] == expected and len(output.read_ply(path)) == 0


@pytest.mark.parametrize(
    "text",
    [
        "an earlier map",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
        "property float y\nproperty float z\nend_header\n1 2 3\n",
    ],
)
def test_another_cloud_is_not_taken_for_a_map(text, tmp_path):
    (tmp_path / "map.ply").write_text(text)
    with pytest.raises(OutputError, match="is not a map.ply of this program"):
        output.read_ply(tmp_path / "map.ply")
    with pytest.raises(OutputError, match="other.ply: does not exist"):
        output.read_ply(tmp_path / "other.ply")


def test_far_ground_has_no_holes_and_a_step_of_depth_is_not_bridged():
    """Ground 8 m below a camera that looks ahead: from 50 m on its rows lie metres apart. A wall
    stands at 20 m."""
    camera = PinholeCamera(160, 120, 150.0, 150.0, 79.5, 59.5)
    T_home_cam = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
    rays = camera.rays()
    depth = np.where(rays[..., 1] > 0.1, 8.0 / np.maximum(rays[..., 1], 0.1), np.nan)
    wall = (np.abs(rays[..., 0]) < 0.1) & (rays[..., 1] < 0.3)
    depth = np.where(wall & np.isfinite(depth), 20.0, depth)
    known = np.isfinite(depth)
    points = (rays * depth[..., None])[known] @ transforms.R_FLU_OPTICAL.T
    cloud = cloud_of(points, np.ones(len(points)))
    reference = Reference("", 0.0, "", np.zeros((120, 160, 3), np.uint8), camera, T_home_cam)
    alone, spanned = rasterize(cloud, cell_m=0.5), rasterize(cloud, cell_m=0.5, reference=reference)

    def filled(raster, x_m, y_m):
        column, row = int((x_m - raster.x0_m) / 0.5), int((raster.y0_m - y_m) / 0.5)
        return np.isfinite(raster.height[row, column])

    beside = [(x, y) for x in np.arange(50.0, 74.0, 1.0) for y in (-9.0, 9.0)]
    behind = [(x, 0.0) for x in np.arange(30.0, 60.0, 1.0)]  # of the wall: nobody saw it
    assert np.mean([filled(alone, *p) for p in beside]) < 0.7
    assert all(filled(spanned, *p) for p in beside) and not any(filled(spanned, *p) for p in behind)
    on_ground = spanned.height[np.isfinite(spanned.height) & (spanned.height < -7.0)]
    assert np.abs(on_ground + 8.0).max() < 1e-3

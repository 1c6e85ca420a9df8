# SPDX-License-Identifier: Apache-2.0
"""Survey: surface model and orthophoto as GeoTIFF, the cloud as COPC."""

import resource
import zipfile

import laspy
import numpy as np
import pytest
import rasterio

from fcsv_geometry.programs.writing import in_words, write_whole
from fcsv_stereo.model import Cloud
from fcsv_stereo.products.clouds import write_laz
from fcsv_stereo.survey.surface import octree
from fcsv_stereo.survey.surface.octree import levels, write_copc
from fcsv_stereo.survey.surface.points import read_points, write_arrays, write_points
from fcsv_stereo.survey.surface.rasters import CellGrid, grid_of, surface_of, write_rasters

ORIGIN = np.array([391000.0, 5817000.0, 0.0])


def slope(count=60_000, seed=0):
    """Points of a plane that rises 0.1 m per metre of x over 40 x 20 m, and one that is high but
    unsure."""
    random = np.random.default_rng(seed)
    xy = random.uniform([0.0, 0.0], [40.0, 20.0], (count, 2))
    p = np.column_stack([xy, 0.1 * xy[:, 0]])
    sigma = np.full(count, 0.05)
    p[0], sigma[0] = [20.0, 10.0, 9.0], 5.0
    colors = np.column_stack([xy[:, 0] * 5, xy[:, 1] * 10, xy[:, 0] * 0]).astype(np.uint8)
    views = np.where(xy[:, 0] > 20.0, 2, 1).astype(np.uint8)
    return Cloud(p.astype(np.float32), colors, sigma.astype(np.float32), views)


def surface(cloud, origin_m):
    whole = grid_of(lambda: [cloud])
    return surface_of([cloud], whole, origin_m), whole


def write_surface(cloud, origin_m, folder, crs=""):
    made, whole = surface(cloud, origin_m)
    write_rasters([(whole, made)], whole, origin_m, folder, crs)
    return whole


def in_two(cloud):
    return [cloud[:20_000], cloud[20_000:]]


def test_the_surface_model_has_heights_sigma_and_views_where_they_are(tmp_path):
    grid = write_surface(slope(), ORIGIN, tmp_path, "EPSG:32633")
    with rasterio.open(tmp_path / "dsm.tif") as found:
        assert found.crs.to_epsg() == 32633 and found.count == 3 and np.isnan(found.nodata)
        assert found.descriptions == ("height (m)", "sigma (m)", "views")
        assert found.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
        height, sigma, views = next(found.sample([(391030.02, 5817010.02)]))
        assert height == pytest.approx(3.0, abs=2 * 0.1 * grid.cell_m + 0.02)
        assert sigma == pytest.approx(0.05) and views == 2
        middle = next(found.sample([(391020.0, 5817010.0)]))[0]
        assert middle == pytest.approx(2.0, abs=0.1)  # not the unsure point, 9 m high
        assert np.isfinite(found.read(1)).mean() > 0.98
    with rasterio.open(tmp_path / "orthophoto.tif") as found:
        assert found.count == 4 and found.dtypes[0] == "uint8"
        red = next(found.sample([(391030.02, 5817010.02)]))
        assert abs(int(red[0]) - 150) < 5 and red[3] == 255


def test_a_site_without_reference_system_is_local(tmp_path):
    write_surface(slope(), np.zeros(3), tmp_path)
    with rasterio.open(tmp_path / "dsm.tif") as found:
        assert "site" in found.crs.to_wkt() and found.crs.to_epsg() is None


def test_rasters_are_the_same_every_time(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_surface(slope(), ORIGIN, tmp_path / name, "EPSG:32633")
    for name in ("dsm.tif", "orthophoto.tif"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_few_points_are_a_raster_all_the_same():
    one = slope()[:3]
    assert np.isfinite(surface(one, np.zeros(3))[0].height).sum() >= 1


def test_windows_of_the_surface_are_the_whole_to_the_last_bit():
    """Gaps of a sparse slope are closed across the borders of windows, and of clouds."""
    cloud = slope(6000)
    whole = CellGrid(0.25, (2, 3), (157, 77))
    of_all = surface_of([cloud], whole, ORIGIN)
    assert 0.6 < np.isfinite(of_all.height).mean()
    assert len(np.unique(of_all.height)) < 0.9 * np.isfinite(of_all.height).sum()  # it has gaps
    for first, last in (((2, 3), (40, 30)), ((41, 31), (99, 77)), ((100, 31), (157, 60))):
        window = CellGrid(0.25, first, last)
        part = surface_of([cloud[:2500], cloud[2500:]], window, ORIGIN)
        for name in ("height", "sigma", "views", "rgb"):
            assert np.array_equal(
                getattr(part, name),
                getattr(of_all, name)[window.part(whole)],
                equal_nan=name != "rgb",
            )


def test_the_grid_of_clouds_is_that_of_their_points_together():
    assert grid_of(lambda: in_two(slope())) == grid_of(lambda: [slope()])
    p = slope().points_home_m.astype(float)
    grid = grid_of(lambda: [slope()])
    low, high = np.percentile(p[:, :2], (0.1, 99.9), axis=0)
    assert grid.first == tuple(np.floor(low / grid.cell_m)) and grid.cell_m == 0.2
    assert grid.last == tuple(np.floor(high / grid.cell_m))


def test_every_point_is_in_one_node_and_coarse_ones_come_first():
    points = slope().points_home_m.astype(float)
    low = points.min(axis=0)
    nodes = list(levels(points, low, 40.1))
    of = np.concatenate([i for _, i in nodes])
    assert len(of) == len(points) == len(np.unique(of))
    assert [k[0] for k, _ in nodes] == sorted(k[0] for k, _ in nodes) and nodes[-1][0][0] >= 1
    for (level, x, y, z), inside in nodes:
        side = 40.1 / 2**level
        at = (points[inside] - low) / side - [x, y, z]
        assert (at > -1e-6).all() and (at < 1.0 + 1e-6).all()


def box_of(cloud):
    return np.stack([f(axis=0) for f in (cloud.points_home_m.min, cloud.points_home_m.max)])


def test_a_copc_that_the_disk_does_not_take_is_said(tmp_path):
    """Files may not become larger than 50 kB here; copclib would end the process."""
    before, cloud = resource.getrlimit(resource.RLIMIT_FSIZE), slope()
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        with pytest.raises(OSError, match="site.copc.laz: .*is the disk full"):
            write_copc(lambda: [cloud], box_of(cloud), tmp_path / "site.copc.laz", ORIGIN)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("at_once", [1 << 20, 5000])
def test_copc_is_read_by_level_and_holds_all_points(tmp_path, monkeypatch, at_once):
    """All points at once, and by cubes that hold few of them."""
    monkeypatch.setattr(octree, "_MOST_AT_ONCE", at_once)
    cloud = slope()
    write_copc(
        lambda: in_two(cloud), box_of(cloud), tmp_path / "site.copc.laz", ORIGIN, "EPSG:32633"
    )
    las = laspy.read(str(tmp_path / "site.copc.laz"))
    assert len(las.points) == len(cloud) and las.header.parse_crs().to_epsg() == 32633
    assert np.max(las.x) == pytest.approx(391040.0, abs=0.01)
    assert np.median(las.intensity) == 50 and set(np.unique(las.user_data)) == {1, 2}
    with laspy.CopcReader.open(str(tmp_path / "site.copc.laz")) as reader:
        coarse = reader.query(level=0)
        assert 1000 < len(coarse) < len(cloud)
        assert len(reader.query()) == len(cloud)
        part = reader.query(
            laspy.copc.Bounds(np.array([391000.0, 5817000.0]), np.array([391010.0, 5817020.0]))
        )
        assert (np.asarray(part.x) <= 391010.0).all() and len(part) > 0.2 * len(cloud)


def test_points_of_which_any_octet_is_wrong_are_none_or_the_same(tmp_path):
    path, cloud = tmp_path / "a.zarr.zip", slope(50)
    write_points(cloud, {"agreed": 0}, path, "key")
    content = path.read_bytes()
    assert read_points(path, "key").load().points_home_m.tolist() == cloud.points_home_m.tolist()
    found = 0
    for i in range(0, len(content), 7):
        path.write_bytes(content[:i] + bytes([content[i] ^ 0xFF]) + content[i + 1 :])
        points = read_points(path, "key")
        if points is not None:  # a time, or who may read it
            found += 1
            assert points.load().points_home_m.tolist() == cloud.points_home_m.tolist()
    assert found < 0.2 * len(content) / 7


def test_arrays_are_the_same_octets_whenever_they_are_written(tmp_path):
    """Blocks that threads compress would be in the order in which they end: 1 of 3 times here."""
    values, path = np.zeros((2048, 512), np.float32), tmp_path / "a.zarr.zip"
    values[:512] = np.random.default_rng(0).normal(size=(512, 512))
    found = set()
    for _ in range(40):
        write_arrays({"a": values}, {}, path)
        with zipfile.ZipFile(path) as file:
            found.add(tuple(sorted((i.filename, i.CRC) for i in file.infolist())))
    assert len(found) == 1


def test_a_laz_whose_place_is_taken_leaves_nothing_and_is_said(tmp_path):
    (tmp_path / "a.laz").mkdir()
    with pytest.raises(OSError) as raised:
        write_laz(slope(50), tmp_path / "a.laz")
    assert in_words(raised.value) == f"{tmp_path}/a.laz: is a folder, not a file"
    with pytest.raises(OSError):
        write_whole(tmp_path / "a.laz", "")
    assert [p.name for p in tmp_path.iterdir()] == ["a.laz"]

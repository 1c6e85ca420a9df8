# SPDX-License-Identifier: Apache-2.0
"""Survey: a small drawn site through the command, its files, and what is said of wrong inputs."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import laspy
import numpy as np
import psutil
import pytest
import rasterio
import trimesh
import yaml
from support.photographs import model

from fcsv_geometry.bags.reading import messages
from fcsv_sim.sensors.photo_site import TRUTH, Stand, draw_site
from fcsv_sim.world.town import Town
from fcsv_stereo import fcsv_command, pipeline
from fcsv_stereo.errors import SurveyError
from fcsv_stereo.map_files import output
from fcsv_stereo.posed import colmap
from fcsv_stereo.survey.lock import alone_in
from fcsv_stereo.survey.placing.earth import EarthFrame
from fcsv_stereo.survey.tasks import joining, tiles
from fcsv_stereo.survey.views import inputs
from fcsv_stereo.survey.views.station import Station, heading_rad, load_station, prior_of

KEYS = {
    *("crs", "heights", "origin", "views", "edges", "world", "gps", "control_points", "files"),
    *("points", "min_m", "max_m", "tiles", "missing"),
}
VIEW_KEYS = {
    "name",
    "input",
    "T_site_home",
    "scale",
    "sigma_scale",
    "sigma_m",
    "sigma_yaw_deg",
    "overlaps",
}
TILE_KEYS = {"name", "files", "points", "min_m", "max_m"}
STATION = "place_m: [1, 2, 3]\nheading_deg: 10\nplace_sigma_m: 0.5\nheading_sigma_deg: 0.1\n"
ROBOT = Path(__file__).resolve().parents[2] / "config/robots/rescue.yaml"
PRODUCTS = ("--products", "mcap,mesh,ground", "--robot", ROBOT)
pytestmark = pytest.mark.xdist_group("survey")


def survey(*args):
    return fcsv_command.main(["survey", *map(str, args)])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Three views of a village, 12 m from each to the next, and their site with all products."""
    folder = tmp_path_factory.mktemp("site")
    stands = [Stand((30.0, y, 22.0), 0.0, 0.1) for y in (12.0, 0.0, -12.0)]
    drawn = draw_site(
        Town.generate(1, "village"),
        stands,
        folder / "drawn",
        size=(400, 300),
        baselines_m=(3.0, 6.0),
    )
    assert survey(*drawn, "-o", folder / "out", *PRODUCTS) == 0
    return folder


def document(out):
    return json.loads((out / "site.json").read_text())


@pytest.fixture
def maps(site, tmp_path):
    """Copies of the finished maps, as inputs of their own with their stations."""
    for i in (1, 2, 3):
        shutil.copytree(site / "out/views" / f"view{i:02d}", tmp_path / f"m{i}")
        shutil.copy(site / "drawn" / f"view{i:02d}" / "station.yaml", tmp_path / f"m{i}")
    return [tmp_path / f"m{i}" for i in (1, 2, 3)]


def test_the_views_scales_are_better_than_as_flown(site):
    """As drawn they differ by 1 % rms; the bench has 0.04 % with four pictures of full size
    (docs/lab/survey.md). The bound is what the bench must reach; here it is 0.05 % (2026-11-28)."""
    found = document(site / "out")
    off = []
    for v in found["views"]:
        true = np.load(site / "drawn" / v["name"] / "true_depth.npy")
        depth, sigma = (
            np.load(site / "out/views" / v["name"] / f"{n}.npy") for n in ("depth", "sigma")
        )
        both = np.isfinite(depth) & np.isfinite(true) & (sigma < 0.03 * depth)
        off.append(np.log(np.median(true[both] / depth[both])) - np.log(v["scale"]))
    assert np.std(off) < 0.003 and all(0 < v["sigma_scale"] < 0.01 for v in found["views"])


def test_site_json_has_the_keys_that_others_read(site):
    found = document(site / "out")
    assert (
        set(found) == KEYS
        and found["crs"] is None
        and found["gps"] is None
        and found["missing"] == []
    )
    assert [v["name"] for v in found["views"]] == ["view01", "view02", "view03"]
    assert all(set(v) == VIEW_KEYS for v in found["views"])
    assert set(found["edges"][0]) == {"a", "b", "kept", "reason", "residual_m"}
    assert sum(e["kept"] for e in found["edges"]) >= 2
    assert "view02" in found["views"][0]["overlaps"]


def test_homes_are_where_they_were_drawn(site):
    """Places are stated to 0.5 m per axis; home is the reference camera's place."""
    for v in document(site / "out")["views"]:
        T_world_cam = np.array(
            json.loads((site / "drawn" / v["name"] / TRUTH).read_text())["T_world_cam"]
        )
        T = np.array(v["T_site_home"])
        assert np.linalg.norm(T[:3, 3] - T_world_cam[:3, 3]) < 2.0
        assert np.cbrt(np.linalg.det(T[:3, :3])) == pytest.approx(v["scale"])
        assert v["sigma_yaw_deg"] < 0.2 and 0.0 < v["sigma_m"] < 0.6


def test_the_clouds_hold_the_same_points_with_sigma_and_views(site):
    out, found = site / "out", document(site / "out")
    head = (out / "site.ply").read_bytes().split(b"end_header\n")[0]
    assert b"property uchar views" in head and b"baseline" not in head
    las = laspy.read(str(out / "site.laz"))
    assert (
        len(las.points)
        == found["points"]
        == int(re.search(rb"vertex (\d+)", head).group(1))
        > 20_000
    )
    assert (np.asarray(las["views"]) >= 1).all() and (np.asarray(las["views"]) >= 2).mean() > 0.3
    assert (np.asarray(las["sigma"]) > 0).all() and np.min(las.x) == pytest.approx(
        found["min_m"][0], abs=0.01
    )


def test_tiles_hold_each_point_once(site):
    out, tiles = site / "out", document(site / "out")["tiles"]
    assert len(tiles) >= 4 and all(set(t) == TILE_KEYS for t in tiles)
    found = []
    for tile in tiles:
        las = laspy.read(str(out / tile["files"][0]))
        assert len(las.points) == tile["points"] and tile["name"] in tile["files"][0]
        assert las.xyz.min(axis=0) == pytest.approx(tile["min_m"], abs=0.01)
        found.append(in_millimetres(las))
    las = laspy.read(str(out / "site.laz"))
    of_all = in_millimetres(las)
    assert np.array_equal(np.sort(np.concatenate(found), axis=0), np.sort(of_all, axis=0))


def in_millimetres(las):
    """(N,4) whole numbers x, y, z, and sigma."""
    return np.column_stack([np.rint(1000.0 * las.xyz), las["sigma"]])


def test_the_page_shows_plan_and_edges(site):
    page = (site / "out/site.html").read_text()
    assert "Site of 3 views" in page and page.count("data:image/jpeg;base64,") == 2
    views, edges = (
        re.sub(r"<[^>]+>", " ", page.split(f">{title}</h2>")[1]) for title in ("Views", "Edges")
    )
    assert views.index("1 ") < views.index("view01") < views.index("2 ") < views.index("view02")
    assert "1 – 2" in edges and "nothing stands out as wrong" in page


def test_all_products_are_there_and_the_document_names_them(site):
    out = site / "out"
    files = document(out)["files"]
    assert {"site.copc.laz", "dsm.tif", "site.mcap", "site.glb", "ground"} <= set(files)
    assert all((out / name).exists() for name in files)
    page = (out / "site.html").read_text()
    assert "triangles of what is surer than" in page and "free to stand on" in page


def test_mcap_holds_the_site_in_messages_that_viewers_know(site):
    out = site / "out"
    found = {}
    for topic, message in messages(out / "site.mcap", lambda *_: True):
        assert topic not in found
        found[topic] = message
    assert {t.child_frame_id for t in found["/tf_static"].transforms} == {
        f"view_view0{i}" for i in (1, 2, 3)
    }
    places = {v["name"]: np.array(v["T_site_home"])[:3, 3] for v in document(out)["views"]}
    for pose, at in zip(found["/site/stations"].poses, places.values()):
        p, q = pose.position, pose.orientation
        assert np.allclose([p.x, p.y, p.z], at, atol=0.05)  # home is the camera's place
        assert 2 * np.arctan2(np.hypot(q.x, q.y), np.hypot(q.z, q.w)) < 0.2  # looks 0.1 rad down
    points = found["/site/points"]
    names = [f.name for f in points.fields]
    assert names == ["x", "y", "z", "rgb", "sigma", "views"] and points.point_step == 24
    x = np.frombuffer(points.data.tobytes(), "<f4").reshape(-1, 6)[:, 0]
    assert len(x) == points.width > 10_000 and x.max() <= document(out)["max_m"][0] + 0.001
    with rasterio.open(out / "dsm.tif") as dsm:
        cells = np.isfinite(dsm.read(1)).sum()
    assert 0 < found["/site/surface"].width <= cells
    kept = next(m for m in found["/site/edges"].markers if m.ns == "kept")
    assert len(kept.points) == 2 * sum(e["kept"] for e in document(out)["edges"])
    picture = cv2.imdecode(found["/view_view01/image"].data, cv2.IMREAD_COLOR)
    camera = found["/view_view01/camera_info"]
    assert picture.shape[:2] == (camera.height, camera.width) == (300, 400) and camera.k[0] > 100


def test_the_mesh_has_walls_colours_and_holes(site):
    mesh = trimesh.load(site / "out/site.glb", force="mesh")
    x, up, south = mesh.vertices.T
    low_m = document(site / "out")["min_m"]
    assert len(mesh.faces) > 5000 and np.ptp(up) > 5.0 and x.min() >= low_m[0] - 1.0
    upright = np.abs(mesh.face_normals[:, 1]) < 0.3
    assert 0.03 < upright.mean() < 0.9 and not mesh.is_watertight
    colours = mesh.visual.vertex_colors[:, :3].astype(float)
    assert colours.std(axis=0).min() > 10.0 and np.ptp(south) > 20.0


def test_the_ground_of_the_site_is_that_of_its_folder(site, tmp_path, capsys):
    out = site / "out"
    assert fcsv_command.main(["ground", str(out), "--robot", str(ROBOT), "-o", str(tmp_path)]) == 0
    of_survey, of_folder = (
        json.loads((folder / "ground.json").read_text()) for folder in (out / "ground", tmp_path)
    )
    assert of_survey == of_folder and of_survey["maps"] == ["view01", "view02", "view03"]
    assert 0.3 < of_survey["known"] < 0.95
    assert (out / "ground/map.bt").stat().st_size > 1000
    for name in ("height.tif", "stand.tif"):
        assert (out / "ground" / name).read_bytes() == (tmp_path / name).read_bytes()


def test_a_product_that_cannot_be_made_is_missing_and_the_rest_is_there(site, tmp_path, capsys):
    shutil.copytree(site / "out", tmp_path / "out")
    bound = ("--products", "mesh", "--mesh-sigma-m", "0.001")
    assert survey(*sorted((site / "drawn").iterdir()), "-o", tmp_path / "out", *bound) == 1
    found = document(tmp_path / "out")
    assert [m["name"] for m in found["missing"]] == ["site.glb"]
    assert "no depth is surer than 0.001 m" in capsys.readouterr().out
    left = {p.name for p in (tmp_path / "out").iterdir()}
    assert "site.laz" in left and not left & {"site.glb", "site.mcap", "ground"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--products", "mesh,cake"), "--products: 'cake' is not one of mcap, mesh, ground, all"),
        (("--products", "ground"), "the product ground needs a robot; add --robot FILE"),
        (("--robot", ROBOT), "--robot is of the product ground; add --products ground"),
        (("--mesh-sigma-m", "1"), "--mesh-sigma-m is of the product mesh"),
        (("--products", "mesh", "--mesh-sigma-m", "-1"), "must be above 0 m, got -1"),
        (("--products", "ground", "--robot", "none.yaml"), "none.yaml"),
    ],
)
def test_wrong_words_of_products_are_refused_before_any_map(site, tmp_path, capsys, words, said):
    assert survey(site / "drawn/view01", "-o", tmp_path / "out", *words) == 2
    assert said in capsys.readouterr().err and not (tmp_path / "out").exists()


def control_file(site, path, picture="{name}/00.png"):
    """gcp_list.txt of six places that the views truly see, in UTM's zone 33, height above the
    ellipsoid."""
    frame = EarthFrame.about(np.array([[13.4, 52.5, 0.0]]), None)
    lines = ["EPSG:32633"]
    pixels = [(120, 200), (200, 200), (280, 200), (120, 260), (200, 260), (280, 260)]
    for name in ("view01", "view02", "view03"):
        folder = site / "drawn" / name
        T = np.array(json.loads((folder / TRUTH).read_text())["T_world_cam"])
        depth = np.load(folder / "true_depth.npy")
        camera = colmap.read_cameras(folder / "cameras.txt")[1]
        for i, (u, v) in enumerate(pixels):
            ray = np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
            at = frame.to_projected((T[:3, :3] @ ray * depth[v, u] + T[:3, 3])[None])[0]
            where = f"{at[0]:.4f} {at[1]:.4f} {at[2]:.4f} {u} {v}"
            lines.append(f"{where} {picture.format(name=name)} {name}-{i}")
    path.write_text("\n".join(lines) + "\n")
    return frame


def test_control_points_bring_the_site_into_their_reference_system(site, tmp_path, capsys):
    """Stations are off by 0.5 m; the depths of drawn views at 25 m by 0.2 m."""
    frame = control_file(site, tmp_path / "gcp_list.txt")
    shutil.copytree(site / "out", tmp_path / "out")
    drawn = sorted((site / "drawn").iterdir())
    world = ("--gcp", tmp_path / "gcp_list.txt", "--check-points", "0.3", "--heights", "ellipsoid")
    assert survey(*drawn, "-o", tmp_path / "out", *world, "--products", "mcap") == 0
    found, said = document(tmp_path / "out"), capsys.readouterr().out
    assert found["crs"] == "EPSG:32633" and "ellipsoid" in found["heights"]
    checks = [p for p in found["control_points"] if p["check"]]
    assert len(checks) == 5 and "check point view01-1" in said
    off = np.array([p["residual_m"] for p in checks])
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 1.0
    for v in found["views"]:
        T = np.array(json.loads((site / "drawn" / v["name"] / TRUTH).read_text())["T_world_cam"])
        at = frame.to_projected(T[:3, 3][None])[0]
        assert np.linalg.norm(np.array(v["T_site_home"])[:3, 3] - at) < 0.5
    las = laspy.read(str(tmp_path / "out/site.laz"))
    assert las.header.parse_crs().to_epsg() == 32633
    assert abs(float(np.median(las.x)) - at[0]) < 300.0
    page = (tmp_path / "out/site.html").read_text()
    assert "EPSG:32633" in page and "view01-0" in page
    ((_, stations),) = messages(tmp_path / "out/site.mcap", lambda topic, _: "stations" in topic)
    p = stations.poses[-1].position
    assert np.linalg.norm(np.array([p.x, p.y, p.z]) + found["origin"] - at) < 0.5


def test_a_check_point_that_is_far_off_is_marked(site, tmp_path, capsys):
    control_file(site, tmp_path / "gcp_list.txt")
    head, *lines = (tmp_path / "gcp_list.txt").read_text().splitlines()
    named = lines[0].split()[-1]
    moved = [
        " ".join([f"{float(s.split()[0]) + 20.0}", *s.split()[1:]]) if s.endswith(named) else s
        for s in lines
    ]
    (tmp_path / "gcp_list.txt").write_text("\n".join([head, *moved]) + "\n")
    shutil.copytree(site / "out", tmp_path / "out")
    world = ("--gcp", tmp_path / "gcp_list.txt", "--check-points", named)
    assert survey(*sorted((site / "drawn").iterdir()), "-o", tmp_path / "out", *world) == 0
    said, page = capsys.readouterr().out, (tmp_path / "out/site.html").read_text()
    (line,) = [s for s in said.splitlines() if s.startswith(f"check point {named}: ")]
    assert -21.0 < float(line.split()[3]) < -19.0 and line.endswith("MORE THAN 3 SIGMA OFF")
    assert f"off by more than 3 of their sigmas: check point {named} (" in said
    assert "more than 3 of their sigmas" in page and ">more than 3 sigma<" in page


def test_control_points_that_no_view_tells_are_missing_and_the_rest_is_there(
    maps, site, tmp_path, capsys
):
    control_file(site, tmp_path / "gcp_list.txt", picture="elsewhere.jpg")
    assert survey(*maps, "-o", tmp_path / "out", "--gcp", tmp_path / "gcp_list.txt") == 1
    found = document(tmp_path / "out")
    assert found["crs"] is None and [m["name"] for m in found["missing"]] == ["world"]
    assert len(found["views"]) == 3 and "no view's reference" in capsys.readouterr().out


def test_a_wrong_control_list_is_refused_before_any_map(maps, tmp_path, capsys):
    (tmp_path / "gcp_list.txt").write_text("EPSG:32633\n1 2 3\n")
    assert survey(*maps, "-o", tmp_path / "out", "--gcp", tmp_path / "gcp_list.txt") == 2
    assert "gcp_list.txt, line 2: has 3 words" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_survey_that_was_stopped_goes_on(site, tmp_path, monkeypatch):
    """The second view's map is lost: it alone is made again. So are all points and tiles, which
    workers made before, and this process now; the site is the same."""
    shutil.copytree(site / "out", tmp_path / "out")
    (tmp_path / "out/views/view02.json").unlink()
    for folder in ("points", "tiles"):
        shutil.rmtree(tmp_path / "out" / folder)
    made, run = [], pipeline.run
    monkeypatch.setattr(
        pipeline,
        "run",
        lambda request, *rest: made.append(request.path.name) or run(request, *rest),
    )
    assert survey(*sorted((site / "drawn").iterdir()), "-o", tmp_path / "out") == 0
    assert made == ["view02"]
    names = ["site.ply", "site.laz", "site.copc.laz", "dsm.tif", "orthophoto.tif"]
    names += [t["files"][0] for t in document(site / "out")["tiles"]]
    for name in names:
        assert (tmp_path / "out" / name).read_bytes() == (site / "out" / name).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("words", ["starting workers", "view01: "])
def test_ctrl_c_is_answered_at_once_and_leaves_no_process(site, tmp_path, words):
    """While workers start, and while they make maps."""
    arguments = map(
        str, [*sorted((site / "drawn").iterdir()), "-o", tmp_path / "out", "--workers", "2"]
    )
    program = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    program += "from fcsv_geometry.programs import live_line; live_line.LOGGED_S = 0.0\n"
    program += "from fcsv_stereo.survey import command; import sys; sys.exit(command.main())"
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments], stderr=subprocess.PIPE, text=True
    )
    assert any(words in line for line in process.stderr)
    ends = time.monotonic() + 60.0
    while not (children := psutil.Process(process.pid).children(recursive=True)):
        assert time.monotonic() < ends
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    assert "survey: stopping" in next(s for s in process.stderr if "maps" not in s)
    pressed = time.monotonic()
    assert process.wait(20.0) == 130 and time.monotonic() - pressed < 10.0
    assert "survey: interrupted; what was finished is kept in OUT" in process.stderr.read()
    gone, alive = psutil.wait_procs(children, 10.0)
    assert not [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]
    with alone_in(tmp_path / "out"):
        pass  # nobody holds it


def test_a_station_that_moves_costs_no_map(site, tmp_path, monkeypatch):
    shutil.copytree(site / "drawn", tmp_path / "drawn")
    shutil.copytree(site / "out", tmp_path / "out")
    (tmp_path / "drawn/view01/station.yaml").unlink()
    monkeypatch.setattr(pipeline, "run", lambda *_: pytest.fail("a map was made again"))
    assert survey(*sorted((tmp_path / "drawn").iterdir()), "-o", tmp_path / "out") == 0


def test_another_picture_makes_the_map_again(site, tmp_path):
    folder = tmp_path / "view01"
    shutil.copytree(site / "drawn/view01", folder)
    before = inputs.content_key(folder)
    (folder / "station.yaml").write_text(STATION)
    assert inputs.content_key(folder) == before
    picture = cv2.imread(str(folder / "images/00.png"))
    cv2.imwrite(str(folder / "images/00.png"), 255 - picture)
    assert inputs.content_key(folder) != before


def test_finished_maps_are_inputs_and_without_stations_the_first_is_the_frame(
    maps, tmp_path, capsys
):
    for m in maps:
        (m / "station.yaml").unlink()
    assert survey(*maps, "-o", tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "the home of m1 is the site's frame" in said
    found = document(tmp_path / "out")
    assert not (tmp_path / "out/views").exists() and len(found["views"]) == 3
    steps = np.diff([np.array(v["T_site_home"])[:3, 3] for v in found["views"]], axis=0)
    assert np.allclose(np.linalg.norm(steps, axis=1), 12.0, atol=1.0)


def test_the_same_input_twice_is_said_and_left_out(maps, tmp_path, capsys):
    shutil.copytree(maps[0], tmp_path / "again")
    assert survey(*maps[:2], tmp_path / "again", "-o", tmp_path / "out") == 1
    missing = document(tmp_path / "out")["missing"]
    assert [m["name"] for m in missing] == ["again"] and "is the same as m1" in missing[0]["reason"]
    said = capsys.readouterr().out
    assert "MISSING again: is the same as m1" in said and "\n1 missing: again\n" in said
    assert len(document(tmp_path / "out")["views"]) == 2


def test_a_view_whose_map_fails_is_named_and_the_rest_is_there(maps, tmp_path, capsys):
    dark = model(tmp_path / "dark")
    assert survey(maps[0], dark, maps[1], "-o", tmp_path / "out") == 1
    found = document(tmp_path / "out")
    assert [m["name"] for m in found["missing"]] == ["dark"] and found["missing"][0]["reason"]
    assert [v["name"] for v in found["views"]] == ["m1", "m2"]
    assert "MISSING dark: " in capsys.readouterr().out
    assert "dark is missing" in (tmp_path / "out/site.html").read_text()


@pytest.fixture
def tasks_run(monkeypatch):
    """Names of the views and tiles that are computed in this process, in order."""
    names, join, make = [], joining.join_view, tiles.surface_of
    monkeypatch.setattr(joining, "join_view", lambda v, *o: names.append(v.name) or join(v, *o))
    monkeypatch.setattr(
        tiles, "surface_of", lambda c, w, *o: names.append(tile_at(w)) or make(c, w, *o)
    )
    return names


def tile_at(window):
    return "x{}_y{}".format(*(n // 512 for n in window.first))


def products(out):
    names = ("site.ply", "site.laz", "site.copc.laz", "dsm.tif", "site.json")
    return {n: (out / n).read_bytes() for n in names}


def test_a_view_or_a_tile_that_cannot_be_made_is_named_and_the_rest_is_there(
    maps, tmp_path, capsys, tasks_run
):
    """Folders stand where their files should be. Without them the same command goes on: it makes
    what is missing, and the site is the same."""
    out = tmp_path / "out"
    assert survey(*maps, "-o", out) == 0
    whole, before = products(out), document(out)
    made = {"m1", "m2", "m3"} | {t["name"] for t in before["tiles"]}
    assert set(tasks_run) == made and len(tasks_run) == len(made)
    tasks_run.clear()
    assert survey(*maps, "-o", out) == 0 and tasks_run == [] and products(out) == whole

    tile = max(before["tiles"], key=lambda t: t["points"])
    blocked = out / "tiles" / f"{tile['name']}.zarr.zip"
    blocked.unlink()
    blocked.mkdir()
    assert survey(*maps, "-o", out) == 1
    said, found = capsys.readouterr().out, document(out)
    assert f"1 missing: tile {tile['name']}" in said and "is a folder, not a file" in said
    assert [m["name"] for m in found["missing"]] == [f"tile {tile['name']}"]
    assert [t for t in before["tiles"] if t != tile] == found["tiles"]
    assert products(out)["site.laz"] == whole["site.laz"]
    with rasterio.open(out / "dsm.tif") as dsm:
        seen = np.isfinite(dsm.read(1))
        bounds = [
            dsm.index(*(np.array(tile[n][:2]) + inset))
            for n, inset in (("min_m", 0.3), ("max_m", -0.3))
        ]
        (bottom, left), (top, right) = bounds
        assert seen.any() and not seen[max(top, 0) : bottom, max(left, 0) : right].any()
    blocked.rmdir()
    tasks_run.clear()
    assert survey(*maps, "-o", out) == 0 and products(out) == whole
    assert tasks_run == [tile["name"]]

    for folder in ("points", "placed"):
        blocked = out / folder / "m2.zarr.zip"
        blocked.unlink()
        blocked.mkdir()
        assert survey(*maps, "-o", out) == 1
        assert "MISSING points of m2: " in capsys.readouterr().out
        points = json.loads((out / "adjustment.json").read_text())["views"]
        assert points["m2"]["points"] == 0 < points["m1"]["points"]
        las = laspy.read(str(out / "site.laz"))
        assert len(las.points) == points["m1"]["points"] + points["m3"]["points"]
        blocked.rmdir()
        assert survey(*maps, "-o", out) == 0 and products(out) == whole


def test_kept_points_and_tiles_that_are_damaged_are_made_again(maps, tmp_path, tasks_run):
    out = tmp_path / "out"
    assert survey(*maps[:2], "-o", out) == 0
    whole = products(out)
    cut, spoilt, *_ = (out / t["files"][0] for t in document(out)["tiles"])
    before = cut.read_bytes()
    cut.write_bytes(before[: len(before) // 2])
    kept = [out / folder / "m2.zarr.zip" for folder in ("placed", "points")]
    for path in (*kept, spoilt.with_suffix(".zarr.zip"), out / "site.copc.laz"):
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 0xFF
        path.write_bytes(bytes(content))
    tasks_run.clear()
    assert survey(*maps[:2], "-o", out) == 0 and products(out) == whole
    assert set(tasks_run) == {"m2", cut.stem, spoilt.stem} and cut.read_bytes() == before


def test_of_a_site_without_points_no_tile_is_left_and_products_are_missing(
    maps, tmp_path, capsys, monkeypatch
):
    """A file that is not of a survey stays, what a killed one left does not."""
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "out"
    assert survey("m1", "-o", "out") == 0
    assert document(out)["views"][0]["input"] == str(maps[0])
    for name in ("tiles/mine.laz", "tiles/x9_y9.laz.partial", "points/m9.zarr.zip.partial"):
        (out / name).write_text("")
    (out / "views/.m9.abc_ef12").mkdir(parents=True)
    (out / "points/m1.zarr.zip").unlink()
    (out / "points/m1.zarr.zip").mkdir()
    assert survey("m1", "-o", "out", "--products", "mesh") == 1
    found, said = document(out), capsys.readouterr().out
    assert [m["name"] for m in found["missing"]] == ["points of m1", "site.glb"]
    assert "points/m1.zarr.zip: is a folder" in said and "no view tells a point" in said
    left = [p.name for n in ("tiles", "points", "views") for p in (out / n).iterdir()]
    assert left == ["mine.laz", "m1.zarr.zip"]
    assert found["points"] == 0 and found["tiles"] == [] and not (out / "site.laz").exists()
    page = (out / "site.html").read_text()
    assert ">Plan</h2>" in page and ">Coverage</h2>" not in page


def test_stations_of_two_frames_are_refused(maps, tmp_path, capsys):
    """One view's in UTM, the other's local: no LAZ holds millimetres over such a distance."""
    station = yaml.safe_load((maps[1] / "station.yaml").read_text())
    station["place_m"] = [391000.0, 5817000.0, 22.0]
    (maps[1] / "station.yaml").write_text(yaml.safe_dump(station))
    assert survey(*maps[:2], "-o", tmp_path / "out") == 2
    assert "m1 and m2 lie 5,830 km apart" in capsys.readouterr().err


def test_another_view_costs_its_own_points_and_the_tiles_that_it_touches(maps, tmp_path, tasks_run):
    """It stands 1500 m beside the two others: only the tiles that were the last on that side, and
    had the points beyond them, are made again."""
    station = yaml.safe_load((maps[2] / "station.yaml").read_text())
    station["place_m"][1] += 1500.0
    (maps[2] / "station.yaml").write_text(yaml.safe_dump(station))
    out = tmp_path / "out"
    assert survey(*maps[:2], "-o", out) == 0
    before = [t["name"] for t in document(out)["tiles"]]
    tasks_run.clear()
    assert survey(*maps, "-o", out) == 0
    after = [t["name"] for t in document(out)["tiles"]]
    last = max(int(n.split("_y")[1]) for n in before)
    stays = {n for n in before if int(n.split("_y")[1]) < last}
    assert stays and "m3" in tasks_run and not {"m1", "m2", *stays} & set(tasks_run)
    assert stays < set(after) and set(after) - stays == set(tasks_run) - {"m3"}
    shutil.rmtree(out / "points")
    shutil.rmtree(out / "tiles")
    found = products(out)
    assert survey(*maps, "-o", out) == 0 and products(out) == found


def test_an_earlier_site_json_is_there_until_tiles_change(maps, tmp_path, monkeypatch):
    out = tmp_path / "out"
    assert survey(*maps[:2], "-o", out) == 0

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(joining, "join_view", stop)
    assert survey(*maps, "-o", out) == 130 and len(document(out)["views"]) == 2
    monkeypatch.undo()
    monkeypatch.setattr(tiles, "surface_of", stop)
    assert survey(*maps, "-o", out) == 130 and not (out / "site.json").exists()


@pytest.mark.slow
def test_what_a_killed_survey_joined_and_tiled_is_not_made_again(maps, tmp_path):
    """Killed as soon as so many files of points and tiles are there, of nine."""
    assert survey(*maps, "-o", tmp_path / "whole") == 0
    out, kept = tmp_path / "out", {}
    program = "from fcsv_stereo.survey import command; import sys; sys.exit(command.main())"
    words = [sys.executable, "-c", program, *map(str, maps), "-o", str(out)]
    for count in (1, 2, 4, 7):
        process = subprocess.Popen(words, stderr=subprocess.DEVNULL, start_new_session=True)
        ends = time.monotonic() + 60.0
        while len(notes(out)) < count and time.monotonic() < ends and process.poll() is None:
            time.sleep(0.005)
        with contextlib.suppress(ProcessLookupError):  # it may have ended meanwhile
            os.killpg(process.pid, signal.SIGKILL)
        assert process.wait() in (-signal.SIGKILL, 0) and len(notes(out)) >= count
        kept = {**notes(out), **kept}
    assert survey(*maps, "-o", out) == 0 and products(out) == products(tmp_path / "whole")
    assert kept.items() <= notes(out).items()


def notes(out):
    """When the files of points and tiles were written."""
    return {p: p.stat().st_mtime_ns for n in ("points", "tiles") for p in (out / n).glob("*.zip")}


def test_a_view_whose_scale_is_wrong_by_five_per_cent_is_said(maps, tmp_path, capsys):
    for name in ("depth", "sigma"):
        np.save(maps[1] / f"{name}.npy", np.load(maps[1] / f"{name}.npy") / 1.05)
    assert survey(*maps, "-o", tmp_path / "out") == 0
    assert "m2: its map is" in capsys.readouterr().out
    scales = {v["name"]: v["scale"] for v in document(tmp_path / "out")["views"]}
    assert scales["m2"] / scales["m1"] > 1.02


def test_views_that_do_not_overlap_stay_at_their_stations(maps, tmp_path, capsys):
    (maps[1] / "station.yaml").write_text(STATION.replace("heading_deg: 10", "heading_deg: 190"))
    assert survey(*maps[:2], "-o", tmp_path / "out") == 0
    said, found = capsys.readouterr().out, document(tmp_path / "out")
    assert "no other view sees what m1, m2 sees" in said
    assert "no two views were joined" in said and "overlaps no other: stays at its station" in said
    assert found["edges"] == [] and [v["overlaps"] for v in found["views"]] == [[], []]
    assert np.allclose(np.array(found["views"][1]["T_site_home"])[:3, 3], [1, 2, 3], atol=0.05)


def test_views_without_station_and_overlap_are_missing(maps, tmp_path):
    lone = maps[2]
    (lone / "station.yaml").unlink()
    cv2.imwrite(
        str(lone / "reference.png"), np.full_like(cv2.imread(str(lone / "reference.png")), 90)
    )
    assert survey(*maps, "-o", tmp_path / "out") == 1
    missing = document(tmp_path / "out")["missing"]
    assert [m["name"] for m in missing] == ["m3"] and "has no place: no station.yaml" in missing[0][
        "reason"
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (STATION.replace("10", ".nan"), "'heading_deg' must be finite"),
        (STATION.replace("[1, 2, 3]", "[1, 2, .nan]"), "'place_m[2]' must be finite"),
        (STATION.replace("[1, 2, 3]", "[1, 2]"), "'place_m' must have 3 values"),
        (STATION + "heading: 3\n", "unknown key 'heading'"),
        (STATION.replace("0.5", "5e-1"), "got str '5e-1': write 0.5"),
        (STATION.replace("place_sigma_m: 0.5\n", ""), "'place_sigma_m' is missing"),
        (STATION.replace("0.5", "-1"), "place_sigma_m: must be positive"),
        (STATION + "scale_sigma: 3\n", "scale_sigma: is a share of the scale"),
        ("place_m: [1, 2", "not valid YAML"),
    ],
)
def test_a_wrong_station_is_refused_before_any_map_by_file_and_field(
    maps, tmp_path, capsys, text, said
):
    (maps[1] / "station.yaml").write_text(text)
    assert survey(*maps, "-o", tmp_path / "out") == 2
    error = capsys.readouterr().err
    assert "m2/station.yaml" in error and said in error and not (tmp_path / "out").exists()


def test_a_station_whose_file_is_named_nearly_right_is_refused(maps, tmp_path, capsys):
    (maps[1] / "station.yaml").rename(maps[1] / "station.yml")
    assert survey(*maps, "-o", tmp_path / "out") == 2
    assert "m2/station.yml: would not be read; name it station.yaml" in capsys.readouterr().err


def test_names_that_collide_are_told_apart(maps, tmp_path, capsys):
    """A copy of m1 gets the name m1-2, which is that of another input."""
    maps[1].rename(tmp_path / "m1-2")
    assert survey(maps[0], maps[0], tmp_path / "m1-2", maps[2], "-o", tmp_path / "out") == 1
    found = document(tmp_path / "out")
    assert [v["name"] for v in found["views"]] == ["m1", "m1-2", "m3"]
    assert [m["name"] for m in found["missing"]] == ["m1-3"]


def test_a_view_without_any_sure_depth_is_missing(maps, tmp_path, capsys):
    np.save(maps[1] / "depth.npy", np.full_like(np.load(maps[1] / "depth.npy"), np.nan))
    assert survey(*maps, "-o", tmp_path / "out") == 1
    assert "MISSING m2: " in (said := capsys.readouterr().out) and "no depth that is sure" in said
    assert survey(maps[1], "-o", tmp_path / "none") == 2
    assert "no view could be mapped" in capsys.readouterr().err


def test_inputs_that_are_none_are_refused(maps, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    assert survey(maps[0], tmp_path / "empty", "-o", tmp_path / "out") == 2
    assert "empty: is neither a session" in capsys.readouterr().err
    assert survey(maps[0], tmp_path / "nowhere", "-o", tmp_path / "out") == 2
    assert "nowhere: does not exist" in capsys.readouterr().err


def test_a_folder_of_something_else_is_not_written_to(maps, tmp_path, capsys):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/thesis.tex").write_text("years of work")
    assert survey(*maps, "-o", tmp_path / "out") == 2
    assert "holds 'thesis.tex', which is not of a survey" in capsys.readouterr().err
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["thesis.tex"]


def test_a_map_whose_files_do_not_belong_together_is_named(maps, tmp_path, capsys):
    np.save(maps[1] / "sigma.npy", np.zeros((3, 3), np.float32))
    assert survey(*maps, "-o", tmp_path / "out") == 1
    reason = document(tmp_path / "out")["missing"][0]["reason"]
    assert "m2: is not a map of this program (sigma.npy: has shape (3, 3)" in reason


def test_a_map_with_an_empty_file_is_said_and_the_surveys_own_is_made_again(
    site, maps, tmp_path, capsys
):
    (maps[1] / "kind.npy").write_bytes(b"")
    assert survey(maps[1], "-o", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "m2: is not a map" in said and "makes it again" not in said
    shutil.copytree(site / "out", tmp_path / "own")
    (tmp_path / "own/views/view02/depth.npy").write_bytes(b"")
    assert survey(site / "drawn/view02", "-o", tmp_path / "own") == 2
    assert "No data left in file); the same command makes it again" in capsys.readouterr().err
    assert not (tmp_path / "own/views/view02.json").exists()


def test_no_map_at_all_is_one_line(tmp_path, capsys):
    assert survey(model(tmp_path / "dark"), "-o", tmp_path / "out") == 2
    assert "no view could be mapped: dark: " in capsys.readouterr().err
    assert not (tmp_path / "out/site.json").exists()


def test_a_station_gives_place_and_heading(tmp_path):
    (tmp_path / "station.yaml").write_text(STATION)
    station = load_station(tmp_path)
    assert (
        station == Station((1.0, 2.0, 3.0), 10.0, 0.5, 0.1)
        and load_station(tmp_path / "none") is None
    )
    from support.survey_views import camera_at

    found = prior_of(station, camera_at(50, 60, 7, heading_deg=-70), False, "a")
    assert heading_rad(found.T_site_cam) == pytest.approx(np.radians(10.0))
    assert found.T_site_cam[:3, 3].tolist() == [1.0, 2.0, 3.0] and found.placed


def test_a_station_needs_a_home_that_is_upright(tmp_path):
    sideways = np.eye(4)
    sideways[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    with pytest.raises(SurveyError, match="turn the model upright"):
        prior_of(Station((0.0, 0.0, 0.0), 0.0, 1.0, 1.0), sideways, False, "a")


def test_clouds_of_maps_still_say_baseline(site):
    assert len(output.read_ply(site / "out/views/view01/map.ply")) > 1000

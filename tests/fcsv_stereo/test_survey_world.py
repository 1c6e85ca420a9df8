# SPDX-License-Identifier: Apache-2.0
"""Survey: the world's coordinates from control points and GPS, on views with known truth."""

from dataclasses import replace

import numpy as np
import pytest
from support.gps_tags import write_tagged
from support.photographs import model
from support.survey_views import camera_at, seen, true_edge, unplaced, view

from fcsv_geometry import transforms
from fcsv_stereo.errors import FcsvError, InputError, SurveyError
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.placing import earth, georeference
from fcsv_stereo.survey.placing.control_points import check_names, read_control_points, sights
from fcsv_stereo.survey.placing.earth import EarthFrame
from fcsv_stereo.survey.placing.georeference import WorldOptions
from fcsv_stereo.survey.placing.world import Statement, adjust_world, statements_of, unlikely_points
from fcsv_stereo.survey.views import inputs

NAMES = [f"v{i}" for i in range(6)]
#: True poses in the earth's frame (east, north, up): an arc of 60 m about a middle.
POSES = {
    n: camera_at(60.0 * np.sin(a), -60.0 * np.cos(a), 3.0 * i % 5, heading_deg=90.0 + np.degrees(a))
    for i, (n, a) in enumerate(zip(NAMES, np.radians(15.0 * np.arange(6))))
}
#: The stations' frame: turned and away.
T_EARTH_STATIONS = transforms.from_xyz_yaw([25.0, -40.0, 7.0], 1.1)
MIDDLE = np.array([[13.4, 52.5, 80.0]])


def scales(sigma=0.013, seed=3):
    random = np.random.default_rng(seed)
    return {n: float(np.exp(sigma * random.standard_normal())) for n in NAMES}


def edges_of(true):
    pairs = list(zip(NAMES[:-1], NAMES[1:])) + list(zip(NAMES[:-2], NAMES[2:]))
    return [true_edge(a, b, POSES, true, seed=i) for i, (a, b) in enumerate(pairs)]


def views_of(known_as=None):
    """Views whose homes are turned about z against the earth, and unknown to it."""
    found = []
    for n in NAMES:
        T_home_cam = transforms.invert(T_EARTH_STATIONS) @ POSES[n]
        found.append(view(n, POSES[n], known_as=unplaced(T_home_cam)))
    return found


def points(count=8, seed=0):
    random = np.random.default_rng(seed)
    return {f"p{i}": random.uniform([-30, -30, -3], [30, 30, 3]) for i in range(count)}


def seen_by(at, true, names=NAMES, seed=0):
    """Statements of control points of 2 cm, as views with their scales measure them."""
    found = []
    for n, p in at.items():
        for k, v in enumerate(names):
            f = seen(p[None], POSES[v], true[v], seed=seed + 100 * k + len(found))
            found.append(Statement(v, f.points[0], f.covariances[0], p, np.full(3, 0.02), n))
    return found


def fixes(true, sigma_m=2.0, seed=0):
    random = np.random.default_rng(seed)
    sigma = np.array([sigma_m, sigma_m, 2.0 * sigma_m])
    return [
        Statement(
            n, np.zeros(3), np.zeros((3, 3)), POSES[n][:3, 3] + sigma * random.normal(size=3), sigma
        )
        for n in NAMES
    ]


def off_m(adjusted):
    return np.array(
        [similarity.place(p.S_site_cam) - POSES[n][:3, 3] for n, p in adjusted.placed.items()]
    )


def test_control_points_place_turn_and_scale_views_that_know_no_place():
    true = scales()
    adjusted, fit = adjust_world(views_of(), edges_of(true), seen_by(points(5), true))
    # 60 m away a depth is known to 0.9 m, 30 sights of a point in a view and 5 points: 0.1 m
    assert np.sqrt(np.mean(off_m(adjusted) ** 2)) < 0.3 and len(adjusted.placed) == 6
    common = np.mean([np.log(p.scale / true[n]) for n, p in adjusted.placed.items()])
    assert abs(common) < 4 * fit.sigma_scale < 0.02
    assert not any("is the site's frame" in r for r in adjusted.remarks)


def test_check_points_have_no_say_and_lie_inside_their_sigma():
    true, at = scales(), points(10, seed=4)
    checks = ["p1", "p3", "p5", "p7", "p9"]
    _, fit = adjust_world(views_of(), edges_of(true), seen_by(at, true), checks)
    found = {p.name: p for p in fit.points}
    assert [n for n, p in found.items() if p.check] == checks
    assert not any(found[n].used for n in checks) and found["p0"].used
    off = np.array([found[n].off_m for n in checks])
    sigma = np.array([found[n].sigma_m for n in checks])
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.3
    assert 0.2 < np.mean((off / sigma) ** 2) < 2.0
    moved = [replace(s, p=s.p + 5.0) if s.point in checks else s for s in seen_by(at, true)]
    _, again = adjust_world(views_of(), edges_of(true), moved, checks)
    assert np.allclose(
        [p.off_m for p in again.points if not p.check],
        [p.off_m for p in fit.points if not p.check],
        atol=1e-6,
    )


def test_a_check_point_beyond_three_sigma_is_marked():
    true, at = scales(), points(10, seed=4)
    moved = [replace(s, p=s.p + 5.0) if s.point == "p3" else s for s in seen_by(at, true)]
    _, fit = adjust_world(views_of(), edges_of(true), moved, ["p1", "p3"])
    assert [p.name for p in fit.points if p.unlikely] == ["p3"]
    (said,) = unlikely_points(fit.points)
    assert "more than 3 of their sigmas: check point p3 (8." in said
    _, fit = adjust_world(views_of(), edges_of(true), seen_by(at, true), ["p1", "p3"])
    assert unlikely_points(fit.points) == []


def test_gps_alone_gives_heading_and_scale_within_the_stated_sigma():
    true, ratios = scales(), []
    for seed in range(6):
        adjusted, fit = adjust_world(views_of(), edges_of(true), fixes(true, seed=seed))
        common = np.mean([np.log(p.scale / true[n]) for n, p in adjusted.placed.items()])
        ratios.append((common / fit.sigma_scale) ** 2)
        assert np.linalg.norm(off_m(adjusted).mean(axis=0)) < 4.0 * np.sqrt(3) * fit.sigma_m
    assert np.mean(ratios) < 2.5


def test_stations_keep_their_frame_that_the_control_points_turn():
    """Stations say places and headings in a frame of their own, to 0.5 m and 0.1 degrees."""
    true, random = scales(), np.random.default_rng(5)
    views = []
    for n in NAMES:
        T = transforms.invert(T_EARTH_STATIONS) @ POSES[n]
        T[:3, 3] += random.normal(0.0, 0.5, 3)
        v = view(n, POSES[n])
        views.append(replace(v, prior=replace(v.prior, T_site_cam=T)))
        adjusted, fit = adjust_world(views, [], seen_by(points(2), true))
    assert len(adjusted.placed) == 6  # without any edge
    assert np.sqrt(np.mean(off_m(adjusted) ** 2)) < 1.0 and fit is not None


def test_a_wrong_control_point_is_named_and_has_no_say():
    true, at = scales(), points(6)
    told = [
        replace(s, p=s.p + [0.0, 8.0, 0.0]) if s.point == "p2" else s for s in seen_by(at, true)
    ]
    adjusted, fit = adjust_world(views_of(), edges_of(true), told)
    said = [r for r in adjusted.remarks if "control point p2 in" in r]
    assert said and "it has no say" in said[0]
    assert np.sqrt(np.mean(off_m(adjusted) ** 2)) < 0.4


@pytest.mark.parametrize(
    ("count", "level", "world"),
    [(1, True, False), (2, True, True), (2, False, False), (3, False, True)],
)
def test_too_few_points_leave_the_site_in_its_own_frame(count, level, world):
    true = dict.fromkeys(NAMES, 1.0)
    views = views_of()
    if not level:
        views = [replace(v, prior=replace(v.prior, tilt_rad=np.inf)) for v in views]
    adjusted, fit = adjust_world(views, edges_of(true), seen_by(points(count), true))
    assert (fit is not None) == world and len(adjusted.placed) == 6
    if not world:
        assert any("not in the world's coordinates" in r for r in adjusted.remarks)


def test_a_model_without_metres_takes_its_scale_from_the_points():
    true = {n: 7.0 * s for n, s in scales().items()}
    adjusted, fit = adjust_world(views_of(), edges_of(true), seen_by(points(5), true))
    assert any(
        "lengths are not metres: 7.0" in r or "are not metres: 6.9" in r for r in adjusted.remarks
    )
    assert np.sqrt(np.mean(off_m(adjusted) ** 2)) < 0.4


def test_views_that_no_edge_joins_are_placed_by_their_own_points():
    true = scales()
    edges = [e for e in edges_of(true) if {e.a, e.b} <= set(NAMES[:3])]
    edges += [e for e in edges_of(true) if {e.a, e.b} <= set(NAMES[4:])]
    told = [s for s in seen_by(points(5), true) if s.view != "v3"]
    adjusted, _ = adjust_world(views_of(), edges, told)
    assert list(adjusted.lost) == ["v3"] and "has no place in the world" in adjusted.lost["v3"]
    assert np.sqrt(np.mean(off_m(adjusted) ** 2)) < 0.5


def test_the_projected_site_is_where_its_points_are():
    """A point of a view by the view's own similarity, and by PROJ: 50 m away to 5 cm."""
    frame = EarthFrame.about(MIDDLE, None)
    assert earth.name_of(frame.crs) == "EPSG:32633"
    true = scales()
    adjusted, _ = adjust_world(views_of(), edges_of(true), seen_by(points(5), true))
    for p in adjusted.placed.values():
        q = georeference.projected_placed(p, frame)
        p_cam = np.array([[3.0, 2.0, 50.0]])
        by_proj = frame.to_projected(similarity.apply(p.S_site_cam, p_cam))
        assert np.allclose(similarity.apply(q.S_site_cam, p_cam), by_proj, atol=0.05)


def test_frames_go_to_the_earth_and_back():
    frame = EarthFrame.about(MIDDLE, earth.projected_crs("EPSG:25833"))
    geographic = earth.to_geographic(frame.crs, frame.to_projected(np.array([[100.0, -50.0, 3.0]])))
    assert np.allclose(frame.from_geographic(geographic), [[100.0, -50.0, 3.0]], atol=1e-4)
    east = frame.turn_at(np.zeros(3)) @ [1.0, 0.0, 0.0]
    assert 0.9995 < np.linalg.norm(east) < 1.0001 and abs(east[1]) < 0.05


def gcp_file(folder, text):
    path = folder / "gcp_list.txt"
    path.write_text(text)
    return path


GOOD = "WGS84 UTM 33N\n# x y z u v picture name\n391000 5817000 80 50 40 a.jpg north\n391010.5 5817000 81 10 12 b.jpg\n"


def test_a_control_list_is_read_as_odm_writes_it(tmp_path):
    control = read_control_points(gcp_file(tmp_path, GOOD + "391010.5 5817000 81 11 12 c.jpg\n"))
    assert list(control.points) == ["north", "point2"] and len(control.marks) == 3
    assert control.points["point2"].tolist() == [391010.5, 5817000.0, 81.0]
    assert control.crs.to_epsg() == 32633 and control.marks[2].point == "point2"
    degrees = gcp_file(tmp_path, "EPSG:4326\n13.4 52.5 80 1 2 a.jpg x\n")
    assert read_control_points(degrees).points["x"].tolist() == [13.4, 52.5, 80.0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("Mars 3\n1 2 3 4 5 a.jpg\n", "line 1: 'Mars 3' is no reference system"),
        ("EPSG:32633\n", "holds no control point"),
        ("EPSG:32633\n1 2 3 4 a.jpg\n", "line 2: has 5 words"),
        ("EPSG:32633\n1 2 up 4 5 a.jpg\n", "line 2: could not convert"),
        ("EPSG:32633\n1 2 nan 4 5 a.jpg\n", "line 2: its numbers must be finite"),
        ("EPSG:2225\n1 2 3 4 5 a.jpg\n", "has not metres"),
        ("EPSG:4979\n1 2 3 4 5 a.jpg\n", "has 3 axes"),
        (GOOD + "391001 5817000 80 1 2 b.jpg north\n", "line 5: north is at"),
        (GOOD + "391001 5817000 80 1 2 DJI 0001.JPG\n", "blanks into double quotes"),
        ("EPSG:32633\n5817000 391000 3 4 5 a.jpg\n", "are x and y exchanged"),
        ("EPSG:4326\n391000 5817000 3 4 5 a.jpg p\n", "p: coordinates lie outside of EPSG:4326"),
    ],
)
def test_a_wrong_control_list_is_refused_by_line(tmp_path, text, said):
    with pytest.raises(FcsvError, match=said) as error:
        read_control_points(gcp_file(tmp_path, text))
    assert "gcp_list.txt" in str(error.value)


def test_a_control_list_of_other_programs_is_read(tmp_path):
    """A byte order mark, ends of lines as Windows has them, a name with blanks."""
    path = gcp_file(tmp_path, "")
    text = GOOD.replace("a.jpg", '"DJI 0001.JPG"').replace("\n", "\r\n")
    path.write_bytes(text.encode("utf-8-sig"))
    assert read_control_points(path).marks[0].picture == "DJI 0001.JPG"
    path.write_bytes("EPSG:32633\n# Süd\n".encode("latin-1"))
    with pytest.raises(InputError, match="is not text in UTF-8; save it so"):
        read_control_points(path)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="none.txt: does not exist"):
        read_control_points(tmp_path / "none.txt")


def test_check_points_are_named_or_a_share(tmp_path):
    control = read_control_points(gcp_file(tmp_path, GOOD))
    assert check_names(control, "north") == ["north"] and check_names(control, "") == []
    assert len(check_names(control, "0.5")) == 1
    with pytest.raises(SurveyError, match="has no south; it has north, point2"):
        check_names(control, "south")
    with pytest.raises(SurveyError, match="a share is 0 to below 1"):
        check_names(control, "1.5")


def test_marks_become_points_of_their_views(tmp_path):
    """The wall of the drawn view is 40 m away."""
    views = [replace(view(n, camera_at(0, 0)), picture="00.png") for n in ("a", "b")]
    views[1].depth[:] = np.nan
    lines = ["a/00.png one", "b/00.png one", "a/reference.png two", "far.jpg two"]
    text = "EPSG:32633\n" + "".join(f"{i} 2 3 50 40 {s}\n" for i, s in zip((1, 1, 2, 2), lines))
    found, remarks = sights(read_control_points(gcp_file(tmp_path, text)), views)
    assert [(s.point, s.view) for s in found] == [("one", "a"), ("two", "a")]
    assert found[0].p_cam[2] == pytest.approx(40.0, abs=0.01)
    assert any("b has no depth at pixel 50, 40" in r for r in remarks)
    assert any("no view's reference" in r and "far.jpg" in r for r in remarks)
    with pytest.raises(SurveyError, match="write a/00.png or b/00.png"):
        sights(read_control_points(gcp_file(tmp_path, GOOD.replace("a.jpg", "00.png"))), views)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"crs": "EPSG:4326"}, "is not projected to metres"),
        ({"crs": "EPSG:0"}, "is no reference system"),
        ({"sigma_m": 0.0}, "--control-sigma-m"),
        ({"heights": "sea"}, "--heights"),
        ({"checks": "a"}, "--gcp, which is not given"),
    ],
)
def test_wrong_options_are_refused(options, said):
    with pytest.raises(SurveyError, match=said):
        WorldOptions(**options)


def test_gps_of_photographs_alone_places_the_site():
    true = dict.fromkeys(NAMES, 1.0)
    frame = EarthFrame.about(MIDDLE, None)
    at = earth.to_geographic(
        frame.crs, frame.to_projected(np.array([POSES[n][:3, 3] for n in NAMES]))
    )
    views = [replace(v, gps=Gps(p[1], p[0], p[2], 0.02, 0.04)) for v, p in zip(views_of(), at)]
    adjusted, found, world = georeference.place(views, edges_of(true), WorldOptions().read())
    assert world.crs == "EPSG:32633" and "by EXIF above sea level" in world.heights
    assert len(world.fit.gps) == 6 and all(r.used for r in world.fit.gps)
    places = np.array([similarity.place(p.S_site_cam) for p in adjusted.placed.values()])
    back = found.to_projected(places)
    assert np.allclose(
        back, frame.to_projected(np.array([POSES[n][:3, 3] for n in NAMES])), atol=0.2
    )
    without = georeference.place(
        views, edges_of(true), WorldOptions(gps=False, crs="EPSG:25833").read()
    )
    assert without[2] is None and any("--crs has no effect" in r for r in without[0].remarks)


def test_fixes_of_flights_are_where_the_vehicles_were_not_the_camera():
    """A session's GPS is that of its vehicles' middle, here 5 m beside and 3 m behind each
    camera."""
    true, off_cam = dict.fromkeys(NAMES, 1.0), np.array([5.0, 0.0, -3.0])
    frame = EarthFrame.about(MIDDLE, None)
    there = np.array([transforms.apply(POSES[n], off_cam[None])[0] for n in NAMES])
    at = earth.to_geographic(frame.crs, frame.to_projected(there))
    views = [
        replace(v, gps=Gps(p[1], p[0], p[2], 0.02, 0.04), gps_cam_m=off_cam)
        for v, p in zip(views_of(), at)
    ]
    adjusted, found, _ = georeference.place(views, edges_of(true), WorldOptions().read())
    places = np.array([similarity.place(p.S_site_cam) for p in adjusted.placed.values()])
    cameras = np.array([POSES[n][:3, 3] for n in NAMES])
    assert np.allclose(found.to_projected(places), frame.to_projected(cameras), atol=0.3)


def test_statements_take_the_points_by_name(tmp_path):
    control = read_control_points(gcp_file(tmp_path, GOOD))
    views = [replace(view("a", camera_at(0, 0)), picture="a.jpg")]
    found, _ = sights(control, views)
    said = statements_of(found, {"north": np.array([1.0, 2.0, 3.0])}, 0.05)
    assert said[0].p.tolist() == [1.0, 2.0, 3.0] and said[0].sigma.tolist() == [0.05] * 3


def test_gps_and_camera_are_those_of_the_reference_photograph(tmp_path):
    """EXIF's metres to a millimetre; a session or a map has neither."""
    folder = model(tmp_path / "walk", cameras="1 SIMPLE_RADIAL 64 48 60 32 24 0.1\n")
    (folder / "images/a.png").unlink()
    (folder / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n\n2 1 0 0 0 -1 0 0 1 b.png\n\n")
    said = Gps(52.5, 13.4, 80.0)
    write_tagged(folder / "images/a.jpg", np.zeros((48, 64, 3), np.uint8), said, error_m=0.5)
    source = inputs.sources_of([folder])[0]
    camera, gps = inputs.photograph_of(source, "a.jpg")
    assert camera.distortion[0] == 0.1 and gps.sigma_m == 0.5 and gps.height_sigma_m == 1.0
    assert gps.latitude_deg == pytest.approx(52.5, abs=1e-8) and gps.height_m == 80.0
    assert inputs.photograph_of(source, "b.png")[1] is None
    assert inputs.photograph_of(source, "elsewhere.jpg") == (None, None)
    as_map = replace(source, kind=inputs.SourceKind.MAP)
    assert inputs.photograph_of(as_map, "a.jpg") == (None, None)


def test_marks_in_distorted_photographs_are_undistorted(tmp_path):
    """A mark near the corner, by a camera of 10 % distortion, points where the pinhole's does."""
    plain = replace(view("a", camera_at(0, 0)), picture="a.jpg")
    bent = replace(plain.camera, distortion=(0.1, 0.0, 0.0, 0.0, 0.0))
    ray = np.array([[0.3, 0.2, 1.0]])
    (u, v), straight_u = bent.project(ray)[0], plain.camera.project(ray)[0, 0]
    assert abs(u - straight_u) > 0.3
    text = f"EPSG:32633\n1 2 3 {u} {v} a.jpg one\n"
    found, _ = sights(
        read_control_points(gcp_file(tmp_path, text)), [replace(plain, taken_with=bent)]
    )
    assert np.allclose(found[0].p_cam / found[0].p_cam[2], ray[0], atol=1e-3)

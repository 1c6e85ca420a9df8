# SPDX-License-Identifier: Apache-2.0
"""A car and a walker that move through the town, drawn where they are at a picture's time."""

import csv

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.demo import monitored
from fcsv_sim.demo.monitored import Frame
from fcsv_sim.demo.truth_export import export_movers
from fcsv_sim.errors import SimulationError
from fcsv_sim.render.bodies import BoxedThing, draw_bodies
from fcsv_sim.world.country import CountryPlan
from fcsv_sim.world.export import write_mesh
from fcsv_sim.world.movers import movers
from fcsv_sim.world.plan import TownPlan
from fcsv_stereo.errors import InputError
from fcsv_stereo.evaluating.truth import load_truth

CAMERA = PinholeCamera.from_fov(160, 120, np.radians(56.0), (0.0,) * 5)
T_WORLD_CAM = transforms.from_xyz_yaw([0.0, 0.0, 3.0], 0.0) @ transforms.transform(
    transforms.R_FLU_OPTICAL, np.zeros(3)
)
WALL_S = 1795627487.0  # as large as clocks are


@pytest.fixture(scope="module")
def both():
    return {m.name: m for m in movers(TownPlan.draw(np.random.default_rng(1)))}


def drawn(mover, stamp_s, behind_m=np.nan, T_world_cam=T_WORLD_CAM):
    values = np.full((120, 160, 3), 0.5, np.float32)
    depth = np.full((120, 160), behind_m, np.float32)
    thing = BoxedThing(mover.boxes, mover.T_world_body(stamp_s), mover.radius_m)
    draw_bodies(
        [thing],
        T_world_cam,
        CAMERA,
        np.ascontiguousarray(CAMERA.rays(), np.float32),
        1.0,
        values,
        depth,
    )
    return values, depth


@pytest.mark.parametrize("name", ["car", "walker"])
def test_they_go_to_and_fro_at_their_speed(both, name):
    mover = both[name]
    stamps = WALL_S + np.arange(0.0, 20.0, 0.05)
    y = np.array([mover.y_m(t)[0] for t in stamps])
    assert mover.reach_m[0] <= y.min() < y.max() <= mover.reach_m[1]
    steps = np.abs(np.diff(y))
    assert steps.max() <= mover.speed_mps * 0.05 + 1e-5
    assert np.median(steps) == pytest.approx(mover.speed_mps * 0.05, abs=1e-5)


@pytest.mark.parametrize("name", ["car", "walker"])
def test_they_are_drawn_where_they_are_at_the_time(both, name):
    mover = both[name]
    for stamp_s in (WALL_S, WALL_S + 1.0, WALL_S + 2.5):
        T = transforms.invert(T_WORLD_CAM) @ mover.T_world_body(stamp_s)
        _, depth = drawn(mover, stamp_s)
        on = np.isfinite(depth)
        assert on.sum() > 20
        # half of a car's width, and its bonnet's height
        assert abs(np.median(depth[on]) - T[2, 3]) < 1.0
        u = np.nonzero(on)[1]
        middle = CAMERA.project(transforms.apply(T, mover.boxes[:, :3]))[:, 0].mean()
        assert abs(u.mean() - middle) < 3.0  # px; its parts are not of one size


def test_the_car_is_hidden_by_what_is_nearer_and_hides_what_is_farther(both):
    before, depth = drawn(both["car"], WALL_S, behind_m=10.0)
    assert (before == 0.5).all() and (depth == 10.0).all()
    values, depth = drawn(both["car"], WALL_S, behind_m=100.0)
    assert (depth < 30.0).sum() > 50 and values[depth < 30.0].std() > 0.05  # its panels differ


def test_what_is_behind_the_camera_is_not_drawn(both):
    away = T_WORLD_CAM.copy()
    away[0, 3] = 60.0
    values, depth = drawn(both["car"], WALL_S, T_world_cam=away)
    assert (values == 0.5).all() and np.isnan(depth).all()


def test_nothing_moves_where_no_street_crosses():
    with pytest.raises(SimulationError, match="a street that crosses"):
        movers(CountryPlan.of(np.random.default_rng(1), [0.0], []))


def truth_of(both, folder, wall_m):
    """As a demo leaves it: a wall, a camera at two moments, and what moved."""
    wall = np.array([[wall_m, y, z] for y in (-80.0, 80.0) for z in (-80.0, 80.0)])
    write_mesh(wall, np.array([[0, 1, 2], [1, 2, 3]]), folder / "scene.ply", "a wall")
    T = T_WORLD_CAM
    pose = ",".join(f"{v:.9f}" for v in (*T[:3, 3], *transforms.quaternion_xyzw(T)))
    rows = [f"{WALL_S + t:.9f},uav1,{pose}" for t in (0.0, 1.0)]
    (folder / "cameras.csv").write_text(
        "\n".join(["stamp_s,vehicle,x,y,z,qx,qy,qz,qw", *rows]) + "\n"
    )
    export_movers(folder, list(both.values()))
    return load_truth(folder)


@pytest.fixture
def truth(both, tmp_path):
    return truth_of(both, tmp_path, 60.0)


def test_their_truth_is_what_is_drawn(both, truth):
    for stamp_s in (WALL_S, WALL_S + 1.0):
        depth, on = monitored.TrueScene(truth).look("uav1", stamp_s, CAMERA)
        assert set(on) == {"car", "walker"}
        for name, mover in both.items():
            _, alone = drawn(mover, stamp_s)
            seen = on[name] & np.isfinite(alone)
            assert seen.sum() > 0.9 * on[name].sum() > 20  # edges differ by a pixel
            assert np.abs(depth[seen] - alone[seen]).mean() < 0.05
        assert (depth[~(on["car"] | on["walker"])] == pytest.approx(60.0, abs=0.01)) and not (
            on["car"] & on["walker"]
        ).any()


def test_monitored_images_are_judged_and_what_is_off_is_told(truth, tmp_path):
    scene, folder = monitored.TrueScene(truth), tmp_path / "monitor"
    folder.mkdir()
    for t, off, skew_s in ((0.0, 1.0, 0.004), (1.0, 1.2, 0.011)):
        depth, on = scene.look("uav1", WALL_S + t, CAMERA)
        depth = np.where(on["walker"], np.nan, np.where(on["car"], off * depth, depth)).astype(
            np.float32
        )
        monitored.save(
            folder, Frame("uav1", WALL_S + t, depth, CAMERA, "a pair", skew_s, 3.0 + t, 0.2, 0.4)
        )
    judged = monitored.evaluate(monitored.load(folder), truth)
    cars = [m for j in judged for m in j.moving if m.name == "car"]
    assert [m.median_relative_error for m in cars] == pytest.approx([0.0, 0.2], abs=1e-5)
    assert [m.wrong for m in cars] == [0.0, 1.0] and all(m.answered == 1.0 for m in cars)
    first, car, walker = monitored.in_words(judged)
    assert "2 depth images, median rate 3.5 Hz, skew at most 11 ms, median age 0.40 s" in first
    assert car.endswith(
        "within 5% of its distance in 1 of the 2 images that show it (worst 20.0%), 1 off"
    )
    assert walker.endswith(
        "walker, which moves: within 5% of its distance in 0 of the 2 images that show it, 2 not answered"
    )
    rows = table(judged, tmp_path)
    assert [(r["what"], r["verdict"]) for r in rows[:3]] == [
        ("all", ""),
        ("car", "right"),
        ("walker", "not answered"),
    ]
    assert (
        len(rows) == 6
        and rows[4]["verdict"] == "off"
        and rows[1]["distance_m"] == f"{cars[0].distance_m:.2f}"
    )
    assert int(rows[1]["pixels"]) <= int(rows[1]["unhidden_pixels"])  # the walker may be before it


def table(judged, folder):
    monitored.write_table(judged, folder / "frames.csv")
    with open(folder / "frames.csv", newline="") as file:
        return list(csv.DictReader(file))


def judged_with_a_wall(both, folder, at_m, camera=CAMERA):
    """One frame, right where anything is seen, with a wall at ``at_m`` (m)."""
    truth = truth_of(both, folder, at_m)
    depth = monitored.TrueScene(truth).depth("uav1", WALL_S, camera)
    return monitored.evaluate(
        [Frame("uav1", WALL_S, depth, camera, "a pair", 0.0, 1.0, 0.2, 0.4)], truth
    )


def test_what_moves_and_is_hidden_is_said_and_not_counted_as_answered(both, tmp_path):
    judged = judged_with_a_wall(both, tmp_path, 10.0)
    assert judged[0].moving == () and {u.why for u in judged[0].unjudged} == {"hidden"}
    _, car, walker = monitored.in_words(judged)
    assert (
        car.endswith("in 0 of the 0 images that show it; not judged in 1: 1 hidden")
        and walker.count("1 hidden") == 1
    )
    rows = table(judged, tmp_path)
    assert [r["verdict"] for r in rows] == ["", "hidden", "hidden"] and rows[1]["pixels"] == "0"
    assert int(rows[1]["unhidden_pixels"]) > 100 and rows[1]["median_error"] == ""


@pytest.mark.parametrize("yaw_rad, alone", [(0.0, False), (np.pi, True)])
def test_what_no_other_vehicle_of_the_image_sees_is_said(both, tmp_path, yaw_rad, alone):
    """uav2 stands 2 m aside, and looks there, too, or the other way."""
    truth_of(both, tmp_path, 60.0)
    T = transforms.from_xyz_yaw([0.0, -2.0, 3.0], yaw_rad) @ transforms.transform(
        transforms.R_FLU_OPTICAL, np.zeros(3)
    )
    pose = ",".join(f"{v:.9f}" for v in (*T[:3, 3], *transforms.quaternion_xyzw(T)))
    with open(tmp_path / "cameras.csv", "a") as file:
        file.write(f"{WALL_S:.9f},uav2,{pose}\n")
    truth, nothing = load_truth(tmp_path), np.full((120, 160), np.nan, np.float32)
    frame = Frame("uav1", WALL_S, nothing, CAMERA, "uav2, horizontal 2.0 m", 0.0, 1.0, 0.2, 0.4)
    judged = monitored.evaluate([frame], truth)
    assert {u.why for u in judged[0].unjudged} == ({"seen by no other vehicle"} if alone else set())
    car = monitored.in_words(judged)[1]
    assert ("not judged in 1: 1 seen by no other vehicle" in car) == alone and (
        "1 not answered" in car
    ) != alone


def test_what_moves_and_is_beside_the_picture_or_too_small_is_said(both, tmp_path):
    # looks at the ground far below both
    beside = PinholeCamera(160, 120, 2000.0, 2000.0, 79.5, -900.0)
    _, car, walker = monitored.in_words(judged_with_a_wall(both, tmp_path, 60.0, beside))
    assert "not judged in 1: 1 outside the picture" in car and "1 outside the picture" in walker
    wide = PinholeCamera(160, 120, 30.0, 30.0, 79.5, 59.5)
    judged = judged_with_a_wall(both, tmp_path, 60.0, wide)
    assert {u.name: u.why for u in judged[0].unjudged}["walker"] == "too small"


def test_a_frame_that_is_none_is_named_and_none_at_all_is_said(tmp_path):
    assert monitored.in_words([]) == ["monitoring: no depth image came"]
    (tmp_path / "1.0.npz").write_text("no frame")
    with pytest.raises(InputError, match=r"1\.0\.npz: not a monitored depth image"):
        monitored.load(tmp_path)

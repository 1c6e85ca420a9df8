# SPDX-License-Identifier: Apache-2.0
"""A car and a walker that move through the town, drawn where they are at a picture's time."""

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_sim.render.bodies import BoxedThing, draw_bodies
from fcsv_sim.world.movers import movers
from fcsv_sim.world.plan import TownPlan

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
    draw_bodies([thing], T_world_cam, CAMERA, np.ascontiguousarray(CAMERA.rays(), np.float32), 1.0, values, depth)
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
        assert abs(np.median(depth[on]) - T[2, 3]) < 1.0  # half of a car's width, and its bonnet's height
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

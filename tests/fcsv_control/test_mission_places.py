# SPDX-License-Identifier: Apache-2.0
"""Set-points against numeric truth, and ways that keep clear."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fcsv_control.mission.activities.landing import Landing
from fcsv_control.mission.outbox import Outbox
from fcsv_control.mission.snapshot import Snapshot, VehicleView
from fcsv_control.mission.watches.fleet_modes import FleetModes
from fcsv_control.mission.watches.telemetry import VehicleTelemetry
from fcsv_control.mission.ways import clearing, places, routes
from fcsv_geometry import transforms
from fcsv_geometry.errors import MissionError
from fcsv_geometry.home import home_of, odoms_in_home
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME, camera_place
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.missions.separation import SeparationRules, distance_m
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.vehicle import Mount
from fcsv_tracking.column.calibration import Link

SEPARATION_M = 1.5


def link(T_parent_child):
    return Link("uav1", "uav2", T_parent_child, np.eye(4), 0.0, 0.0, 0.0, 1, 0)


def cam(mount):
    return mount.T_body_part @ transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(
    "configuration, expected_flu",
    [
        (StereoConfiguration("horizontal", 4.0), (0.0, -4.0, 0.0)),  # right of the reference
        (StereoConfiguration("vertical", 7.0), (0.0, 0.0, 7.0)),  # above it
        (StereoConfiguration("horizontal", 8.0, tilt_deg=6.0), (0.0, -8.0, 0.0)),
    ],
)
def test_set_points_bring_the_camera_there_in_the_world(seed, configuration, expected_flu):
    """Two vehicles with odometry frames anywhere in the world: whatever the frames, the camera must
    end up beside the reference's camera as it truly looked when home was set. Everything is exact
    but for rounding (1e-9)."""
    random = np.random.default_rng(seed)
    T_world_O1 = transforms.from_xyz_yaw(random.uniform(-50, 50, 3), random.uniform(-np.pi, np.pi))
    T_world_O2 = transforms.from_xyz_yaw(random.uniform(-50, 50, 3), random.uniform(-np.pi, np.pi))
    T_body_cam1, T_body_cam2 = (
        cam(Mount((0.11, 0.0, 0.03))),
        cam(Mount((0.2, -0.1, 0.05), (0.0, 0.0, 10.0))),
    )
    tilted = random.uniform(-0.1, 0.1, 2)  # hovering is not quite level when home is set
    T_world_D1 = transforms.from_xyz_rpy(
        random.uniform(-9, 9, 3), [*tilted, random.uniform(-np.pi, np.pi)]
    )

    T_O1_home = home_of(transforms.invert(T_world_O1) @ T_world_D1 @ T_body_cam1)
    T_home_odom = odoms_in_home(
        [link(transforms.invert(T_world_O1) @ T_world_O2)], "uav1", T_O1_home
    )
    T_O2_D2 = places.body_set_point(camera_place(configuration), T_home_odom["uav2"], T_body_cam2)

    T_world_home = T_world_O1 @ T_O1_home
    T_home_cam2 = transforms.invert(T_world_home) @ T_world_O2 @ T_O2_D2 @ T_body_cam2
    np.testing.assert_allclose(T_home_cam2[:3, 3], expected_flu, atol=1e-9)
    # + is left: inward
    assert places.heading_rad(T_home_cam2) == pytest.approx(configuration.tilt_rad, abs=1e-9)
    # a hovering body is level
    np.testing.assert_allclose((T_world_O2 @ T_O2_D2)[2, :3], [0, 0, 1], atol=1e-9)
    # home is where the reference's camera was, and its x is that camera's view seen from above
    view = (T_world_D1 @ T_body_cam1)[:3, 2]
    np.testing.assert_allclose(T_world_home[:3, 3], (T_world_D1 @ T_body_cam1)[:3, 3], atol=1e-9)
    np.testing.assert_allclose(T_world_home[:2, 0], view[:2] / np.linalg.norm(view[:2]), atol=1e-9)


def test_a_camera_that_looks_down_still_stands_at_its_place():
    """The body stays level, so the mount's pitch stays; its lever arm must not shift the camera."""
    T_body_cam = cam(Mount((0.3, 0.0, 0.1), (0.0, 20.0, 0.0)))
    place = camera_place(StereoConfiguration("horizontal", 4.0))
    T_body = places.body_set_point(place, np.eye(4), T_body_cam)
    np.testing.assert_allclose((T_body @ T_body_cam)[:3, 3], [0, -4, 0], atol=1e-12)


def test_inward_tilt_points_both_cameras_at_one_point():
    """At 8 m and 10 degrees the axes cross 8 / tan(10 deg) = 45 m ahead."""
    T = camera_place(StereoConfiguration("horizontal", 8.0, tilt_deg=10.0))
    ahead = 8.0 / np.tan(np.radians(10.0))
    p_cam = transforms.apply(transforms.invert(T), np.array([ahead, 0.0, 0.0]))
    assert abs(p_cam[0]) < 1e-9 and p_cam[2] > 0


# ---- ways ----------------------------------------------------------------------------------------

coordinate = st.floats(-12, 12)
point = st.tuples(coordinate, coordinate, st.floats(-2, 12)).map(np.array)


def sampled_clearance(start, way, other):
    """By brute force, another way than the code's."""
    nodes = [start, *way]
    legs = [
        a + (b - a) * s for a, b in zip(nodes, nodes[1:]) for s in np.linspace(0, 1, 200)[:, None]
    ]
    return float(np.min(np.linalg.norm(np.array(legs) - other, axis=1)))


@settings(max_examples=150)
@given(point, point, st.lists(point, min_size=1, max_size=3))
def test_no_way_comes_too_near(start, goal, others):
    """Any start, any goal, up to three vehicles about: either no way, or one that keeps clear all
    along."""
    assume(all(np.linalg.norm(p - o) > SEPARATION_M for p in (start, goal) for o in others))
    try:
        way = routes.route(start, goal, others, routes.Keep(SEPARATION_M))
    except MissionError:
        # only between two vehicles whose keep-out spheres touch may there be none
        assert any(
            np.linalg.norm(a - b) < 3 * SEPARATION_M
            for i, a in enumerate(others)
            for b in others[i + 1 :]
        )
        return
    np.testing.assert_array_equal(way[-1], goal)
    for other in others:
        assert sampled_clearance(start, way, other) >= SEPARATION_M - 1e-6
    assert min(p[2] for p in way) >= min(start[2], goal[2]) - 0.2 - 1e-9, (
        "a way must not dip towards the ground"
    )
    length = sum(np.linalg.norm(b - a) for a, b in zip([start, *way], way))
    assert length <= np.linalg.norm(goal - start) + len(others) * 4 * SEPARATION_M, (
        "no needless wandering"
    )


CONFIGURATIONS = [("horizontal", b) for b in (2, 4, 6, 8, 10)] + [
    ("vertical", b) for b in (5, 7, 10)
]


@pytest.mark.parametrize("before", [None, *CONFIGURATIONS])
@pytest.mark.parametrize("after", [None, *CONFIGURATIONS])
def test_every_change_of_the_thesis_list_has_a_way(before, after):
    """None is the place in the column, 3.5 m behind the reference."""

    def at(c):
        return (
            np.array([-3.5, 0, 0.0]) if c is None else camera_place(StereoConfiguration(*c))[:3, 3]
        )

    way = routes.route(at(before), at(after), [np.zeros(3)], routes.Keep(SEPARATION_M))
    assert sampled_clearance(at(before), way, np.zeros(3)) >= SEPARATION_M - 1e-6
    assert len(way) <= 2


def test_straight_where_it_can_be():
    assert len(routes.route([0, -2, 0], [0, -8, 0], [np.zeros(3)], routes.Keep(SEPARATION_M))) == 1


def test_round_a_vehicle_in_the_middle():
    way = routes.route([-4, 0, 0], [4, 0, 0], [np.zeros(3)], routes.Keep(SEPARATION_M))
    assert (
        len(way) >= 2
        and sampled_clearance(np.array([-4.0, 0, 0]), way, np.zeros(3)) >= SEPARATION_M - 1e-6
    )


def test_a_start_too_near_is_left_outwards():
    way = routes.route([0, -1.0, 0], [0, 6, 0], [np.zeros(3)], routes.Keep(SEPARATION_M))
    assert sampled_clearance(np.array([0, -1.0, 0]), way, np.zeros(3)) >= 1.0 - 1e-6


def test_a_goal_too_near_is_refused():
    with pytest.raises(MissionError, match=r"is 1\.0 m from another vehicle, at least 1\.5 m"):
        routes.route([0, -5, 0], [0, -1, 0], [np.zeros(3)], routes.Keep(SEPARATION_M))


def test_ways_keep_clear_of_downwash():
    """Over another vehicle 1.5 m are enough to be apart, not to be out of its air."""
    keep = routes.Keep(SEPARATION_M, SeparationRules(0.95, 3.0))
    way = [np.array([0.0, -4.0, 0.0]), *routes.route([0, -4, 0], [0, 0, 5], [np.zeros(3)], keep)]
    for a, b in zip(way, way[1:]):
        for share in np.linspace(0.0, 1.0, 50):
            assert distance_m(a + share * (b - a), 3.0) > 0.94
    with pytest.raises(MissionError, match="downwash of the upper one: 2.8 m straight above"):
        routes.route([0, -4, 0], [0, 0, 2], [np.zeros(3)], keep)


def seen_at(*p_home_m, **fields):
    return VehicleView(
        T_home_cam=transforms.transform(T_HOME_CAM_AT_HOME[:3, :3], np.array(p_home_m)), **fields
    )


@pytest.mark.parametrize("known_height_m", [-3.0, 0.0, 2.0])
def test_nobody_lands_where_a_lost_one_may_lie(known_height_m):
    """It lies on the ground, whatever height it was known at last; the longer it flew on, the
    further away."""
    lost = {"lost": True, "astray_m": 18.0}
    air = {
        "uav1": seen_at(10.0, 0.0, 0.0, armed=True),
        "uav2": seen_at(0.0, 0.0, known_height_m, **lost),
    }
    moment = Snapshot(0.0, air)
    assert clearing.below(moment, "uav1", 2.0) == "uav2"
    place = clearing.aside(moment, "uav1", "uav2", 2.0)[:3, 3]
    assert np.hypot(*place[:2]) > 18.0
    moment.vehicles["uav1"] = seen_at(*place, armed=True)
    assert clearing.below(moment, "uav1", 2.0) is None


@pytest.mark.parametrize("towards_mps, is_above", [(0.0, False), (1.9, True), (-1.9, False)])
def test_who_flies_towards_anothers_column_counts_as_above_it(towards_mps, is_above):
    """4 m beside it; it is told to land, and comes to a stand 2 m further on."""
    above = seen_at(
        0.0, -4.0, 4.0, armed=True, mode=Mode.GUIDED, v_home_mps=np.array([0.0, towards_mps, 0.0])
    )
    moment = Snapshot(
        0.0, {"uav1": seen_at(0.0, 0.0, 0.0, armed=True, mode=Mode.GUIDED), "uav2": above}
    )
    assert clearing.below(moment, "uav2", 2.2) == ("uav1" if is_above else None)
    landing = replace(above, mode=Mode.LAND)
    moment.vehicles["uav2"] = landing
    assert clearing.coming_down_on(moment, "uav1", 2.2) == ("uav2" if is_above else None)


def test_a_mission_that_slows_down_gently_counts_with_a_longer_stop():
    """4 m beside it at 1.4 m/s: a stand 1.2 m further on at 1.5 m/s², 2.5 m at 0.5 m/s²."""
    above = seen_at(
        0.0, -4.0, 4.0, armed=True, mode=Mode.GUIDED, v_home_mps=np.array([0.0, 1.4, 0.0])
    )
    air = {"uav1": seen_at(0.0, 0.0, 0.0, armed=True, mode=Mode.GUIDED), "uav2": above}
    assert clearing.below(Snapshot(0.0, air), "uav2", 2.2) is None
    assert clearing.below(Snapshot(0.0, air, slows_mps2=0.5), "uav2", 2.2) == "uav1"


def test_who_lands_by_hand_is_told_that_one_lies_somewhere():
    air = {"uav1": seen_at(10.0, 0.0, 0.0, armed=True, mode=Mode.LOITER)}
    air["uav2"] = seen_at(0.0, 0.0, -8.0, lost=True, astray_m=18.2, state_age_s=0.1)
    landing = Landing(
        Mission("m", [StereoConfiguration("horizontal", 4.0)]), list(air), Outbox(), FleetModes(air)
    )
    assert not landing.step(Snapshot(0.0, air))
    assert (
        "uav2: lies within 18 m of where it was known last; who lands by hand looks for it"
        in landing.problems
    )
    assert "uav1 is above uav2: fly it aside, then land it (LOITER)" in landing.problems


def test_nobody_lands_where_a_silent_one_may_have_gone():
    """Its radio is gone: its guardian moves it 5 m aside of who was above, and lands it. Rehearsed,
    seed 520121."""
    heard = VehicleTelemetry(np.eye(4))
    heard.state(0.0, Mode.GUIDED, True, True)
    heard.odometry(0.0, np.eye(4), (0.0, 0.0, 0.0))
    other = seen_at(0.0, -5.5, 2.0, armed=True, mode=Mode.GUIDED)
    for now_s, found in ((1.0, None), (3.0, "uav1")):
        moment = Snapshot(now_s, {"uav1": heard.view(now_s, np.eye(4)), "uav2": other})
        assert clearing.below(moment, "uav2", 2.0) == found
    place = clearing.aside(moment, "uav2", "uav1", 2.0)[:3, 3]
    assert np.linalg.norm(place[:2]) > 7.5

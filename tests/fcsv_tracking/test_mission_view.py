# SPDX-License-Identifier: Apache-2.0
"""What a mission plans, as markers: the fence, home, planned places, and what two cameras both
see."""

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.camera_places import T_HOME_CAM_AT_HOME, camera_place
from fcsv_geometry.missions.mission import StereoConfiguration, load_mission
from fcsv_tracking import mission_view
from fcsv_tracking.scene.shared_view import shared_view

TANGENTS = (0.5, 0.4)


def sees(T_home_cam, points, reach_m):
    p = transforms.apply(transforms.invert(T_home_cam), points)
    return (
        (p[:, 2] > 0)
        & (p[:, 2] < reach_m)
        & (abs(p[:, 0]) < 0.5 * p[:, 2])
        & (abs(p[:, 1]) < 0.4 * p[:, 2])
    )


def volume(faces):
    """Of the room within, by the divergence theorem from a point inside; each face once, however it
    is wound."""
    middle = np.concatenate(faces).mean(axis=0)
    total = 0.0
    for face in faces:
        for a, b in zip(face[1:], face[2:]):
            total += abs(np.dot(face[0] - middle, np.cross(a - middle, b - middle))) / 6.0
    return total


@pytest.mark.parametrize(
    "planned", [("horizontal", 6.0, 10.0), ("horizontal", 3.0, -8.0), ("vertical", 5.0, 0.0)]
)
def test_the_shared_room_is_what_both_cameras_see(planned):
    """Against points thrown at random: 200 000 of them tell the volume to a few tenths of a
    percent."""
    reach_m = 25.0
    other = camera_place(StereoConfiguration(*planned))
    faces = shared_view(T_HOME_CAM_AT_HOME, other, TANGENTS, reach_m)
    low, high = np.array([0.0, -16.0, -16.0]), np.array([30.0, 16.0, 16.0])
    points = np.random.default_rng(1).uniform(low, high, (200_000, 3))
    both = sees(T_HOME_CAM_AT_HOME, points, reach_m) & sees(other, points, reach_m)
    # walls that lie in one
    faces = [f for k, f in enumerate(faces) if not any(same_face(f, g) for g in faces[:k])]
    assert volume(faces) == pytest.approx(both.mean() * np.prod(high - low), rel=0.02)
    corners = np.concatenate(faces)
    inside = corners + 1e-6 * (points[both].mean(axis=0) - corners)
    assert sees(T_HOME_CAM_AT_HOME, inside, reach_m).all() and sees(other, inside, reach_m).all()


def same_face(f, g):
    return {tuple(np.round(p, 6) + 0.0) for p in f} == {tuple(np.round(p, 6) + 0.0) for p in g}


def test_cameras_back_to_back_and_far_apart_share_nothing():
    behind = transforms.from_xyz_yaw([-1.0, 0.0, 0.0], np.pi) @ T_HOME_CAM_AT_HOME
    aside = transforms.from_xyz_yaw([0.0, -40.0, 0.0], 0.0) @ T_HOME_CAM_AT_HOME
    assert shared_view(T_HOME_CAM_AT_HOME, behind, TANGENTS, 20.0) == []
    assert shared_view(T_HOME_CAM_AT_HOME, aside, TANGENTS, 20.0) == []


def test_a_fence_with_a_polygon_has_its_walls_too(root):
    from fcsv_geometry.missions.fence import Fence

    square = [(-5.0, -5.0), (20.0, -5.0), (20.0, 5.0), (-5.0, 5.0)]
    lines = mission_view.fence_lines(Fence(polygon=square), 8.0)
    alone = mission_view.fence_lines(Fence(), 8.0)
    walls = lines[len(alone) :]
    assert len(walls) == 4 + 4 + 4 and {tuple(p) for p in walls[..., :2].reshape(-1, 2)} == set(
        square
    )
    assert np.allclose(np.hypot(alone[..., 0], alone[..., 1]), Fence().radius_m)


def test_what_is_no_mission_is_refused_with_its_field():
    for text in ("name: [", "name: a\nconfigurations: []\n"):
        with pytest.raises(ConfigError, match="/mission/file"):
            mission_view.read_mission(text)


def markers_of(mission, running=None, cameras=()):
    from fcsv_tracking.ros.mission_markers import mission_markers

    return mission_markers(mission, running, dict(cameras), TANGENTS).markers


def camera(T_home_cam, stamp_s):
    from geometry_msgs.msg import PoseWithCovarianceStamped

    from fcsv_geometry.ros import conversions

    message = PoseWithCovarianceStamped(header=conversions.header(stamp_s, "home"))
    message.pose.pose = conversions.transform_to_pose(T_home_cam)
    return message


def test_home_is_drawn_before_a_mission_is_known_and_in_place_of_what_was():
    from visualization_msgs.msg import Marker

    markers = markers_of(None)
    assert markers[0].action == Marker.DELETEALL and {m.ns for m in markers[1:]} == {"home"}


@pytest.mark.parametrize("name", ["outdoor", "at_once", "sweep"])
def test_every_configuration_of_a_mission_has_its_place_and_the_running_one_stands_out(name, root):
    mission = load_mission(root / "config" / "missions" / f"{name}.yaml")
    markers = markers_of(mission, running=1)
    assert {m.header.frame_id for m in markers[1:]} == {"home"}
    words = [m for m in markers if m.ns == "planned places" and m.text]
    assert [m.text for m in words] == [str(i + 1) for i in range(len(mission.configurations))]
    assert len({(m.color.r, m.color.g) for m in words}) == 2 and words[1].color != words[0].color
    assert sum(m.ns == "sweeps" for m in markers) == sum(
        c.sweep is not None for c in mission.configurations
    )
    assert len({(m.ns, m.id) for m in markers[1:]}) == len(markers) - 1
    arrow = next(m for m in markers if m.ns == "planned places" and not m.text)
    first = camera_place(mission.configurations[0])[:3, 3]
    assert np.allclose([getattr(arrow.pose.position, a) for a in "xyz"], first)


def test_what_both_see_is_drawn_while_both_poses_are_of_one_moment(root):
    mission = load_mission(root / "config" / "missions" / "outdoor.yaml")
    own, other = (
        camera(T_HOME_CAM_AT_HOME, 10.0),
        camera(camera_place(mission.configurations[0]), 10.4),
    )
    drawn = [
        m for m in markers_of(mission, None, {"uav1": own, "uav2": other}) if m.ns == "overlap"
    ]
    assert len(drawn) == 2 and all(len(m.points) for m in drawn) and len(drawn[0].points) % 3 == 0
    lost = camera(camera_place(mission.configurations[0]), 11.5)
    for cameras in ({"uav1": own, "uav2": lost}, {"uav2": other}, {"uav1": own}):
        assert not [m for m in markers_of(mission, None, cameras) if m.ns == "overlap"]


def test_places_of_stations_are_in_home():
    text = "name: a\nconfigurations: [{axis: horizontal, baseline_m: 4.0}]\n"
    text += "stations: [{place_m: [10.0, 0.0], headings_deg: [90.0]}]\n"
    (planned,) = mission_view.planned_places(mission_view.read_mission(text))
    assert np.allclose(planned.T_home_cam[:3, 3], [14.0, 0.0, 0.0])

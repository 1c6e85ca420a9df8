# SPDX-License-Identifier: Apache-2.0
"""What a map in flight starts from, as it comes in over a link: late, twice, out of order,
broken."""

from dataclasses import replace

import numpy as np
import pytest
from support.live_pictures import CAMERA, R_OPTICAL, picture, window

from fcsv_geometry import transforms
from fcsv_stereo.errors import InputError
from fcsv_stereo.in_flight.live import Corrections, LiveSession
from fcsv_stereo.model import (
    Configuration,
    ConfigurationInput,
    ImageEntry,
    LivePicture,
    MapInput,
    MapResult,
)


@pytest.fixture
def session():
    s = LiveSession(most_pictures=20)
    s.T_home_odom = {"uav1": np.eye(4), "uav2": transforms.from_xyz_yaw([1.0, 0.0, 0.0], 0.0)}
    return s


def test_pictures_before_and_after_the_end_of_a_window_is_said(session):
    for t in np.arange(9.0, 12.0, 0.5):
        session.add_picture(picture("uav1", t))
    session.add_window(window(0, 10.0, 12.0))
    assert not session.complete(0) and "uav2" in session.missing()[0]
    with pytest.raises(InputError, match="no configuration has pictures of both"):
        session.inputs()
    session.add_picture(picture("uav2", 11.0))  # the radio was slow
    session.add_picture(picture("uav2", 12.5))  # not of the window
    assert session.complete(0) and session.missing() == []
    given = session.inputs()
    (c,) = given.configurations
    assert [p.stamp_s for p in c.references] == [10.0, 10.5, 11.0] and [
        p.stamp_s for p in c.others
    ] == [11.0]
    assert c.others[0].image.shape == (48, 64, 3) and c.others[0].camera == CAMERA.undistorted()
    assert np.allclose(c.others[0].T_home_cam[:3, 3], [1.0, 0.0, 0.0])  # T_home_odom @ T_odom_cam


def test_another_station_begins_another_map(session):
    session.add_window(window(0, 9.0, 11.0))
    session.add_window(replace(window(1, 19.0, 21.0), view="north at 0 deg"))
    assert list(session.windows) == [1]
    session.add_window(replace(window(2, 29.0, 31.0), view="north at 0 deg"))
    assert list(session.windows) == [1, 2]


def test_a_sweep_grows_while_it_is_flown(session):
    """Its window is told again as it gets longer; pictures that it had are kept though newer ones
    push them out."""
    for k in range(60):
        session.add_picture(picture("uav1", 10.0 + 0.1 * k))
        session.add_picture(picture("uav2", 10.0 + 0.1 * k, y_m=-2.0 - 0.1 * k))
        if k in (15, 30, 45, 59):
            session.add_window(window(0, 9.9, 10.0 + 0.1 * k, "sweep"))
            lengths_m = [c.configuration.baseline_m for c in session.inputs().configurations]
            assert lengths_m == sorted(lengths_m) and lengths_m[0] == pytest.approx(2.236, abs=0.01)
            assert lengths_m[-1] == pytest.approx(np.hypot(1.0, 2.0 + 0.1 * k), abs=0.15)
    assert len(lengths_m) >= 4 and 3 <= len(session.inputs(1).configurations) <= 5, (
        "the first look takes fewer"
    )


def test_what_comes_twice_counts_once_and_a_window_said_again_is_replaced(session):
    for _ in range(2):
        session.add_picture(picture("uav1", 10.0))
        session.add_picture(picture("uav2", 10.0))
    session.add_window(window(0, 9.0, 11.0))
    session.add_window(window(0, 9.0, 11.0, "again"))
    (c,) = session.inputs().configurations
    assert c.configuration.name == "again" and len(c.references) == len(c.others) == 1


def test_configurations_come_in_their_order_and_the_incomplete_one_is_named(session):
    for vehicle, t in (("uav1", 10.0), ("uav1", 20.0), ("uav2", 20.0)):
        session.add_covariance(vehicle, t, 1e-3 * np.eye(6))
    for t in (10.0, 20.0):
        session.add_picture(picture("uav1", t))
    session.add_picture(picture("uav2", 20.0))
    session.add_window(window(1, 19.0, 21.0, "second"))
    session.add_window(window(0, 9.0, 11.0, "first"))
    given = session.inputs()
    assert [c.configuration.name for c in given.configurations] == ["second"]
    assert given.warnings == ["configuration 'first': no picture of uav2 yet"]
    (c,) = given.configurations
    assert all(np.array_equal(p.covariance, 1e-3 * np.eye(6)) for p in (*c.references, *c.others))


def test_a_live_map_without_covariances_says_which_prior_serves(session):
    for vehicle in ("uav1", "uav2"):
        session.add_picture(picture(vehicle, 10.0))
    session.add_window(window(0, 9.0, 11.0))
    (line,) = session.inputs().warnings
    assert "uav1, uav2" in line and "15 cm" in line


def test_a_vehicle_whose_place_is_unknown_is_an_error_and_not_identity(session):
    del session.T_home_odom["uav2"]
    session.add_picture(picture("uav1", 10.0))
    session.add_picture(picture("uav2", 10.0))
    session.add_window(window(0, 9.0, 11.0))
    with pytest.raises(InputError, match="where uav2 is in home is not known"):
        session.inputs()


@pytest.mark.parametrize("jpeg, said", [(b"", "not a JPEG"), (b"\xff\xd8garbage", "not a JPEG")])
def test_a_broken_picture_is_named(session, jpeg, said):
    broken = picture("uav1", 10.0)
    with pytest.raises(InputError, match=said):
        LivePicture("uav1", 10.0, jpeg, broken.camera, broken.T_odom_cam).picture(np.eye(4))
    with pytest.raises(InputError, match="is 32x24, not 64x48"):
        picture("uav1", 10.0, size=(24, 32)).picture(np.eye(4))


def test_memory_is_bounded_but_windows_keep_theirs(session):
    session.add_window(window(0, 0.0, 1.0))
    for i in range(500):
        session.add_picture(picture("uav1", i * 0.1))
    assert len(session._newest["uav1"]) == 20
    assert len(session._kept[0]["uav1"]) == 11


def test_monitoring_takes_the_newest_that_belong_together(session):
    session.T_home_odom["uav3"] = np.eye(4)
    assert session.newest("uav1", ["uav2", "uav3"], 0.2) is None
    for t in (10.0, 10.5, 11.0):
        session.add_picture(picture("uav1", t))
    session.add_picture(picture("uav2", 10.45, y_m=-2.0))
    session.add_picture(picture("uav2", 11.05, y_m=-2.0))
    assert session.newest("uav1", ["uav2", "uav3"], 0.2) is None
    session.add_picture(picture("uav3", 10.6, z_m=4.0))
    given = session.newest("uav1", ["uav2", "uav3"], 0.2)
    # at 11.0 uav3 has none
    assert [c.others[0].stamp_s for c in given.configurations] == [10.45, 10.6]
    assert [c.references[0].stamp_s for c in given.configurations] == [10.5, 10.5]
    assert session.newest("uav1", ["uav2", "uav3"], 0.2, after_s=10.5) is None  # not the same again
    assert [c.configuration.axis for c in given.configurations] == ["horizontal", "vertical"]
    assert given.configurations[1].configuration.baseline_m == pytest.approx(4.0)


def watched(session, vehicle, stamps):
    for t in stamps:
        session.add_picture(
            picture(vehicle, t, y_m=-2.0 * (vehicle == "uav2"), z_m=4.0 * (vehicle == "uav3"))
        )


def test_monitoring_goes_on_with_a_pair_where_a_vehicle_drops_out(session):
    session.T_home_odom["uav3"] = np.eye(4)
    for name in ("uav1", "uav2", "uav3"):
        watched(session, name, [10.0])
    for t in (10.5, 11.0, 11.5, 12.0):
        watched(session, "uav1", [t])
        watched(session, "uav2", [t])
    given = session.newest("uav1", ["uav2", "uav3"], 0.02, after_s=9.0)
    assert given.configurations[0].references[0].stamp_s == 10.0  # it may be late
    for name in ("uav1", "uav2"):
        watched(session, name, [12.5])
    (pair,) = session.newest("uav1", ["uav2", "uav3"], 0.02, after_s=10.0).configurations
    assert (pair.references[0].stamp_s, pair.others[0].vehicle) == (12.5, "uav2")
    watched(session, "uav1", [13.0, 13.5, 14.0, 14.5, 15.0])
    # one alone sees no depth
    assert session.newest("uav1", ["uav2", "uav3"], 0.02, after_s=12.5) is None
    for name in ("uav1", "uav2", "uav3"):
        watched(session, name, [16.0])
    # it is back
    assert len(session.newest("uav1", ["uav2", "uav3"], 0.02, after_s=12.5).configurations) == 2


def test_pictures_that_are_never_of_one_instant_can_be_told(session):
    assert session.apart_s("uav1", ["uav2"], 0.0) == (0.0, float("inf"))
    watched(session, "uav1", [10.0, 10.5, 11.0])
    assert session.apart_s("uav1", ["uav2"], 9.0) == (1.0, float("inf"))
    watched(session, "uav2", [9.91, 10.41, 10.92])
    long_s, apart_s = session.apart_s("uav1", ["uav2"], 9.0)
    assert long_s == 1.0 and apart_s == pytest.approx(0.08)
    assert session.apart_s("uav1", ["uav2"], 10.6) == (0.0, pytest.approx(0.08))


def test_corrections_carry_over_to_later_pictures_of_a_vehicle_that_holds(session):
    """An odometry frame that lies wrong in home: what was found of one picture serves the next,
    which is tilted."""
    wrong = transforms.from_xyz_rpy([0.05, -0.02, 0.01], np.radians([0.1, -0.2, 0.3]))
    first, later = camera_poses()
    prior = [transforms.invert(wrong) @ T for T in (first, later)]
    images = [
        ImageEntry("a", "uav1", 0.0, np.eye(4), np.eye(4)),
        ImageEntry("b", "uav2", 0.0, first, prior[0], True),
    ]
    corrections = Corrections()
    view = picture("uav2", 1.0).picture(np.eye(4))
    given = MapInput(
        "session",
        [
            ConfigurationInput(
                Configuration("horizontal", 2.0), [view], [replace(view, T_home_cam=prior[1])]
            )
        ],
    )
    assert not corrections.know(given)
    corrections.learn(MapResult("joint", None, images, [], None, None, None))
    assert corrections.know(given)
    assert np.allclose(corrections.apply(given).configurations[0].others[0].T_home_cam, later)


def camera_poses():
    tilted = transforms.from_xyz_rpy([0.01, -2.03, 0.02], np.radians([0.4, 0.5, -0.3]))
    return transforms.from_xyz_yaw([0.0, -2.0, 0.0], 0.0) @ R_OPTICAL, tilted @ R_OPTICAL


def test_where_the_middle_picture_is_broken_its_neighbour_serves_a_first_look(session):
    whole = picture("uav2", 10.5)
    for t in (10.0, 10.5, 11.0):
        session.add_picture(picture("uav1", t))
    session.add_picture(picture("uav2", 10.0))
    session.add_picture(LivePicture("uav2", 10.5, b"no jpeg", whole.camera, whole.T_odom_cam))
    session.add_picture(picture("uav2", 11.2))
    session.add_window(window(0, 9.0, 11.5))
    given = session.inputs(1)
    (c,) = given.configurations
    assert [p.stamp_s for p in c.references] == [10.5] and [p.stamp_s for p in c.others] == [10.0]
    assert any("uav2 at 10.500 is not a JPEG" in line for line in given.warnings)
    # the delay of a map counts from here, whatever it is made of
    assert session.last_picture_s() == 11.2

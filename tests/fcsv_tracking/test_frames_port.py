# SPDX-License-Identifier: Apache-2.0
"""The port of the frames: what it gives before and after home, how often, and what it refuses."""

import numpy as np
import pytest

from fcsv_geometry import frames, transforms
from fcsv_geometry.home import OdomLink, camera_in_home
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.tracker import T265_PROFILE
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_tracking.column.camera_covariance import AgeRules
from fcsv_tracking.frames_port import BodyAt, CameraAt, FramesPort, OdometryCame, OdomsInHome

T_O1_HOME = transforms.from_xyz_yaw([2.0, 1.0, 6.0], 0.7)
T_O1_O2 = transforms.from_xyz_yaw([3.0, -4.0, 0.5], 1.1)
TRACKER = np.diag([0.01**2] * 3 + [0.002**2] * 3)


@pytest.fixture
def vehicles(root):
    return load_vehicles(root / "config/vehicles", ["uav1", "uav2"])


@pytest.fixture
def port(vehicles):
    return FramesPort(vehicles, T265_PROFILE, 10.0, AgeRules(most_age_s=100.0))


def odometry(name, stamp_s, p_m=(0.0, 0.0, 5.0), **changed):
    T_odom_body = transforms.from_xyz_yaw(p_m, 0.2)
    named = (frames.odom(name), frames.base_link(name))
    told = {"frames": named, "covariance": TRACKER.ravel().tolist(), **changed}
    return OdometryCame(name, told["frames"], stamp_s, T_odom_body, told["covariance"])


def told(port, now_s, *messages):
    """What follows from these, without the frames that come by themselves."""
    for message in messages:
        port.receive(now_s, message)
    return [o for o in port.step(now_s) if not isinstance(o, OdomsInHome)]


def home(stamp_s=0.0):
    link = OdomLink("uav1", "uav2", T_O1_O2, np.diag([0.02**2] * 3 + [0.003**2]))
    return tm.CalibrationFound(stamp_s, [link]), tm.HomeFound(stamp_s, "uav1", T_O1_HOME)


def test_before_home_bodies_alone_are_given(port):
    (body,) = told(port, 1.0, odometry("uav2", 10.0))
    assert isinstance(body, BodyAt) and (body.vehicle, body.stamp_s) == ("uav2", 10.0)


def test_a_camera_in_home_and_how_well_it_is_known(port, vehicles):
    told(port, 0.0, *home(10.0))
    came = odometry("uav2", 10.0)
    body, camera, said = told(port, 1.0, came)
    T_home_odom = transforms.invert(T_O1_HOME) @ T_O1_O2
    T_body_cam = vehicles["uav2"].T_body_cam
    assert isinstance(body, BodyAt) and isinstance(camera, CameraAt)
    assert np.allclose(camera.T_home_cam, camera_in_home(T_home_odom, came.T_odom_body, T_body_cam))
    sigma_m = np.sqrt(np.diag(camera.covariance)[:3])
    assert (sigma_m > 0.02).all(), "link and tracker are both in it"
    assert said.problems == {"uav2": ""} and said.values["uav2 flown since calibration [m]"] == "0"


def test_the_reference_has_its_place_before_a_calibration(port):
    told(port, 0.0, home()[1])
    kinds = [type(o) for o in told(port, 1.0, odometry("uav1", 10.0), odometry("uav2", 10.0))]
    assert kinds == [BodyAt, CameraAt, tm.Diagnosis, BodyAt]


def test_no_more_of_each_than_is_wanted(port):
    given = [told(port, k / 30.0, odometry("uav1", 10.0 + k / 30.0)) for k in range(30)]
    assert sum(len(out) for out in given) == pytest.approx(10, abs=1)


def test_an_old_calibration_and_a_long_way_are_said(port):
    told(port, 0.0, *home(10.0))
    *_, fresh = told(port, 1.0, odometry("uav2", 11.0))
    *_, old = told(port, 200.0, odometry("uav2", 211.0))
    assert fresh.problems["uav2"] == "" and "calibrate again" in old.problems["uav2"]
    told(port, 201.0, *home(211.0))
    *_, again = told(port, 202.0, odometry("uav2", 212.0))
    assert again.problems["uav2"] == ""


def test_odometry_frames_in_home_come_ten_times_a_second(port):
    told(port, 0.0, *home())
    out = [o for k in range(100) for o in port.step(1.0 + 0.01 * k)]
    assert 9 <= len(out) <= 11 and set(out[-1].T_home_odom) == {"uav1", "uav2"}


@pytest.mark.parametrize(
    "changed, kinds, words",
    [
        ({"frames": ("map", "uav2/base_link")}, [], "has frames"),
        ({"covariance": [np.nan] * 36}, [BodyAt], "its covariance is none"),
        ({"covariance": (-TRACKER).ravel()}, [BodyAt], "its covariance is none"),
    ],
)
def test_what_is_wrong_is_dropped_and_named(port, changed, kinds, words):
    told(port, 0.0, *home())
    *given, dropped = told(port, 1.0, odometry("uav2", 10.0, **changed))
    assert [type(o) for o in given] == kinds
    assert (
        isinstance(dropped, tm.Dropped) and dropped.why.startswith("uav2") and words in dropped.why
    )


def test_what_it_does_not_know_is_refused(port):
    with pytest.raises(TypeError, match="take no str"):
        port.receive(0.0, "a text")

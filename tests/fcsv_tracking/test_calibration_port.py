# SPDX-License-Identifier: Apache-2.0
"""The process of calibration and home without ROS: a simulated column flies before its port."""

import doctest
import re

import numpy as np
import pytest
from support.simulated_column import Column

from fcsv_geometry import transforms
from fcsv_geometry.home import home_of
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_tracking.column import agreement
from fcsv_tracking.column.calibration import CalibrationRules
from fcsv_tracking.column.calibration_port import CalibrateColumn, CalibrationPort, HomeWanted
from fcsv_tracking.devices.clocks import ClockOffset, VehicleClock

START_S = 500.0  # of the port's clock; the vehicles' stamps begin at 0


class Flown:
    """A port that hears a column of two; ``spoil`` may change a message, or drop it (None)."""

    def __init__(self, spoil=lambda m: m):
        self.column, self.spoil = Column(1), spoil
        vehicles = {v.name: v for v in (self.column.front, self.column.back)}
        self.port = CalibrationPort(vehicles, CalibrationRules())
        self.now_s, self.out = START_S, []
        for name in vehicles:
            self.hear(tm.OdometryEpoch(name, "", 7, "start"))

    def hear(self, message):
        message = self.spoil(message)
        if message is not None:
            self.port.receive(self.now_s, message)

    def fly(self, detections):
        """All poses and pictures, each when it is taken, then half a second of poses."""
        for k in range(int((detections[-1].stamp_s + 0.5) * 30)):
            stamp_s = k / 30.0
            self.now_s = START_S + stamp_s
            for name, T in zip(("uav1", "uav2"), self.column.odometry(stamp_s)):
                self.hear(tm.VehicleOdometry(name, "", stamp_s, T, (0.0, 0.0, 0.0)))
            for d in [d for d in detections if stamp_s - 1 / 30.0 < d.stamp_s <= stamp_s]:
                tag = tm.SeenTag(self.column.front.tag_id, d.size_m, d.corners_normalized, None)
                self.hear(tm.SeenTags("uav2", "", d.stamp_s, d.T_odom_cam, d.focal_px, [tag]))
            self.out += self.port.step(self.now_s)
        return [o for o in self.out if not isinstance(o, tm.Dropped)]


def calibrated(spoil=lambda m: m):
    flown = Flown(spoil)
    assert flown.port.serve(START_S, CalibrateColumn(())) == [] and flown.port.collects
    return flown, flown.fly(flown.column.detections(9.0))


def test_a_column_is_calibrated_and_home_is_set_in_it():
    flown, (found, epochs, reply) = calibrated()
    assert reply.done and "uav2 against uav1" in reply.text and not flown.port.collects
    assert epochs == tm.EpochsFound(tm.CALIBRATION, found.stamp_s, {"uav1": 7, "uav2": 7})
    error_m, error_deg = flown.column.relative_pose_error(found.links[0].T_parent_child)
    assert error_m < 0.02 and error_deg < 0.35  # of ten seeds (test_calibration) the worst
    home, epochs, reply = flown.port.serve(flown.now_s, HomeWanted(""))
    assert reply.done and epochs.epochs == {"uav1": 7} and home.reference == "uav1"
    T_odom_body = flown.column.odometry(home.stamp_s)[0]
    there = home_of(T_odom_body @ flown.column.front.T_body_cam)
    # noise of 3 mm and 0.05 deg, twice, 5 sigma
    np.testing.assert_allclose(home.T_odom_home, there, atol=0.02)


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda m: None if isinstance(m, tm.SeenTags) else m, "does not see uav1's tag"),
        (
            lambda m: (
                None
                if isinstance(m, tm.VehicleOdometry) and m.vehicle == "uav1" and m.stamp_s > 3.0
                else m
            ),
            "have no pose of uav1 at their stamp",
        ),
    ],
)
def test_what_is_missing_is_named(spoil, words):
    _, outputs = calibrated(spoil)
    [reply] = outputs
    assert not reply.done and words in reply.text


def test_an_odometry_that_begins_anew_meanwhile_is_named():
    flown = Flown()
    flown.port.serve(START_S, CalibrateColumn(()))
    flown.port.receive(START_S, tm.OdometryEpoch("uav2", "", 8, "a gap"))
    [reply] = flown.fly(flown.column.detections(9.0))
    assert not reply.done and "the odometry of uav2 began anew meanwhile" in reply.text


def test_clocks_that_differ_are_named():
    flown = Flown()
    flown.hear(VehicleClock("uav1", ClockOffset(0.0, 0.0, 0.001)))
    flown.hear(VehicleClock("uav2", ClockOffset(0.0, 0.3, 0.001)))
    flown.port.serve(START_S, CalibrateColumn(()))
    [reply] = flown.fly(flown.column.detections(9.0))
    assert not reply.done and "clocks of uav1 and uav2 differ by -0.300 s" in reply.text


@pytest.mark.parametrize(
    "request_, phase, words",
    [
        (CalibrateColumn(("uav1",)), "", "needs two known vehicles"),
        (CalibrateColumn(("uav1", "uav9")), "", "needs two known vehicles"),
        (
            CalibrateColumn(()),
            "CONFIGURATIONS",
            "while the mission flies the vehicles (CONFIGURATIONS)",
        ),
        (HomeWanted("uav9"), "", "'uav9' is not a vehicle here"),
        (HomeWanted("uav1"), "", "uav1 is not calibrated yet"),
        (HomeWanted("uav1"), "GUIDED", "a new home is refused"),
    ],
)
def test_what_cannot_be_is_refused_at_once(request_, phase, words):
    flown = Flown()
    flown.hear(tm.MissionPhase(phase))
    [reply] = flown.port.serve(START_S, request_)
    assert not reply.done and words in reply.text and not flown.port.collects


# ---- in flight -----------------------------------------------------------------------------------


def in_flight(moved_m):
    """Calibrated, then again in flight, where uav2's tracker has gone astray by ``moved_m``."""
    flown, (found, *_) = calibrated()
    flown.port.serve(flown.now_s, HomeWanted("uav1"))
    flown.hear(tm.MissionPhase("CONFIGURATIONS"))
    begun_s = flown.now_s - START_S + 1.0
    assert flown.port.serve(flown.now_s, CalibrateColumn((), in_flight=True)) == []
    T_off = transforms.from_xyz_yaw([moved_m, 0.0, 0.0], 0.0)
    flown.out = []
    for k in range(int(10.0 * 30)):
        stamp_s = begun_s + k / 30.0
        flown.now_s = START_S + stamp_s
        for name, T in zip(("uav1", "uav2"), flown.column.odometry(stamp_s)):
            T = T_off @ T if name == "uav2" else T
            flown.hear(tm.VehicleOdometry(name, "", stamp_s, T, (0.0, 0.0, 0.0)))
        if k % 6 == 0:
            d = flown.column.detection(stamp_s)
            tag = tm.SeenTag(flown.column.front.tag_id, d.size_m, d.corners_normalized, None)
            T_odom_cam = T_off @ d.T_odom_cam
            flown.hear(tm.SeenTags("uav2", "", stamp_s, T_odom_cam, d.focal_px, [tag]))
        flown.out += flown.port.step(flown.now_s)
    return found, [o for o in flown.out if not isinstance(o, tm.Dropped)]


def test_a_calibration_in_flight_that_agrees_is_taken_over():
    before, (found, epochs, reply) = in_flight(0.0)
    assert reply.done and not reply.drifted and "off uav1 (" in reply.text
    assert found.stamp_s > before.stamp_s + 8.0 and set(epochs.epochs) == {"uav1", "uav2"}
    _, (moved, _, _) = in_flight(0.06)
    step_m = moved.links[0].T_parent_child[:3, 3] - found.links[0].T_parent_child[:3, 3]
    assert np.linalg.norm(step_m) == pytest.approx(0.06, abs=0.02), "what drifted is put right"


def test_one_that_differs_by_more_than_is_known_of_the_trackers_is_a_drift():
    _, [reply] = in_flight(0.6)
    assert not reply.done and reply.drifted
    assert re.search(r"uav2 is 0.(5|6)\d m and .* off uav1 .*: a tracker drifts", reply.text)


def test_examples():
    result = doctest.testmod(agreement)
    assert result.attempted and not result.failed


def test_in_flight_it_is_for_stations_alone_and_needs_one_before():
    flown = Flown()
    [reply] = flown.port.serve(START_S, CalibrateColumn((), in_flight=True))
    assert not reply.done and "in flight is for stations" in reply.text
    flown.hear(tm.MissionPhase("CONFIGURATIONS"))
    assert flown.port.serve(START_S, CalibrateColumn((), in_flight=True)) == []
    [reply] = flown.fly(flown.column.detections(9.0))
    assert not reply.done and not reply.drifted and "not known here" in reply.text


def test_a_second_calibration_waits_for_the_first():
    flown = Flown()
    assert flown.port.serve(START_S, CalibrateColumn(())) == []
    [reply] = flown.port.serve(START_S, CalibrateColumn(()))
    assert not reply.done and "already running" in reply.text


def test_home_is_not_set_by_odometry_that_came_long_ago():
    flown, _ = calibrated()
    [reply] = flown.port.serve(flown.now_s + 1.0, HomeWanted("uav1"))
    assert not reply.done and "1.0 s old" in reply.text


def test_what_a_port_does_not_know_is_an_error():
    port = Flown().port
    with pytest.raises(TypeError, match="does not hear Reply"):
        port.receive(0.0, tm.Reply(True, ""))
    with pytest.raises(TypeError, match="does not serve Reply"):
        port.serve(0.0, tm.Reply(True, ""))

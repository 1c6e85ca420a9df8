# SPDX-License-Identifier: Apache-2.0
"""Drivers that stop are found, remedied from mild to strong, and told; where cameras sit on USB."""

import doctest

import pytest

from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError
from fcsv_tracking.devices import usb_bus
from fcsv_tracking.devices.driver_watch import DeviceRules, DriverWatch, Level, Remedy
from fcsv_tracking.devices.usb_bus import UsbDevice, findings, read_devices

RULES = DeviceRules(
    "t265/odom/sample", 150.0, 0.5, starts_s=10.0, reset="t265/reset", nodes=["t265/manager"]
)


class Bench:
    """A watch at 10 Hz of a device that sends at 200 Hz while it works."""

    def __init__(self, rules=RULES):
        self.now_s, self.watch, self.remedies = 100.0, DriverWatch("T265", rules, 100.0), []

    def run(self, seconds, rate_hz=0.0):
        for i in range(round(seconds * 1000)):
            self.now_s += 1e-3
            if rate_hz and i % round(1000 / rate_hz) == 0:
                self.watch.on_message(self.now_s)
            if i % 100 == 99:
                remedy = self.watch.step(self.now_s)
                if remedy is not None:
                    self.remedies.append((round(self.now_s, 1), remedy))

    @property
    def status(self):
        return self.watch.status(self.now_s)


def test_a_device_that_sends_is_left_alone():
    bench = Bench()
    assert bench.status == (Level.WARN, "T265 has not begun to send t265/odom/sample")
    bench.run(20.0, 200.0)
    assert bench.remedies == [] and bench.status == (Level.OK, "T265 sends at 200 Hz")


def test_a_device_that_stops_is_remedied_within_the_second_from_mild_to_strong_and_never_given_up():
    bench = Bench()
    bench.run(10.0, 200.0)
    bench.run(45.0)
    assert bench.remedies == [
        (110.5, Remedy.RESET),
        (120.5, Remedy.RESTART),
        (130.5, Remedy.KILL),
        (140.5, Remedy.RESET),
        (150.5, Remedy.RESTART),
    ]
    assert bench.status == (Level.ERROR, "T265 is silent for 45 s; its driver is restarted (try 5)")
    bench.run(4.0, 200.0)
    said = "T265 sends at 200 Hz; it was silent 1 times, last remedy: its driver is restarted"
    assert bench.status == (Level.WARN, said)
    bench.run(2.0)
    assert bench.remedies[-1][1] is Remedy.KILL  # it spoke for a moment only
    bench.run(12.0, 200.0)
    bench.run(1.0)
    assert bench.remedies[-1][1] is Remedy.RESET and len(bench.remedies) == 7


def test_a_driver_has_its_time_to_come_up():
    bench = Bench()
    bench.run(9.8)
    assert bench.remedies == [] and bench.status[0] is Level.WARN
    bench.run(0.4)
    assert bench.remedies == [(110.0, Remedy.RESET)] and "silent since the start" in bench.status[1]


def test_a_device_of_somebody_else_is_told_and_not_touched():
    bench = Bench(DeviceRules("odom", 20.0, 0.5))
    bench.run(10.0, 50.0)
    bench.run(20.0)
    assert bench.remedies == []
    assert bench.status == (
        Level.ERROR,
        "T265 is silent for 20 s; nobody here can restart its driver",
    )


def test_a_device_that_is_slow_is_told_and_not_touched():
    bench = Bench()
    bench.run(10.0, 50.0)
    assert bench.remedies == [] and bench.status == (
        Level.WARN,
        "T265 sends at 50 Hz, 150 are expected",
    )


@pytest.mark.parametrize(
    "wrong, said",
    [
        ({"least_hz": 0.0}, "least_hz"),
        ({"silent_s": -1.0}, "silent_s"),
        ({"starts_s": 0}, "starts_s"),
        ({"speed": 1}, "unknown key"),
        ({"topic": 3}, "topic"),
    ],
)
def test_wrong_rules_are_refused_by_name(wrong, said):
    with pytest.raises(ConfigError, match=said):
        config.from_mapping({"topic": "a", "least_hz": 1.0, **wrong}, DeviceRules, "test")


# ---- USB -----------------------------------------------------------------------------------------

WANTED = {
    "camera": ["8086:0b07", "8086:0ad6"],
    "odometry": ["8087:0b37", "03e7:2150"],
    "somebody": [],
}


def test_where_cameras_sit_is_read_as_linux_lists_it(tmp_path):
    assert not doctest.testmod(usb_bus).failed
    for name, vendor, product, speed in (
        ("2-1", "8086", "0b07", "5000"),
        ("2-2", "8087", "0b37", "5000"),
        ("usb2", "1d6b", "0003", "5000"),
        ("1-4", "046d", "c52b", "12"),
    ):
        (tmp_path / name).mkdir()
        for file, text in (("idVendor", vendor), ("idProduct", product), ("speed", speed)):
            (tmp_path / name / file).write_text(text + "\n")
    (tmp_path / "2-1:1.0").mkdir()
    (tmp_path / "3-1").mkdir()  # pulled in this moment
    devices = read_devices(tmp_path)
    assert [d.port for d in devices] == ["1-4", "2-1", "2-2"]
    assert findings(devices, WANTED) == {
        "camera": "shares USB bus 2 with odometry",
        "odometry": "shares USB bus 2 with camera",
    }
    assert read_devices(tmp_path / "absent") == []


@pytest.mark.parametrize(
    "camera, odometry, said",
    [
        (("2-1", 5000.0), ("4-1", 5000.0), {}),
        (("2-1", 5000.0), None, {"odometry": "is not on USB"}),
        (
            ("2-1.1", 5000.0),
            ("2-1.4", 5000.0),
            {"camera": "shares hub 2-1 with odometry", "odometry": "shares hub 2-1 with camera"},
        ),
        (("1-2", 480.0), ("2-2", 5000.0), {"camera": "runs at 480 Mbit/s, not as USB 3"}),
    ],
)
def test_two_cameras_on_one_bus_are_named(camera, odometry, said):
    devices = [UsbDevice(camera[0], "8086:0b07", camera[1])]
    devices += [UsbDevice(odometry[0], "8087:0b37", odometry[1])] if odometry else []
    assert findings(devices, WANTED) == said

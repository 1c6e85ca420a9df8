# SPDX-License-Identifier: Apache-2.0
"""The driver of the real servos against a bus that speaks their protocol, and the simulated gimbal
beside it."""

import random
import time
from contextlib import contextmanager, nullcontext
from itertools import chain, repeat

import numpy as np
import pytest
from support.waiting import within

from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.vehicles.vehicle import Mount
from fcsv_sim.gimbal.dynamixel_bus import SimulatedBus
from fcsv_sim.gimbal.gimbal import RESOLUTION_RAD, MountErrors, ServoErrors, SimulatedGimbal
from fcsv_tracking.gimbal import mx12w
from fcsv_tracking.gimbal.config import GimbalServo
from fcsv_tracking.gimbal.dynamixel import DynamixelBus, DynamixelGimbal
from fcsv_tracking.gimbal.geometry import Angles, GimbalGeometry
from fcsv_tracking.gimbal.servos import ServoError

GEOMETRY = GimbalGeometry(Mount((0.0, 0.0, 0.4)))
SERVO = GimbalServo(pan_id=1, tilt_id=2, pan_zero=2048, tilt_zero=1024, tilt_sign=-1)
EXACT = ServoErrors(
    speed_degps=300.0,
    acceleration_degps2=1500.0,
    stop_deg=0.0,
    nonlinearity_deg=0.0,
    reading_jitter_s=0.0,
    delay_jitter_s=0.0,
)
until = within(10.0)


PATIENT_S = 60.0  # a machine may be so busy that nothing crosses a pseudo terminal for 15 s


@pytest.fixture
def line():
    with SimulatedBus([1, 2], errors=EXACT) as bus:
        driver = DynamixelBus(bus.port, answer_s=PATIENT_S)
        yield bus, driver
        driver.close()


@contextmanager
def impatient(driver):
    """Where no answer comes it need not be waited for long; where one does come it is."""
    driver._port._answer_s = 0.1
    try:
        yield
    finally:
        driver._port._answer_s = PATIENT_S


class Noise:
    """In place of the serial line: whatever is asked, the answer is noise, or nearly what a servo
    says."""

    def __init__(self, rng):
        self._rng, self._heard, self.answers = rng, b"", 0

    def reset_input_buffer(self):
        self._heard = b""

    flush = reset_input_buffer

    def write(self, packet):
        self._heard = self._answer(packet[2])
        self.answers += 1
        return len(packet)

    def read(self, size):
        heard, self._heard = self._heard[:size], self._heard[size:]
        return heard

    def _answer(self, number):
        rng = self._rng
        data = rng.getrandbits(8 * 40).to_bytes(40, "little")[: rng.choice([0, 1, 2, 7, 8, 9, 40])]
        body = (
            bytes(
                [
                    rng.choice([number] * 3 + [rng.randrange(256)]),
                    rng.choice([len(data) + 2] * 3 + [0, 1, 2, 255]),
                    rng.choice([0, 0, 0, rng.randrange(256)]),
                ]
            )
            + data
        )
        whole = b"\xff\xff" + body + bytes([~sum(body) & 0xFF])
        at = rng.randrange(len(whole))
        return rng.choice(
            [
                whole,
                whole,
                whole[:at],
                whole[at:] + whole,
                data,
                b"\xff" * at,
                b"",
                whole[:at] + bytes([whole[at] ^ 1 << rng.randrange(8)]) + whole[at + 1 :],
            ]
        )


class TestDynamixel:
    def test_it_turns_and_says_where_it_is(self, line):
        bus, driver = line
        gimbal = DynamixelGimbal(driver, SERVO, time.time)
        goal = Angles(0.5, 0.2)
        bus.servos[2].axis.angle_rad = bus.servos[2].axis._goal_rad = (1024 - 2048) * mx12w.TICK_RAD
        gimbal.turn(goal)
        until(
            lambda: np.allclose(gimbal.read().angles, goal, atol=mx12w.TICK_RAD),
            what="the gimbal at its goal",
        )
        assert bus.servos[1].get(mx12w.GOAL_POSITION) == 2048 + round(0.5 / mx12w.TICK_RAD)
        assert bus.servos[2].get(mx12w.GOAL_POSITION) == 1024 - round(0.2 / mx12w.TICK_RAD)
        begun_s = time.time()
        reading = gimbal.read()
        assert begun_s <= reading.stamp_s <= time.time()
        assert "35 C, 12.0 V" in gimbal.health()["pan servo"]

    def test_profile_and_torque_are_written(self, line):
        bus, driver = line
        gimbal = DynamixelGimbal(
            driver, SERVO, time.time, speed_degps=110.0, acceleration_degps2=858.3
        )
        for servo in bus.servos.values():
            assert servo.get(mx12w.MOVING_SPEED) == 20 and servo.get(mx12w.GOAL_ACCELERATION) == 100
            assert servo.get(mx12w.TORQUE_ENABLE) == 1
        gimbal.close()
        until(lambda: not any(s.axis.torque for s in bus.servos.values()), what="torque off")

    @pytest.mark.parametrize(
        "fault, message",
        [
            ("silent", "servo 1 does not answer; check its id, power, cable and baud rate"),
            ("wrong id", "servo 1 does not answer"),
            ("checksum", "answers of servo 1 are damaged"),
            ("garbage", "answers of servo 1 are damaged|servo 1 does not answer"),
        ],
    )
    def test_faults_of_the_line_are_named_and_pass(self, line, fault, message):
        bus, driver = line
        gimbal = DynamixelGimbal(driver, SERVO, time.time)
        bus.servos[1].fault = fault
        waits = nullcontext() if fault == "checksum" else impatient(driver)
        with pytest.raises(ServoError, match=message), waits:
            gimbal.read()
        assert driver.failures[1] == 3 and gimbal.health()["pan lost answers"] == "3"
        bus.servos[1].fault = None
        assert gimbal.read().angles.pan_rad == pytest.approx(0.0, abs=mx12w.TICK_RAD)

    @pytest.mark.parametrize(
        "bit, message",
        [
            (0x20, "overloaded: free the gimbal"),
            (0x04, "overheated"),
            (0x01, "12 V supply"),
            (0x24, "overheated.*overloaded"),
        ],
    )
    def test_what_a_servo_says_is_wrong(self, line, bit, message):
        bus, driver = line
        gimbal = DynamixelGimbal(driver, SERVO, time.time)
        bus.servos[2].error = bit
        with pytest.raises(ServoError, match=f"servo 2: .*{message}"):
            gimbal.read()

    def test_one_lost_answer_is_asked_for_again(self, line):
        bus, driver = line
        gimbal = DynamixelGimbal(driver, SERVO, time.time)
        answer, answered = bus._answer, []

        def lossy(number, servo, error, data):
            answered.append(number)
            if len(answered) > 1:
                answer(number, servo, error, data)

        wait, waits_s = driver._port.setPacketTimeout, chain([0.1], repeat(PATIENT_S))

        def impatient_once(length):
            driver._port._answer_s = next(waits_s)
            wait(length)

        bus._answer, driver._port.setPacketTimeout = lossy, impatient_once
        gimbal.read()
        assert driver.failures[1] == 1 and answered == [1, 1, 2]

    def test_ten_thousand_answers_of_noise_end_nothing(self, line):
        bus, driver = line
        gimbal = DynamixelGimbal(driver, SERVO, time.time)
        servos, noise = driver._port.ser, Noise(random.Random(1))
        driver._port.ser, driver._port.isPacketTimeout = noise, lambda: True  # no more bytes come
        taken = 0
        while noise.answers < 10_000:
            try:
                assert np.isfinite(gimbal.read().angles).all()
                taken += 1
            except ServoError as error:
                assert "servo 1" in str(error) or "servo 2" in str(error)
        assert 0 < taken < 1_000
        driver._port.ser = servos
        del driver._port.isPacketTimeout
        assert gimbal.read().angles.pan_rad == pytest.approx(0.0, abs=mx12w.TICK_RAD)

    @pytest.mark.parametrize("length", [0, 3, 7, 9])
    def test_an_answer_of_another_length_is_damaged(self, line, length):
        """Taken as it is, its checksum was read as data, or the reading node ended."""
        bus, driver = line
        gimbal = DynamixelGimbal(driver, SERVO, time.time)
        answer = bus._answer
        bus._answer = lambda number, servo, error, data: answer(
            number, servo, error, (data + b"\0")[:length]
        )
        with pytest.raises(ServoError, match="answers of servo 1 are damaged"):
            gimbal.read()

    def test_a_servo_that_is_missing_or_another(self, line):
        bus, driver = line
        with pytest.raises(ServoError, match="servo 7 does not answer"), impatient(driver):
            DynamixelGimbal(driver, GimbalServo(pan_id=7, tilt_id=2), time.time)
        bus.servos[1].put(mx12w.MODEL, 29)
        with pytest.raises(ServoError, match="servo 1 is of model 29, not an MX-12W"):
            DynamixelGimbal(driver, SERVO, time.time)

    @pytest.mark.parametrize("low, high", [(0, 0), (4095, 4095)])
    def test_wheel_and_multi_turn_mode_are_refused(self, line, low, high):
        bus, driver = line
        bus.servos[2].put(mx12w.CW_LIMIT, low)
        bus.servos[2].put(mx12w.CCW_LIMIT, high)
        with pytest.raises(ServoError, match="servo 2 is in wheel or multi-turn mode"):
            DynamixelGimbal(driver, SERVO, time.time)

    def test_goals_beyond_its_limits_are_never_sent(self, line):
        bus, driver = line
        gimbal = DynamixelGimbal(driver, SERVO, time.time)
        for bad, message in (
            (Angles(0.0, 2.0), "servo 2: 114.6 deg is tick -280"),
            (Angles(np.nan, 0.0), "servo 1"),
        ):
            with pytest.raises(ServoError, match=message):
                gimbal.turn(bad)
        assert bus.servos[1].get(mx12w.GOAL_POSITION) == 2048

    def test_unplugged(self, line):
        bus, driver = line
        gimbal = DynamixelGimbal(driver, SERVO, time.time)
        bus.close()
        with pytest.raises(ServoError):
            gimbal.read()
        with pytest.raises(ServoError):
            gimbal.turn(Angles(0.1, 0.1))

    def test_no_port_and_no_baud_rate(self, line):
        with pytest.raises(ServoError, match="cannot be opened"):
            DynamixelBus("/dev/there-is-no-such-port")
        with pytest.raises(ServoError, match="baud rate 12345 is none"):
            DynamixelBus(line[0].port, baud=12345)


class TestBus:
    """What the simulated servos answer to packets that the driver never sends."""

    def ask(self, bus, packet):
        import os

        fd = os.open(bus.port, os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(fd, packet)
            return os.read(fd, 64)
        finally:
            os.close(fd)

    @pytest.mark.parametrize(
        "packet, error",
        [
            (b"\xff\xff\x01\x04\x02\x24\x02\x00", 0x10),
            (b"\xff\xff\x01\x02\x05\xf7", 0x40),
            (b"\xff\xff\x01\x05\x03\x1e\xff\xff\xda", 0x02),
        ],
    )
    def test_error_bits(self, packet, error):
        with SimulatedBus([1]) as bus:
            answer = self.ask(bus, b"noise" + packet)
            assert answer[:3] == b"\xff\xff\x01" and answer[4] == error
            assert answer[-1] == ~sum(answer[2:-1]) & 0xFF


class TestSimulatedGimbal:
    def gimbal(self, errors=EXACT, mount=None):
        self.now_s = 100.0
        return SimulatedGimbal(
            GEOMETRY, 1, lambda: self.now_s, errors, mount or MountErrors(0.0, 0.0)
        )

    def run(self, gimbal, seconds):
        for _ in range(int(round(seconds / 0.005))):
            self.now_s += 0.005
            gimbal.advance()

    def test_it_waits_then_turns_with_ramps_and_stands(self):
        gimbal = self.gimbal()
        gimbal.turn(Angles(0.5, 0.35))
        self.run(gimbal, 0.015)
        assert gimbal.still
        self.run(gimbal, 0.05)
        assert not gimbal.still
        # 0.5 rad: 0.2 s up to 300 deg/s is 30 degrees: ramps alone, 2 sqrt(way / ramp) = 0.276 s
        self.run(gimbal, 0.18)
        assert not gimbal.still
        self.run(gimbal, 0.08)
        assert gimbal.still and gimbal.read().angles == pytest.approx(
            (0.5, 0.35), abs=0.51 * RESOLUTION_RAD
        )

    def test_it_never_turns_faster_than_it_can(self):
        gimbal = self.gimbal()
        gimbal.turn(Angles(2.0, 0.0))
        rates = []
        for _ in range(120):
            self.run(gimbal, 0.005)
            rates.append(gimbal.servos[0].rate_radps)
        assert np.degrees(max(rates)) == pytest.approx(300.0, rel=1e-6)
        assert np.degrees(np.abs(np.diff(rates)).max()) <= 1500.0 * 0.005 + 1e-6

    def test_readings_are_ticks_and_the_truth_is_not(self):
        gimbal = self.gimbal(ServoErrors())
        gimbal.turn(Angles(0.3, 0.1))
        self.run(gimbal, 1.0)
        reading = gimbal.read().angles
        assert reading.pan_rad / RESOLUTION_RAD == pytest.approx(
            round(reading.pan_rad / RESOLUTION_RAD), abs=1e-9
        )
        true = gimbal.angles_at(self.now_s)
        assert 0.0 < abs(true.pan_rad - reading.pan_rad) < np.radians(0.05 + 0.02 + 0.045)

    def test_truth_of_the_last_seconds_alone(self):
        gimbal = self.gimbal()
        gimbal.turn(Angles(1.0, 0.0))
        self.run(gimbal, 3.0)
        assert gimbal.angles_at(self.now_s - 1.0).pan_rad == pytest.approx(1.0, abs=RESOLUTION_RAD)
        for stamp_s in (self.now_s - 2.5, self.now_s + 0.1):
            with pytest.raises(PoseUnavailable):
                gimbal.angles_at(stamp_s)

    def test_without_torque_it_stays(self):
        gimbal = self.gimbal()
        gimbal.close()
        gimbal.turn(Angles(1.0, 0.0))
        self.run(gimbal, 1.0)
        assert gimbal.angles_at(self.now_s).pan_rad == 0.0

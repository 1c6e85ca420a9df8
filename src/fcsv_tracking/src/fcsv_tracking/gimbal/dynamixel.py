# SPDX-License-Identifier: Apache-2.0
"""The real gimbal: two MX-12W on a serial bus, through Robotis' dynamixel-sdk (protocol 1.0)."""

import termios
import threading
from collections import Counter
from typing import Callable, Dict, List, Tuple

import dynamixel_sdk as sdk
import numpy as np
import serial

from fcsv_tracking.gimbal import mx12w
from fcsv_tracking.gimbal.config import GimbalServo
from fcsv_tracking.gimbal.geometry import Angles
from fcsv_tracking.gimbal.mx12w import Register
from fcsv_tracking.gimbal.servos import GimbalReading, GimbalServos, ServoError

_ATTEMPTS = 3
_LINE = (serial.SerialException, OSError, termios.error)  # what a line that is gone raises


class _Port(sdk.PortHandler):
    """The driver's own limit, 34 ms, is too short where other processes use the processor."""

    def __init__(self, port: str, answer_s: float):
        super().__init__(port)
        self._answer_s = answer_s

    def setPacketTimeout(self, packet_length: int) -> None:
        self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + 1e3 * self._answer_s)


class DynamixelBus:
    """One serial port with any number of servos; usable by several threads. Lost or damaged answers are asked for again
    (``failures`` counts them); an error byte is an error at once. ``answer_s``: how long an answer may take."""

    def __init__(self, port: str, baud: int = 1000000, answer_s: float = 0.05):
        self.failures: Counter = Counter()
        self._name, self._lock = port, threading.Lock()
        self._port, self._packets = _Port(port, answer_s), sdk.PacketHandler(1.0)
        self._port.baudrate = baud
        try:
            opened = self._port.openPort()
        except _LINE as error:
            raise ServoError(
                f"{port}: cannot be opened ({error}); is the USB2Dynamixel plugged in and yours?"
            ) from error
        if not opened:
            raise ServoError(f"{port}: baud rate {baud} is none that the driver knows; MX servos come with 1000000")

    def read(self, number: int, register: Register) -> List[int]:
        """Bytes of a register. Raises ServoError."""
        return self._ask(number, lambda: self._packets.readTxRx(self._port, number, register.address, register.length))

    def write(self, number: int, register: Register, value: int) -> None:
        """Raises ServoError."""
        raw = _bytes(value, register)

        def send() -> Tuple[List[int], int, int]:
            return ([], *self._packets.writeTxRx(self._port, number, register.address, register.length, raw))

        self._ask(number, send)

    def write_all(self, register: Register, values: Dict[int, int]) -> None:
        """One packet for several servos, which start together and do not answer. Raises ServoError."""
        raw = [b for number, value in values.items() for b in (number, *_bytes(value, register))]
        with self._lock:
            try:
                self._port.is_using = False
                result = self._packets.syncWriteTxOnly(self._port, register.address, register.length, raw, len(raw))
            except _LINE as error:
                raise ServoError(f"{self._name}: {error}; was it unplugged?") from error
        if result != sdk.COMM_SUCCESS:
            raise ServoError(f"{self._name}: {self._packets.getTxRxResult(result)}")

    def close(self) -> None:
        with self._lock:
            if self._port.is_open:
                self._port.closePort()

    def _ask(self, number: int, send: Callable[[], Tuple[List[int], int, int]]) -> List[int]:
        for _ in range(_ATTEMPTS):
            with self._lock:
                data, result, error = self._exchange(send)
            if result == sdk.COMM_SUCCESS:
                break
            self.failures[number] += 1
        if result in (sdk.COMM_RX_TIMEOUT, sdk.COMM_TX_FAIL):
            raise ServoError(f"{self._name}: servo {number} does not answer; check its id, power, cable and baud rate")
        if result != sdk.COMM_SUCCESS:
            raise ServoError(f"{self._name}: answers of servo {number} are damaged; two with one id, or a bad cable?")
        if error:
            raise ServoError(f"{self._name}: servo {number}: {'; '.join(mx12w.errors(error))}")
        return list(data)

    def _exchange(self, send):
        try:
            self._port.is_using = False  # an exception in the last exchange leaves it set
            self._port.ser.reset_input_buffer()  # an answer that came too late belongs to another question
            return send()
        except (*_LINE, TypeError) as error:  # TypeError: pyserial's, of a port that was closed
            raise ServoError(f"{self._name}: {error}; was it unplugged?") from error


class DynamixelGimbal(GimbalServos):
    """Raises ServoError at once where a servo is missing, of another model, or in wheel or multi-turn mode."""

    def __init__(self, bus: DynamixelBus, servo: GimbalServo, clock: Callable[[], float],
                 speed_degps: float = 400.0, acceleration_degps2: float = 2000.0):  # fmt: skip
        self._bus, self._clock = bus, clock
        self._axes = ((servo.pan_id, servo.pan_zero, servo.pan_sign), (servo.tilt_id, servo.tilt_zero, servo.tilt_sign))
        self._limits = [self._check(number) for number, _, _ in self._axes]
        self._present = [mx12w.present(bus.read(number, mx12w.PRESENT)) for number, _, _ in self._axes]
        for number, _, _ in self._axes:
            bus.write(number, mx12w.MOVING_SPEED, mx12w.speed_units(speed_degps))
            bus.write(number, mx12w.GOAL_ACCELERATION, mx12w.acceleration_units(acceleration_degps2))
            bus.write(number, mx12w.TORQUE_ENABLE, 1)

    def _check(self, number: int) -> Tuple[int, int]:
        """The servo's own limits (ticks)."""
        low_byte, high_byte = self._bus.read(number, mx12w.MODEL)
        model = low_byte | high_byte << 8
        if model != mx12w.MODEL_NUMBER:
            raise ServoError(f"servo {number} is of model {model}, not an MX-12W ({mx12w.MODEL_NUMBER})")
        low, high = (
            raw[0] | raw[1] << 8 for raw in (self._bus.read(number, r) for r in (mx12w.CW_LIMIT, mx12w.CCW_LIMIT))
        )
        if not low < high <= 4095:
            raise ServoError(
                f"servo {number} is in wheel or multi-turn mode (limits {low}, {high}): set joint mode with its tool"
            )
        return low, high

    def turn(self, angles: Angles) -> None:
        goals = {}
        for (number, zero, sign), (low, high), angle in zip(self._axes, self._limits, angles):
            if not np.isfinite(angle):
                raise ServoError(f"servo {number}: told to turn to {angle}")
            ticks = zero + sign * int(round(angle / mx12w.TICK_RAD))
            if not low <= ticks <= high:
                raise ServoError(
                    f"servo {number}: {np.degrees(angle):.1f} deg is tick {ticks}, its limits are {low}..{high}: "
                    "make the gimbal's limits narrower, or mount the servo's middle ahead"
                )
            goals[number] = ticks
        self._bus.write_all(mx12w.GOAL_POSITION, goals)

    def read(self) -> GimbalReading:
        """The two are asked one after the other, a millisecond apart; the stamp is the middle."""
        begun_s = self._clock()
        self._present = [mx12w.present(self._bus.read(number, mx12w.PRESENT)) for number, _, _ in self._axes]
        stamp_s = 0.5 * (begun_s + self._clock())
        pan, tilt = (
            sign * (now.position - zero) * mx12w.TICK_RAD for (_, zero, sign), now in zip(self._axes, self._present)
        )
        return GimbalReading(stamp_s, Angles(float(pan), float(tilt)))

    def health(self) -> Dict[str, str]:
        out = {}
        for name, (number, _, _), now in zip(("pan", "tilt"), self._axes, self._present):
            out[f"{name} servo"] = f"{now.temperature_c} C, {now.voltage_v:.1f} V, load {100 * now.load:.0f} %"
            out[f"{name} lost answers"] = str(self._bus.failures[number])
        return out

    def close(self) -> None:
        """Torque off; the bus stays open for the other gimbal."""
        self._bus.write_all(mx12w.TORQUE_ENABLE, {number: 0 for number, _, _ in self._axes})


def _bytes(value: int, register: Register) -> List[int]:
    return [value >> 8 * k & 0xFF for k in range(register.length)]

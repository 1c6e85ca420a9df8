# SPDX-License-Identifier: Apache-2.0
"""MX-12W on a serial bus, a gimbal's two or any others, through Robotis' dynamixel-sdk (protocol
1.0)."""

import termios
import threading
from collections import Counter
from typing import Callable, Dict, List, NamedTuple, Sequence, Tuple

import dynamixel_sdk as sdk
import numpy as np
import serial

from fcsv_tracking.gimbal import mx12w
from fcsv_tracking.gimbal.config import GimbalServo
from fcsv_tracking.gimbal.geometry import Angles
from fcsv_tracking.gimbal.mx12w import Register
from fcsv_tracking.gimbal.servos import GimbalReading, GimbalServos, ServoError

_ATTEMPTS = 3
_PAUSE_S = 0.005  # at most, in one look for bytes
_LENGTH, _DATA = 3, 5  # where an answer has them
_LINE = (serial.SerialException, OSError, termios.error)  # what a line that is gone raises


class _Port(sdk.PortHandler):
    """The driver's own limit, 34 ms, is too short where other processes use the processor. It also
    looks for bytes without a pause, which takes a processor from everybody else, and from what
    brings the bytes."""

    def __init__(self, port: str, answer_s: float):
        super().__init__(port)
        self._answer_s = answer_s

    def setupPort(self, cflag_baud: int) -> bool:
        done = super().setupPort(cflag_baud)
        self.ser.timeout = _PAUSE_S
        return done

    def setPacketTimeout(self, packet_length: int) -> None:
        self.setPacketTimeoutMillis(self.tx_time_per_byte * packet_length + 1e3 * self._answer_s)


class DynamixelBus:
    """One serial port with any number of servos; usable by several threads. Lost or damaged answers
    are asked for again (``failures`` counts them); an error byte is an error at once. ``answer_s``:
    how long an answer may take."""

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
            raise ServoError(
                f"{port}: baud rate {baud} is none that the driver knows; MX servos come with 1000000"
            )

    def read(self, number: int, register: Register) -> List[int]:
        """Bytes of a register. Raises ServoError."""
        return self._ask(number, lambda: self._read(number, register))

    def _read(self, number: int, register: Register) -> Tuple[List[int], int, int]:
        """The driver's own reading takes an answer of another length: bytes would be missing, or be
        the checksum's."""
        request = [0, 0, number, 4, sdk.INST_READ, register.address, register.length, 0]
        answer, result, error = self._packets.txRxPacket(self._port, request)
        if result != sdk.COMM_SUCCESS or error:
            return [], result, error
        if answer[_LENGTH] != register.length + 2:
            return [], sdk.COMM_RX_CORRUPT, 0
        return answer[_DATA : _DATA + register.length], result, 0

    def write(self, number: int, register: Register, value: int) -> None:
        """Raises ServoError."""
        raw = _bytes(value, register)

        def send() -> Tuple[List[int], int, int]:
            return (
                [],
                *self._packets.writeTxRx(
                    self._port, number, register.address, register.length, raw
                ),
            )

        self._ask(number, send)

    def write_all(self, register: Register, values: Dict[int, int]) -> None:
        """One packet for several servos, which start together and do not answer. Raises
        ServoError."""
        raw = [b for number, value in values.items() for b in (number, *_bytes(value, register))]
        with self._lock:
            try:
                self._port.is_using = False
                result = self._packets.syncWriteTxOnly(
                    self._port, register.address, register.length, raw, len(raw)
                )
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
            raise ServoError(
                f"{self._name}: servo {number} does not answer; check its id, power, cable and baud rate"
            )
        if result != sdk.COMM_SUCCESS:
            raise ServoError(
                f"{self._name}: answers of servo {number} are damaged; two with one id, or a bad cable?"
            )
        if error:
            raise ServoError(f"{self._name}: servo {number}: {'; '.join(mx12w.errors(error))}")
        return list(data)

    def _exchange(self, send):
        try:
            self._port.is_using = False  # an exception in the last exchange leaves it set
            # an answer that came too late belongs to another question
            self._port.ser.reset_input_buffer()
            return send()
        except (*_LINE, TypeError) as error:  # TypeError: pyserial's, of a port that was closed
            raise ServoError(f"{self._name}: {error}; was it unplugged?") from error


class DynamixelAxis(NamedTuple):
    """A servo that turns one axis: id on the bus, reading at angle zero (ticks), which way it
    counts (1 or -1)."""

    name: str
    number: int
    zero: int
    sign: int


class DynamixelAxes:
    """Servos that turn together. Raises ServoError at once where one is missing, of another model,
    or in wheel or multi-turn mode."""

    def __init__(
        self,
        bus: DynamixelBus,
        axes: Sequence[DynamixelAxis],
        clock: Callable[[], float],
        speed_degps: float = 400.0,
        acceleration_degps2: float = 2000.0,
    ):
        self._bus, self._clock, self._axes = bus, clock, tuple(axes)
        self._limits = [self._check(a.number) for a in self._axes]
        self._present = [mx12w.present(bus.read(a.number, mx12w.PRESENT)) for a in self._axes]
        for a in self._axes:
            bus.write(a.number, mx12w.MOVING_SPEED, mx12w.speed_units(speed_degps))
            bus.write(
                a.number, mx12w.GOAL_ACCELERATION, mx12w.acceleration_units(acceleration_degps2)
            )
            bus.write(a.number, mx12w.TORQUE_ENABLE, 1)

    def _check(self, number: int) -> Tuple[int, int]:
        """The servo's own limits (ticks)."""
        low_byte, high_byte = self._bus.read(number, mx12w.MODEL)
        model = low_byte | high_byte << 8
        if model != mx12w.MODEL_NUMBER:
            raise ServoError(
                f"servo {number} is of model {model}, not an MX-12W ({mx12w.MODEL_NUMBER})"
            )
        low, high = (
            raw[0] | raw[1] << 8
            for raw in (self._bus.read(number, r) for r in (mx12w.CW_LIMIT, mx12w.CCW_LIMIT))
        )
        if not low < high <= 4095:
            raise ServoError(
                f"servo {number} is in wheel or multi-turn mode (limits {low}, {high}): set joint mode with its tool"
            )
        return low, high

    def turn_axes(self, angles_rad: Sequence[float]) -> None:
        """All start together and hold. Raises ServoError; then none is turned."""
        goals = {}
        for axis, (low, high), angle in zip(self._axes, self._limits, angles_rad):
            if not np.isfinite(angle):
                raise ServoError(f"servo {axis.number}: told to turn to {angle}")
            ticks = axis.zero + axis.sign * int(round(angle / mx12w.TICK_RAD))
            if not low <= ticks <= high:
                raise ServoError(
                    f"servo {axis.number}: {np.degrees(angle):.1f} deg is tick {ticks}, its limits are {low}..{high}: "
                    "make the gimbal's limits narrower, or mount the servo's middle ahead"
                )
            goals[axis.number] = ticks
        self._bus.write_all(mx12w.GOAL_POSITION, goals)

    def read_axes(self) -> Tuple[float, List[float]]:
        """Stamp (s) and angles (rad). They are asked one after the other, a millisecond apart; the
        stamp is the middle. Raises ServoError."""
        begun_s = self._clock()
        self._present = [mx12w.present(self._bus.read(a.number, mx12w.PRESENT)) for a in self._axes]
        stamp_s = 0.5 * (begun_s + self._clock())
        angles = [
            a.sign * (now.position - a.zero) * mx12w.TICK_RAD
            for a, now in zip(self._axes, self._present)
        ]
        return stamp_s, [float(a) for a in angles]

    def health(self) -> Dict[str, str]:
        """Gives figures for diagnostics: temperature, voltage, load and lost answers by name."""
        out = {}
        for axis, now in zip(self._axes, self._present):
            out[f"{axis.name} servo"] = (
                f"{now.temperature_c} C, {now.voltage_v:.1f} V, load {100 * now.load:.0f} %"
            )
            out[f"{axis.name} lost answers"] = str(self._bus.failures[axis.number])
        return out

    def close(self) -> None:
        """Torque off; the bus stays open for other servos."""
        self._bus.write_all(mx12w.TORQUE_ENABLE, {a.number: 0 for a in self._axes})


class DynamixelGimbal(DynamixelAxes, GimbalServos):
    """Pan and tilt of a gimbal."""

    def __init__(
        self,
        bus: DynamixelBus,
        servo: GimbalServo,
        clock: Callable[[], float],
        speed_degps: float = 400.0,
        acceleration_degps2: float = 2000.0,
    ):
        axes = (
            DynamixelAxis("pan", servo.pan_id, servo.pan_zero, servo.pan_sign),
            DynamixelAxis("tilt", servo.tilt_id, servo.tilt_zero, servo.tilt_sign),
        )
        super().__init__(bus, axes, clock, speed_degps, acceleration_degps2)

    def turn(self, angles: Angles) -> None:
        self.turn_axes(angles)

    def read(self) -> GimbalReading:
        stamp_s, angles = self.read_axes()
        return GimbalReading(stamp_s, Angles(*angles))


def _bytes(value: int, register: Register) -> List[int]:
    return [value >> 8 * k & 0xFF for k in range(register.length)]

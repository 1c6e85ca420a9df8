# SPDX-License-Identifier: Apache-2.0
"""A bus of simulated MX-12W behind a pseudo-terminal: whoever opens ``port`` speaks protocol 1.0
with them."""

import os
import pty
import select
import threading
import time
import tty
from typing import Callable, Dict, Iterable, Optional

import numpy as np

from fcsv_sim.gimbal.gimbal import STEP_S, ServoErrors, SimulatedServo
from fcsv_tracking.gimbal import mx12w

_PING, _READ, _WRITE, _SYNC_WRITE = 0x01, 0x02, 0x03, 0x83
_BROADCAST = 0xFE
_TABLE = 74  # bytes
_INSTRUCTION_ERROR, _CHECKSUM_ERROR, _RANGE_ERROR, _ANGLE_ERROR = 0x40, 0x10, 0x08, 0x02
_MIDDLE = 2048


class SimulatedMX12W:
    """One servo: its control table, and the axis that obeys it. ``fault`` is done to its answers:
    "silent", "checksum", "wrong id", "garbage"; ``error`` is ored into their error byte."""

    def __init__(self, number: int, now_s: float, errors: ServoErrors):
        self.fault: Optional[str] = None
        self.error = 0
        self.table = bytearray(_TABLE)
        self.axis = SimulatedServo(errors, np.random.default_rng([number, 24]))
        self._now_s = now_s
        for register, value in (
            (mx12w.MODEL, mx12w.MODEL_NUMBER),
            (mx12w.CCW_LIMIT, 4095),
            (mx12w.GOAL_POSITION, _MIDDLE),
        ):
            self.put(register, value)
        self.table[3], self.table[42], self.table[43] = number, 120, 35

    def put(self, register: mx12w.Register, value: int) -> None:
        self.table[register.address : register.address + register.length] = value.to_bytes(
            register.length, "little"
        )

    def get(self, register: mx12w.Register) -> int:
        return int.from_bytes(
            self.table[register.address : register.address + register.length], "little"
        )

    def advance(self, now_s: float) -> None:
        self._now_s = max(self._now_s, now_s - 1.0)
        while self._now_s + STEP_S <= now_s:
            self._now_s += STEP_S
            self.axis.step(self._now_s)
        ticks = _MIDDLE + round(self.axis.reading_rad(self.axis.angle_rad) / mx12w.TICK_RAD)
        self.put(mx12w.Register(36, 2), int(np.clip(ticks, 0, 4095)))

    def write(self, address: int, values: bytes) -> int:
        """The error byte."""
        if address + len(values) > _TABLE or address < 3:
            return _RANGE_ERROR
        before, goal = bytes(self.table), mx12w.GOAL_POSITION
        self.table[address : address + len(values)] = values
        if not self.get(mx12w.CW_LIMIT) <= self.get(goal) <= self.get(mx12w.CCW_LIMIT):
            self.table[:] = before
            return _ANGLE_ERROR
        self.axis.torque = bool(self.get(mx12w.TORQUE_ENABLE))
        speed, ramp = self.get(mx12w.MOVING_SPEED), self.get(mx12w.GOAL_ACCELERATION)
        self.axis.limit(
            mx12w.SPEED_DEGPS * (speed or 513), mx12w.ACCELERATION_DEGPS2 * (ramp or 400)
        )
        if address <= goal.address < address + len(values) and self.axis.torque:
            self.axis.command(self._now_s, (self.get(goal) - _MIDDLE) * mx12w.TICK_RAD)
        return 0


class SimulatedBus:
    """A context manager; ``servos`` by id, ``port`` the terminal's path."""

    def __init__(
        self,
        numbers: Iterable[int],
        clock: Callable[[], float] = time.time,
        errors: Optional[ServoErrors] = None,
    ):
        self._clock, self._stop = clock, threading.Event()
        self.servos: Dict[int, SimulatedMX12W] = {
            n: SimulatedMX12W(n, clock(), errors or ServoErrors()) for n in numbers
        }
        self._host, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def __enter__(self) -> "SimulatedBus":
        return self

    def __exit__(self, *_args) -> None:
        self.close()

    def close(self) -> None:
        """Closes the line, as if unplugged."""
        if not self._stop.is_set():
            self._stop.set()
            self._thread.join()
            os.close(self._host)
            os.close(self._slave)

    def _serve(self) -> None:
        heard = bytearray()
        while not self._stop.is_set():
            if not select.select([self._host], [], [], 0.02)[0]:
                continue
            heard += os.read(self._host, 1024)
            while True:
                packet = _pop_packet(heard)
                if packet is None:
                    break
                self._obey(packet)

    def _obey(self, packet: bytes) -> None:
        number, instruction, parameters = packet[2], packet[4], packet[5:-1]
        now_s = self._clock()
        for servo in self.servos.values():
            servo.advance(now_s)
        if instruction == _SYNC_WRITE and number == _BROADCAST:
            self._sync_write(parameters)
        elif number in self.servos:
            servo = self.servos[number]
            if _checksum(packet[2:-1]) != packet[-1]:
                self._answer(number, servo, _CHECKSUM_ERROR, b"")
            elif instruction == _PING:
                self._answer(number, servo, 0, b"")
            elif instruction == _READ:
                address, length = parameters
                self._answer(number, servo, 0, bytes(servo.table[address : address + length]))
            elif instruction == _WRITE:
                self._answer(number, servo, servo.write(parameters[0], bytes(parameters[1:])), b"")
            else:
                self._answer(number, servo, _INSTRUCTION_ERROR, b"")

    def _sync_write(self, parameters: bytes) -> None:
        address, length, rest = parameters[0], parameters[1], parameters[2:]
        for k in range(0, len(rest), length + 1):
            if rest[k] in self.servos:
                self.servos[rest[k]].write(address, bytes(rest[k + 1 : k + 1 + length]))

    def _answer(self, number: int, servo: SimulatedMX12W, error: int, data: bytes) -> None:
        if servo.fault == "silent":
            return
        said = number + 1 if servo.fault == "wrong id" else number
        body = bytes([said, len(data) + 2, error | servo.error]) + data
        checksum = _checksum(body) ^ (0x5A if servo.fault == "checksum" else 0)
        out = b"\xff\xff" + body + bytes([checksum])
        os.write(self._host, out[:4] + b"\x00" * 3 if servo.fault == "garbage" else out)


def _checksum(body: bytes) -> int:
    return ~sum(body) & 0xFF


def _pop_packet(heard: bytearray) -> Optional[bytes]:
    """The first whole packet, taken out of what was heard; what cannot begin one is dropped."""
    while len(heard) >= 2 and heard[:2] != b"\xff\xff":
        del heard[0]
    if len(heard) < 6 or len(heard) < heard[3] + 4:
        return None
    length = heard[3] + 4
    packet = bytes(heard[:length])
    del heard[:length]
    return packet

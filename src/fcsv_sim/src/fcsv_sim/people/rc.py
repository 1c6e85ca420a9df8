# SPDX-License-Identifier: Apache-2.0
"""A transmitter: stick positions as PWM over UDP, in the format of ArduPilot's own simulator
(uint16 LE)."""

import socket
import struct
from bisect import bisect_left
from typing import Optional, Sequence, Tuple

from fcsv_geometry.vehicles.modes import Mode

#: FLTMODE1..6 of the simulated autopilot, chosen by channel 5, and the PWM in the middle of each
#: range.
MODE_SWITCH = (Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.BRAKE, Mode.GUIDED, Mode.LAND)
_MODE_PWM = (1165, 1295, 1425, 1555, 1685, 1850)
_MODE_LIMITS = (1230, 1360, 1490, 1620, 1749)
_CHANNELS = 8


def pwm(stick: float) -> int:
    """A stick from -1 to 1 as 1000 to 2000 microseconds."""
    return int(round(1500 + 500 * max(-1.0, min(1.0, stick))))


def stick(pwm_us: int) -> float:
    """The inverse of pwm()."""
    return (pwm_us - 1500) / 500.0


def mode_of(pwm_us: int) -> Mode:
    """The flight mode that the mode channel's PWM selects (ArduCopter's six ranges)."""
    return MODE_SWITCH[bisect_left(_MODE_LIMITS, pwm_us)]


def frame_of(
    roll: float, pitch: float, throttle: float, yaw: float, mode_name: Mode
) -> Tuple[int, ...]:
    """PWM of eight channels from sticks (-1 to 1). Raises ValueError for a mode that is not on the
    switch."""
    mode_pwm = _MODE_PWM[MODE_SWITCH.index(mode_name)]
    # on channel 2 stick forward is low, as on a real transmitter
    return pwm(roll), pwm(-pitch), pwm(throttle), pwm(yaw), mode_pwm, 1500, 1500, 1500


class RcSender:
    """The transmitter's side. Sticks from -1 to 1: roll right, pitch forward, throttle up, yaw
    right."""

    def __init__(self, port: int, host: str = "127.0.0.1"):
        self._address = (host, port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def send(self, roll: float, pitch: float, throttle: float, yaw: float, mode_name: Mode) -> None:
        """One frame. Raises ValueError for a mode that is not on the switch."""
        channels = frame_of(roll, pitch, throttle, yaw, mode_name)
        try:
            self._socket.sendto(struct.pack("<8H", *channels), self._address)
        except ConnectionRefusedError:
            pass  # the receiver is off; a transmitter does not notice

    def close(self) -> None:
        self._socket.close()


class RcReceiver:
    """The receiver's side: the newest frame, without waiting."""

    def __init__(self, port: int, host: str = "127.0.0.1"):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, port))
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]

    def newest(self) -> Optional[Sequence[int]]:
        """PWM of the first eight channels, None where nothing came since the last call."""
        frame = None
        while True:
            try:
                datagram = self._socket.recv(64)
            except BlockingIOError:
                return frame
            if len(datagram) in (2 * _CHANNELS, 4 * _CHANNELS):
                frame = struct.unpack_from("<8H", datagram)

    def close(self) -> None:
        self._socket.close()

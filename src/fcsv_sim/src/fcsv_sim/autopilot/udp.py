# SPDX-License-Identifier: Apache-2.0
"""The simulated autopilot's line: UDP towards a companion."""

import os

os.environ.setdefault("MAVLINK20", "1")

import time
from typing import Optional, Tuple

from pymavlink import mavutil

from fcsv_sim.autopilot.mavlink_server import MavlinkServer

_M = mavutil.mavlink
_EPOCH_S = 1420070400.0  # 2015-01-01, from which MAVLink counts
_AHEAD = 6_000_000  # ticks: ArduCopter begins a minute after the time that it kept


class AutopilotUdp:
    """Carries a MavlinkServer's messages; ``companion`` is HOST:PORT. ``step`` never waits. With a
    ``key`` of 32 bytes, or one that the server was given by SETUP_SIGNING, it signs, and hears
    nothing that is not signed with it; ``usb``: as ArduCopter's first port (SERIAL0), it then signs
    and hears everybody all the same."""

    def __init__(
        self,
        server: MavlinkServer,
        companion: str,
        system_id: int,
        key: Optional[bytes] = None,
        usb: bool = False,
    ):
        self._server, self._usb = server, usb
        self._link = mavutil.mavlink_connection(
            f"udpout:{companion}",
            source_system=system_id,
            source_component=1,
            dialect="ardupilotmega",
        )
        self._signing: Optional[Tuple[bytes, int]] = None
        if key is not None:
            server.signing = (key, int((time.time() - _EPOCH_S) * 1e5))
        self._sign()

    def step(self, now_s: float, attitude_rpy_rad) -> None:
        """Hand over all that came; send what is due."""
        while True:
            try:
                message = self._link.recv_msg()
            except ConnectionRefusedError:
                break  # nobody listens yet
            if message is None:
                break
            if message.get_type() != "BAD_DATA":
                self._server.receive(now_s, message)
                self._sign()
        self._server.step(now_s, attitude_rpy_rad)
        for message in self._server.outgoing():
            try:
                self._link.mav.send(message)
            except (ConnectionRefusedError, BlockingIOError):
                pass  # lost, as on any line

    def _sign(self) -> None:
        """Signs as the server was told last."""
        told = self._server.signing
        if told is self._signing:
            return
        self._signing = told
        key, from_ticks = told or (None, 0)
        self._link.setup_signing(key, key is not None, self._unsigned, from_ticks + _AHEAD)

    def _unsigned(self, _mav, message_id: int) -> bool:
        """Whether it is heard without the right signature."""
        return self._usb or message_id in (_M.MAVLINK_MSG_ID_RADIO_STATUS, _M.MAVLINK_MSG_ID_RADIO)

    def close(self) -> None:
        self._link.close()

# SPDX-License-Identifier: Apache-2.0
"""The simulated autopilot's line: UDP towards a companion."""

import os

os.environ.setdefault("MAVLINK20", "1")

from typing import Optional

from pymavlink import mavutil

from fcsv_sim.autopilot.mavlink_server import MavlinkServer


class UdpLine:
    """Carries a MavlinkServer's messages; ``companion`` is HOST:PORT. ``step`` never waits. With a ``key`` of 32 bytes
    it signs, and hears nothing that is not signed with it, as ArduCopter with a signing key."""

    def __init__(self, server: MavlinkServer, companion: str, system_id: int, key: Optional[bytes] = None):
        self._server = server
        self._link = mavutil.mavlink_connection(
            f"udpout:{companion}", source_system=system_id, source_component=1, dialect="ardupilotmega"
        )
        if key is not None:
            self._link.setup_signing(key)

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
                self._server.take(now_s, message)
        self._server.step(now_s, attitude_rpy_rad)
        for message in self._server.outgoing():
            try:
                self._link.mav.send(message)
            except (ConnectionRefusedError, BlockingIOError):
                pass  # lost, as on any line

    def close(self) -> None:
        self._link.close()

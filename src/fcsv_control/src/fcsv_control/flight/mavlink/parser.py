# SPDX-License-Identifier: Apache-2.0
"""MAVLink messages out of the bytes of a line, whatever bytes these are, and into it; signed where
there is a key."""

import os

os.environ.setdefault("MAVLINK20", "1")

from typing import List, Optional

from pymavlink import mavutil

from fcsv_control.flight.mavlink.signing import Signing

_M = mavutil.mavlink
# bytes that were read and are let go of: pymavlink does so only where a message ends with what came
_READ = 4096


class Parser(_M.MAVLink):
    """pymavlink's, which keeps no more than what may still become a message. With ``signing``
    nothing else is heard."""

    def __init__(self, signing: Optional[Signing] = None):
        super().__init__(None)
        self.robust_parsing = True
        self.signing = signing or self.signing

    def messages(self, data: bytes) -> List[object]:
        """What is whole now; among it BAD_DATA for what is none."""
        came = self.parse_buffer(data) or []
        if self.buf_index > _READ:
            del self.buf[: self.buf_index]
            self.buf_index = 0
        return came

    def check_signature(self, msgbuf, srcSystem, srcComponent) -> bool:
        """Stands in place of pymavlink's."""
        return self.signing.accepts(bytes(msgbuf), srcSystem, srcComponent)


class Sender(_M.MAVLink):
    """Into what has ``write``."""

    def __init__(self, line, signing: Optional[Signing] = None):
        super().__init__(line)
        self._signed = signing is not None
        self.signing = signing or self.signing

    def send(self, mavmsg, force_mavlink1: bool = False) -> None:
        """Sends with the time of now where it is signed."""
        if self._signed:
            self.signing.advance()
        super().send(mavmsg, force_mavlink1)

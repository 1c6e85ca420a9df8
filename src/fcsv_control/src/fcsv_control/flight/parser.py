# SPDX-License-Identifier: Apache-2.0
"""MAVLink messages out of the bytes of a line, whatever bytes these are."""

import os

os.environ.setdefault("MAVLINK20", "1")

from typing import List

from pymavlink import mavutil

_M = mavutil.mavlink
_READ = 4096  # bytes that were read and are let go of: pymavlink does so only where a message ends with what came


class Parser(_M.MAVLink):
    """pymavlink's, which keeps no more than what may still become a message."""

    def __init__(self):
        super().__init__(None)
        self.robust_parsing = True

    def messages(self, data: bytes) -> List[object]:
        """What is whole now; among it BAD_DATA for what is none."""
        came = self.parse_buffer(data) or []
        if self.buf_index > _READ:
            del self.buf[: self.buf_index]
            self.buf_index = 0
        return came

# SPDX-License-Identifier: Apache-2.0
"""MAVLink 2 signing: the key's file, and which signed messages are heard.

pymavlink notes the time of a message before it looks at its signature, so that one forged message
of a far future shuts the right ones out. Here the signature comes first.
"""

import os

os.environ.setdefault("MAVLINK20", "1")

import hashlib
import hmac
import time
from pathlib import Path
from typing import Callable

from pymavlink import mavutil

from fcsv_control.errors import LinkError

_OTHERS = 0o077
_DIGITS = 64
_EPOCH_S = 1420070400.0  # 2015-01-01, from which MAVLink counts
_TICKS_HZ = 100_000.0
# ticks by which the first message of a stream may be behind the newest that was heard
_NEW_STREAM = 6_000_000
_SIGNATURE = 6  # bytes, behind link id and time


def read_key(path: str) -> bytes:
    """The 32 bytes of a key file: 64 hexadecimal digits. Raises LinkError, also where others than
    its owner may read or change the file."""
    file = Path(path).expanduser()
    try:
        mode = file.stat().st_mode & 0o777
        if mode & _OTHERS:
            raise LinkError(
                f"{file}: others may read it (mode {mode:04o}); `chmod 600 {file}`, and take a new key where somebody"
                " may have copied it"
            )
        text = file.read_text(encoding="ascii").strip()
        key = bytes.fromhex(text)
        if len(text) != _DIGITS or 2 * len(key) != _DIGITS:
            raise ValueError(f"{len(text)} characters")
        return key
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise LinkError(
            f"{file}: is no signing key of {_DIGITS} hexadecimal digits ({why})"
        ) from error


def ticks(unix_s: float) -> int:
    """A time as signatures have it: 10 us since 2015."""
    return int((unix_s - _EPOCH_S) * _TICKS_HZ)


class Signing(mavutil.mavlink.MAVLinkSigning):
    """Signs messages of one line: its sender and its parsers share it, because what is sent must be
    newer than what was heard."""

    def __init__(self, key: bytes, clock: Callable[[], float] = time.time):
        super().__init__()
        self.secret_key, self.sign_outgoing = key, True
        self._clock, self._newest = clock, 0

    def advance(self) -> None:
        """Moves on to the time of the clock: a counter alone falls behind it by hours, and is old
        after a restart."""
        self.timestamp = max(self.timestamp, ticks(self._clock()))

    def accepts(self, frame: bytes, system: int, component: int) -> bool:
        """Whether it was signed with the key, and after all that was heard of this stream."""
        right = hashlib.sha256(self.secret_key + frame[:-_SIGNATURE]).digest()[:_SIGNATURE]
        if not hmac.compare_digest(right, bytes(frame[-_SIGNATURE:])):
            return False
        stamp = int.from_bytes(frame[-2 * _SIGNATURE : -_SIGNATURE], "little")
        stream = (frame[-2 * _SIGNATURE - 1], system, component)
        if stamp <= self.stream_timestamps.get(stream, self._newest - _NEW_STREAM):
            return False
        self.stream_timestamps[stream] = stamp
        self._newest, self.timestamp = max(self._newest, stamp), max(self.timestamp, stamp)
        return True

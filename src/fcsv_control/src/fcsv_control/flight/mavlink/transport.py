# SPDX-License-Identifier: Apache-2.0
"""A line that may be sent on from any thread, and that is opened again after a device was pulled or
a peer was gone."""

import logging
import threading
import time
from typing import Optional, Union

from fcsv_control.errors import LinkError
from fcsv_control.flight.mavlink.lines import SerialLine, TcpLine, UdpLine
from fcsv_control.flight.mavlink.signing import Signing

_LOG = logging.getLogger(__name__)
_REOPEN_S = 1.0
# of TCP: the peer is away, the address is not wrong
_NOBODY_THERE = (ConnectionError, TimeoutError)
_FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or /dev/DEVICE:BAUD"

Line = Union[UdpLine, TcpLine, SerialLine]


class Transport:
    """``url``: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or /dev/DEVICE:BAUD. With a ``key``
    of 32 bytes all that is said is signed with it, and nothing else is heard.

    Raises LinkError where it cannot be opened at first, except where a TCP peer is only not there
    yet.
    """

    def __init__(self, url: str, key: Optional[bytes] = None):
        self._url = url
        self._signing = None if key is None else Signing(key)
        self._sending = threading.Lock()
        self._line: Optional[Line] = None
        self._closed = False
        self._reopen_s = time.monotonic() + _REOPEN_S  # when a line that is not there is tried next
        try:
            self._line = _opened(url, self._signing)
        except _NOBODY_THERE as error:
            _LOG.warning("nobody is at '%s' yet (%s); trying again", url, error)
        except (OSError, ValueError) as error:
            raise LinkError(
                f"flight controller at '{url}' cannot be opened ({error}); give {_FORMS}"
            ) from error

    @property
    def broken(self) -> bool:
        """Whether there is no line at the moment."""
        return self._line is None

    def receive(self, timeout_s: float):
        """The next message, or None after about ``timeout_s``. From one thread only; it never
        raises."""
        line = self._line
        if line is None:
            return self._reopen(timeout_s)
        try:
            return line.receive(timeout_s)
        except (OSError, ValueError) as error:  # ValueError: closed by another thread meanwhile
            self._broke(line, error)
            return None

    def send(self, message) -> None:
        """A message with the source that its header names; what cannot be sent is lost, as on any
        link."""
        with self._sending:
            line = self._line
            if line is None:
                return
            try:
                line.mav.srcSystem, line.mav.srcComponent = (
                    message.get_srcSystem(),
                    message.get_srcComponent(),
                )
                line.mav.send(message)
                return
            except OSError as error:
                failed = error
        if isinstance(line, TcpLine):  # part of it may be on its way: the rest would be rubbish
            self._broke(line, failed)
        else:
            _LOG.debug("%s not sent: %s", message.get_type(), failed)

    def close(self) -> None:
        self._closed = True
        with self._sending:
            line, self._line = self._line, None
        if line is not None:
            line.close()

    def _broke(self, line: Line, error: Exception) -> None:
        with self._sending:
            if self._line is not line:
                return
            self._line, self._reopen_s = None, time.monotonic() + _REOPEN_S
        line.close()
        _LOG.warning("flight controller at '%s' is gone (%s); opening it again", self._url, error)

    def _reopen(self, timeout_s: float) -> None:
        """Once a second; between that it waits as ``receive`` does: who reads also lets the link's
        time go on. Outside of the lock: whoever sends meanwhile must not wait."""
        if self._closed or time.monotonic() < self._reopen_s:
            time.sleep(min(timeout_s, _REOPEN_S))
            return
        self._reopen_s = time.monotonic() + _REOPEN_S
        try:
            line = _opened(self._url, self._signing)
        except (OSError, ValueError) as error:
            _LOG.debug("'%s' cannot be opened: %s", self._url, error)
            return
        with self._sending:
            if not self._closed:
                self._line, line = line, None
                _LOG.info("flight controller at '%s' is open again", self._url)
        if line is not None:
            line.close()


def _opened(url: str, signing: Optional[Signing]) -> Line:
    """Raises OSError, ValueError."""
    if url.startswith("/"):
        return SerialLine(url, signing)
    kind, _, address = url.partition(":")
    if kind == "tcp":
        return TcpLine(address, signing)
    if kind not in ("udpin", "udpout"):
        raise ValueError(f"'{kind}' is not a kind of line")
    return UdpLine(address, kind == "udpin", signing)

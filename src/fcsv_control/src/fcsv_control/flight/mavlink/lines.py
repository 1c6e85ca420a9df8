# SPDX-License-Identifier: Apache-2.0
"""UDP, TCP and serial lines to a flight controller. Errors of a line that broke come out as
OSError."""

import os

os.environ.setdefault("MAVLINK20", "1")

import logging
import select
import socket
import time
from collections import OrderedDict, deque
from typing import Deque, Dict, Optional, Tuple

from pymavlink import mavutil

from fcsv_control.flight.mavlink import firmware
from fcsv_control.flight.mavlink.parser import Parser, Sender
from fcsv_control.flight.mavlink.signing import Signing

_M = mavutil.mavlink
_LOG = logging.getLogger(__name__)
_DATAGRAM = 65535
_MOST_PEERS = 32  # whose messages are put together at the same time
_HOME_LASTS_S = 3.0  # an autopilot that is silent for longer may come from another address
_CONNECT_S, _SEND_S = 1.0, 0.2
_SILENT_S = 5.0  # an autopilot speaks every second: a connection that is silent for longer is dead

Address = Tuple[str, int]


def address_of(text: str) -> Address:
    """HOST:PORT. Raises ValueError."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit():
        raise ValueError(f"'{text}' is not HOST:PORT")
    return socket.gethostbyname(host), int(port)


class UdpLine:
    """``listens``: at this address, for whoever comes; else it speaks to it.

    What is said goes to the address from which the vehicle's autopilot (its system id) was heard,
    and nowhere else: a second autopilot on the port would fuse the first one's poses. One with the
    same id at a second address is refused.
    """

    def __init__(self, address: str, listens: bool, signing: Optional[Signing] = None):
        here = address_of(address)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._fixed: Optional[Address] = None if listens else here
        try:
            if listens:
                self._socket.bind(here)
        except OSError:
            self._socket.close()
            raise
        self._socket.setblocking(False)
        self._parsers: OrderedDict[Address, Parser] = OrderedDict()
        self._signing = signing
        # of system ids: address, and when it was heard last
        self._homes: Dict[int, Tuple[Address, float]] = {}
        self._refused: Dict[Tuple[int, Address], float] = {}
        self._came: Deque[object] = deque()
        self.mav = Sender(self, signing)

    def receive(self, timeout_s: float):
        """The next message, or None after ``timeout_s``."""
        if not self._came and select.select([self._socket], [], [], timeout_s)[0]:
            self._read()
        return self._came.popleft() if self._came else None

    def write(self, data: bytes) -> None:
        """Writes to the autopilot in whose name ``mav`` speaks; lost where that was not heard."""
        home = self._homes.get(self.mav.srcSystem)
        to = self._fixed or (home[0] if home else None)
        if to is not None:
            self._socket.sendto(data, to)

    def close(self) -> None:
        self._socket.close()

    def _read(self) -> None:
        try:
            data, peer = self._socket.recvfrom(_DATAGRAM)
        # refused: what was sent before found nobody
        except (BlockingIOError, ConnectionRefusedError):
            return
        if peer not in self._parsers:
            self._parsers[peer] = Parser(self._signing)
            if len(self._parsers) > _MOST_PEERS:
                self._parsers.popitem(last=False)
        for message in self._parsers[peer].messages(data):
            if self._fixed is not None or self._is_at_home(message, peer):
                self._came.append(message)

    def _is_at_home(self, message, peer: Address) -> bool:
        """Whether a message comes from where its system id lives; a new id moves in."""
        if (
            message.get_type() == "BAD_DATA"
            or message.get_srcComponent() != _M.MAV_COMP_ID_AUTOPILOT1
        ):
            return False
        if message.get_type() == "HEARTBEAT" and not firmware.is_vehicles(message):
            return True  # of a program with an autopilot's ids: it is named, and does not move in
        system, now_s = message.get_srcSystem(), time.monotonic()
        home = self._homes.get(system)
        if home is not None and home[0] != peer and now_s - home[1] < _HOME_LASTS_S:
            if now_s - self._refused.get((system, peer), float("-inf")) > _SILENT_S:
                self._refused = {(system, peer): now_s}
                _LOG.error(
                    "a second autopilot with system id %d speaks from %s:%d; ours is at %s:%d: it is not heard",
                    system,
                    *peer,
                    *home[0],
                )
            return False
        self._homes[system] = (peer, now_s)
        return True


class TcpLine:
    """Connects to HOST:PORT. ``receive`` raises OSError once the peer is gone or silent for five
    seconds."""

    def __init__(self, address: str, signing: Optional[Signing] = None):
        self._socket = socket.create_connection(address_of(address), _CONNECT_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(_SEND_S)
        self._parser = Parser(signing)
        self._came: Deque[object] = deque()
        self._heard_s = time.monotonic()
        self.mav = Sender(self, signing)

    def receive(self, timeout_s: float):
        """The next message, or None after ``timeout_s``."""
        if not self._came and select.select([self._socket], [], [], timeout_s)[0]:
            data = self._socket.recv(_DATAGRAM)
            if not data:
                raise ConnectionError("closed by the other side")
            self._heard_s = time.monotonic()
            self._came.extend(self._parser.messages(data))
        elif time.monotonic() - self._heard_s > _SILENT_S:
            raise ConnectionError(f"silent for {_SILENT_S:g} s")
        return self._came.popleft() if self._came else None

    def write(self, data: bytes) -> None:
        self._socket.sendall(data)

    def close(self) -> None:
        self._socket.close()


class SerialLine:
    """A device and its baud rate, as DEVICE:BAUD."""

    def __init__(self, url: str, signing: Optional[Signing] = None):
        import serial  # when first used: of a link that is started again every moment counts

        device, _, baud = url.rpartition(":")
        self._port = serial.Serial(device, int(baud), timeout=0, write_timeout=_SEND_S)
        self._parser = Parser(signing)
        self._came: Deque[object] = deque()
        self.mav = Sender(self, signing)

    def receive(self, timeout_s: float):
        """The next message, or None after ``timeout_s``."""
        try:
            if not self._came and select.select([self._port], [], [], timeout_s)[0]:
                self._came.extend(self._parser.messages(self._port.read(_DATAGRAM)))
        # what pyserial and select raise when a device is pulled
        except (ValueError, TypeError) as error:
            raise ConnectionError(str(error)) from error
        return self._came.popleft() if self._came else None

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def close(self) -> None:
        self._port.close()

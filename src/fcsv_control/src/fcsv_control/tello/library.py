# SPDX-License-Identifier: Apache-2.0
"""Unmodified ``tellopy`` as the radio: what it hears is given on, what the core wants is sent.

One in a process: tellopy's dispatcher is one for all Tellos of it. Every Tello has the address
192.168.10.1, so each vehicle's Wi-Fi interface stands in a network namespace of its own, or the
control socket is bound to the interface.
"""

import logging
import socket
import threading
import time
from dataclasses import dataclass
from typing import Any, Callable, Tuple

import tellopy

from fcsv_control.errors import ControlError
from fcsv_control.tello.pid import Sticks
from fcsv_geometry.programs import netns

_log = logging.getLogger(__name__)
_CONNECTION_REQUEST = b"conn_req:\x96\x17"  # pictures to port 6038 (0x1796), as tellopy asks
_LAND = 0x0055  # message; payload 0: land, 1: stop landing
_START_VIDEO, _VIDEO_TYPE = 0x0025, 0x60  # message and packet type
_STUCK_S = 1.0  # packets arrive, and tellopy is not connected for so long
_JOIN_S = 3.0


@dataclass(frozen=True)
class RadioParameters:
    """``network``: namespace of the vehicle's Wi-Fi; ``interface``: its name, where it is not in a
    namespace.

    ``address``, ``tello_port``, ``video_port``: of a Tello that is not at its usual place
    (docs/design/trackers.md).
    """

    network: str = ""
    interface: str = ""
    address: str = "192.168.10.1"
    tello_port: int = 8889
    port: int = 9000  # of this computer; another one for each vehicle where they share a namespace
    video_port: int = 6038

    def __post_init__(self):
        for name in ("tello_port", "port", "video_port"):
            if not 1 <= getattr(self, name) <= 65535:
                raise ValueError(f"{name}: {getattr(self, name)} must be 1 to 65535")
        if self.network and self.interface:
            raise ValueError("interface: not together with network, in which the interface is")


@dataclass(frozen=True)
class Hears:
    """Who is told of what arrives, in tellopy's threads; times are monotonic."""

    flight: Callable[[float, Any], None]  # tellopy's FlightData
    imu: Callable[[float, Any], None]  # tellopy's LogImuAtti
    packet: Callable[[float], None]  # of any other message
    video: Callable[[float, bytes], None]  # a piece of a picture, with its two bytes of number


class TelloRadio:
    """Connects again for ever; ``mind`` once a second. Raises ControlError and NamespaceError."""

    def __init__(self, name: str, parameters: RadioParameters, hears: Hears):
        self._name, self._stuck_since_s = name, float("inf")
        before = set(threading.enumerate())
        try:
            with netns.inside(parameters.network):
                self._tello = tellopy.Tello(
                    port=parameters.port, video_port=parameters.video_port, name=name
                )
        except OSError as error:
            raise ControlError(
                f"{name}: port {parameters.port} for its Tello: {error.strerror}"
            ) from error
        self._threads = set(threading.enumerate()) - before
        self._tello.set_loglevel(tellopy.Tello.LOG_ERROR)
        self._tello.tello_addr = (parameters.address, parameters.tello_port)
        self._heard_s = float("-inf")
        try:
            self._bind(parameters.interface)
        except ControlError:
            self.close()
            raise
        t = self._tello
        self._subscribe(t.EVENT_FLIGHT_DATA, hears.flight)
        self._subscribe(t.EVENT_SAMPLE_IMU, hears.imu)
        self._subscribe(t.EVENT_VIDEO_DATA, hears.video)
        for other in (t.EVENT_WIFI, t.EVENT_LIGHT, t.EVENT_LOG_DATA):
            self._subscribe(other, lambda now_s, _data: hears.packet(now_s))
        t.connect()

    @property
    def connected(self) -> bool:
        """Says whether it is connected, as tellopy has it: it sends sticks."""
        return self._tello.state == self._tello.STATE_CONNECTED

    @property
    def wifi_percent(self) -> int:
        """Strength, as the Tello says."""
        return self._tello.wifi_strength

    def sticks(self, s: Sticks) -> None:
        """Sends the sticks from now on; tellopy sends them whenever a packet arrives."""
        t = self._tello
        t.set_pitch(s.forward)
        t.set_roll(-s.left)
        t.set_throttle(s.up)
        t.set_yaw(-s.turn)

    def take_off(self) -> None:
        """The Tello's own take-off; may be lost in the air."""
        self._tello.takeoff()

    def land(self) -> None:
        """The Tello's own landing; may be lost in the air."""
        self._tello.land()

    def stay_up(self) -> None:
        """An end of the Tello's own landing, for which tellopy has no name; may be lost in the
        air."""
        self._tello.send_packet_data(_LAND, payload=b"\x01")

    def key_picture(self) -> None:
        """A request for a key picture, as tellopy sends it every 2 s; may be lost in the air."""
        if self._tello.video_enabled:
            self._tello.send_packet_data(_START_VIDEO, type=_VIDEO_TYPE)

    def mind(self, now_s: float, video: bool) -> None:
        """Ask for what tellopy does not ask for by itself.

        After a gap it waits for silence before it asks for a connection; a Tello that goes on
        talking is not silent.
        """
        stuck = not self.connected and now_s - self._heard_s < _STUCK_S
        if not stuck:
            self._stuck_since_s = now_s
        elif now_s - self._stuck_since_s > _STUCK_S:
            self._stuck_since_s = now_s
            self._send(_CONNECTION_REQUEST)
        if video and self.connected and not self._tello.video_enabled:
            self._tello.start_video()

    def close(self) -> None:
        """End tellopy's threads and sockets; what flies lands by itself after 15 s."""
        self._tello.quit()
        for thread in self._threads:
            thread.join(_JOIN_S)
        self._tello.sock.close()

    def _send(self, data: bytes) -> None:
        try:
            self._tello.sock.sendto(data, self._tello.tello_addr)
        except OSError as error:
            _log.warning("%s: connection request: %s", self._name, error)

    def _bind(self, interface: str) -> None:
        if not interface:
            return
        try:
            self._tello.sock.setsockopt(
                socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode() + b"\0"
            )
        except OSError as error:
            raise ControlError(f"{self._name}: interface {interface}: {error.strerror}") from error

    def _subscribe(self, event: Any, tell: Callable[[float, Any], None]) -> None:
        """tellopy would only print what a handler raises."""

        def handler(event, sender, data, **_):
            now_s = self._heard_s = time.monotonic()
            try:
                tell(now_s, data)
            except Exception:
                _log.exception("%s: what its Tello sent", self._name)

        self._tello.subscribe(event, handler)


def where(parameters: RadioParameters) -> Tuple[str, str]:
    """(address, how it is reached), in words."""
    p = parameters
    way = (
        f"in network namespace {p.network}"
        if p.network
        else f"by {p.interface}"
        if p.interface
        else "by any route"
    )
    return f"{p.address}:{p.tello_port}", way

# SPDX-License-Identifier: Apache-2.0
"""The Tello's side of its protocol: datagrams in, datagrams out; one client at a time; no sockets,
time is given.

Who knows nothing of the protocol, another client, and packets with a wrong checksum get no answer.
A command is answered with its own number and sequence and one byte, 0 where it was done.
"""

import struct
from typing import Callable, Dict, List, Optional, Tuple

from fcsv_geometry.streams.flow import DropCounter, RateGate
from fcsv_sim.tello import log, messages
from fcsv_sim.tello.drone import Drone
from fcsv_sim.tello.messages import STATUS_REFUSED, MessageId
from fcsv_sim.tello.packets import FROM_DRONE, TO_DRONE, Packet, PacketError, decode, encode

Address = Tuple[str, int]
_TOLD = FROM_DRONE | 1 << 3  # type "information"
# ? a client that is not heard for so long gets nothing more, and makes room for another
_SILENT_S = 5.0
_LOG_NUMBER = 0x0123
_UNKNOWN_MESSAGE, _UNKNOWN_RECORD = 0x0FF1, 4242  # of another firmware
_TELLS = ((MessageId.FLIGHT, 10.0), (MessageId.WIFI, 2.0), (MessageId.LIGHT, 1.0))
#: Not acknowledged: these come all the time, or are answers themselves.
_UNANSWERED = frozenset({MessageId.STICKS, MessageId.LOG_HEADER, MessageId.TIME})


class SimulatedTelloLink:
    """take() what arrives, step() every pass; outgoing() is what the client gets."""

    def __init__(self, drone: Drone):
        self._drone = drone
        self.counts = DropCounter()
        self.client: Optional[Address] = None
        self.video_port = self.video_port_instead = 0
        self._heard_s, self._silent = float("-inf"), False
        self._sequence = 0
        self._out: List[bytes] = []
        self._gates: Dict[MessageId, RateGate] = {}
        self._repeat = RateGate(1.0)
        self._log_asked = self._clock_known = False
        self._do: Dict[int, Callable[[float, Packet], bytes]] = self._handlers()

    @property
    def video_to(self) -> Optional[Address]:
        """Where pictures go: the client's address, at the port that it named, or
        ``video_port_instead``."""
        port = self.video_port_instead or self.video_port
        return (
            (self.client[0], port)
            if self.client and self._drone.video_wanted and not self._silent
            else None
        )

    def outgoing(self) -> List[bytes]:
        """What goes to the client since the last time."""
        out, self._out = self._out, []
        return out

    # -- what comes in
    # ----------------------------------------------------------------------------------------------

    def on_datagram(self, now_s: float, data: bytes, sender: Address) -> None:
        """One datagram; whatever it holds."""
        port = messages.decode_connect(data)
        if self.client is not None and sender != self.client and now_s - self._heard_s <= _SILENT_S:
            self.counts.count("another client")
        elif port is not None:
            self._connect(now_s, port, sender)
        elif sender != self.client:
            self.counts.count("no connection request before")
        elif data == messages.EMERGENCY:
            self._heard_s = now_s
            self._drone.flight.stop_motors()
        else:
            self._on_packet(now_s, data)

    def _on_packet(self, now_s: float, data: bytes) -> None:
        try:
            packet = decode(data)
        except PacketError as error:
            self.counts.count(str(error).split(":")[0])
            return
        self._heard_s = now_s
        do = self._do.get(packet.message)
        if do is None:
            self.counts.count(f"unknown message 0x{packet.message:04x}")
            return
        self._drone.flight.on_command(now_s)
        try:
            answer = do(now_s, packet)
        except (ValueError, struct.error):
            self.counts.count(f"message 0x{packet.message:04x} is too short")
            answer = STATUS_REFUSED
        if packet.message not in _UNANSWERED:
            kind = packet.kind & ~TO_DRONE & 0xFF | FROM_DRONE
            self._out.append(encode(Packet(packet.message, packet.sequence, answer, kind)))

    def _connect(self, now_s: float, port: int, sender: Address) -> None:
        self.client, self.video_port, self._heard_s = sender, port, now_s
        self._log_asked = self._clock_known = False
        self._gates = {message: RateGate.bursting(hz) for message, hz in _TELLS}
        self._repeat = RateGate(1.0)
        self._drone.video_wanted = False
        self._out = [messages.encode_connected(port)]

    # -- what goes out
    # ----------------------------------------------------------------------------------------------

    def step(self, now_s: float, logged: List[bytes]) -> None:
        """Everything that is due; ``logged``: payloads of the flight log, sent once its header is
        acknowledged."""
        self._silent = now_s - self._heard_s > _SILENT_S
        if self.client is None or self._silent:
            return
        other = self._drone.parameters.other_firmware
        if self._repeat.passes(now_s):
            if not self._log_asked:
                self._tell(MessageId.LOG_HEADER, _log_header())
            if not self._clock_known:
                self._tell(MessageId.TIME, b"")
            if other:
                self._tell(_UNKNOWN_MESSAGE, bytes(9))
        for message, gate in self._gates.items():
            if gate.passes(now_s):
                self._tell(message, self._drone.payload(message, now_s))
        if self._log_asked:
            for payload in logged:
                self._tell(
                    MessageId.LOG_DATA, payload + log.record(_UNKNOWN_RECORD, 0, bytes(16)) * other
                )

    def _tell(self, message: int, payload: bytes) -> None:
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._out.append(encode(Packet(message, self._sequence, payload, _TOLD)))

    # -- handlers: payload of the answer
    # ----------------------------------------------------------------------------

    def _handlers(self) -> Dict[int, Callable[[float, Packet], bytes]]:
        return {
            **self._drone.handlers(),
            MessageId.LOG_HEADER: self._on_log_header,
            MessageId.TIME: self._on_time,
        }

    def _on_log_header(self, _now_s: float, packet: Packet) -> bytes:
        """The client's acknowledgement: status, number of the log."""
        if struct.unpack_from("<H", packet.payload, 1)[0] == _LOG_NUMBER and not self._log_asked:
            self._log_asked = True
            self._tell(MessageId.LOG_CONFIG, bytes(8))
            self._tell(MessageId.LOG_DATA, self._drone.telemetry.first())
        return b""

    def _on_time(self, _now_s: float, _packet: Packet) -> bytes:
        self._clock_known = True
        return b""


def _log_header() -> bytes:
    """Number of the log, and the firmware's own words where tellopy prints them."""
    return (
        struct.pack("<H", _LOG_NUMBER)
        + bytes(17)
        + b"BUILD simulated by fcsv   ".ljust(60, b"\x00")
    )

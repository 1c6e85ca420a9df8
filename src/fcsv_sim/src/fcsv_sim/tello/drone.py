# SPDX-License-Identifier: Apache-2.0
"""What the Tello does when a message asks for it, and what it says of itself; no I/O, time is
given."""

import struct
from dataclasses import dataclass
from typing import Callable, Dict

import numpy as np

from fcsv_sim.tello import messages
from fcsv_sim.tello.battery import TelloBattery
from fcsv_sim.tello.flight import Felt, TelloFlight
from fcsv_sim.tello.messages import STATUS_OK, STATUS_REFUSED, FlightData, MessageId
from fcsv_sim.tello.packets import Packet
from fcsv_sim.tello.radio import SimulatedWifi
from fcsv_sim.tello.telemetry import Telemetry

_FIRMWARE = "01.04.92.01"
_SHORT = 18  # bytes of flight data; tellopy reads nothing from less than 22
_WINDY_RAD = np.radians(8.0)


@dataclass(frozen=True)
class DroneParameters:
    """What it is called, and what its firmware says. ``other_firmware``: one that this protocol was
    not read from: flight data of 18 bytes, a message and a log record that nobody knows."""

    ssid: str = "TELLO-FC5000"
    password: str = ""
    firmware: str = _FIRMWARE
    other_firmware: bool = False
    light: int = 1


class Drone:
    """Everything that a message can ask for; ``felt`` is renewed every pass."""

    def __init__(
        self,
        parameters: DroneParameters,
        flight: TelloFlight,
        telemetry: Telemetry,
        radio: SimulatedWifi,
    ):
        self.parameters = parameters
        self.flight, self.telemetry, self.radio = flight, telemetry, radio
        self.felt = Felt(0.0, np.zeros(3), 0.0, False)
        self.lean_rad = 0.0
        self.video_wanted = False
        self.key_picture_wanted = False
        self.encoder_rate = 0
        self._names = {"ssid": parameters.ssid, "password": parameters.password}

    @property
    def battery(self) -> TelloBattery:
        return self.flight.battery

    # -- what it says by itself
    # -------------------------------------------------------------------------------------

    def payload(self, message: MessageId, now_s: float) -> bytes:
        """Payload of a message that it sends again and again."""
        if message is MessageId.WIFI:
            return bytes([self.radio.strength, 0])
        if message is MessageId.LIGHT:
            return bytes([self.parameters.light])
        data = messages.encode_flight(self._flight_data(now_s))
        return data[:_SHORT] if self.parameters.other_firmware else data

    def _flight_data(self, _now_s: float) -> FlightData:
        flight, battery, flying = self.flight, self.battery, self.flight.flying
        v_ned = self.telemetry.v_ned_mps if flying else np.zeros(3)
        return FlightData(
            self.felt.height_m if flying else 0.0,
            tuple(float(v) for v in v_ned),
            flight.flown_s,
            battery.percent,
            battery.volts,
            battery.left_s,
            self.felt.sees_ground,
            self.lean_rad > _WINDY_RAD,
            flying,
            not flying,
            flying,
            flying and flight.holds,
            battery.low,
            battery.critical,
            flight.mode(self.felt),
        )

    # -- what it is asked
    # -------------------------------------------------------------------------------------------

    def handlers(self) -> Dict[int, Callable[[float, Packet], bytes]]:
        """Gives the handlers by message: now (s) and the packet to the payload of the answer."""
        text, number, flight = messages.encode_text, self._number, self.flight
        return {
            MessageId.STICKS: self._on_sticks,
            MessageId.TAKE_OFF: lambda _s, _p: STATUS_OK if flight.take_off() else STATUS_REFUSED,
            MessageId.LAND: self._on_land,
            # no hand: it hovers
            MessageId.PALM_LAND: lambda _s, _p: STATUS_OK if flight.flying else STATUS_REFUSED,
            MessageId.FLIP: lambda _s, _p: STATUS_REFUSED,
            MessageId.THROW_AND_GO: lambda _s, _p: STATUS_REFUSED,
            MessageId.SET_HEIGHT_LIMIT: lambda _s, p: self._set(
                "height_limit_m", struct.unpack("<B", p.payload[:1])[0]
            ),
            MessageId.SET_TILT_LIMIT: lambda _s, p: self._set(
                "lean_limit_deg", struct.unpack("<f", p.payload[:4])[0]
            ),
            MessageId.SET_LOW_BATTERY: self._on_low_battery,
            MessageId.GET_HEIGHT_LIMIT: lambda _s, _p: number("<H", int(flight.height_limit_m)),
            MessageId.GET_TILT_LIMIT: lambda _s, _p: number("<f", flight.lean_limit_deg),
            MessageId.GET_LOW_BATTERY: lambda _s, _p: number("<H", int(self.battery.low_percent)),
            MessageId.GET_SSID: lambda _s, _p: text(self._names["ssid"]),
            MessageId.GET_PASSWORD: lambda _s, _p: text(self._names["password"]),
            MessageId.SET_SSID: lambda _s, _p: STATUS_OK,  # holds once it is switched on again
            MessageId.SET_PASSWORD: lambda _s, _p: STATUS_OK,
            MessageId.VERSION: lambda _s, _p: messages.encode_version(self.parameters.firmware),
            MessageId.LOADER_VERSION: lambda _s, _p: messages.encode_version("01.00.00.00"),
            MessageId.START_VIDEO: self._on_start_video,
            MessageId.SET_ENCODER_RATE: self._on_encoder_rate,
            MessageId.GET_ENCODER_RATE: lambda _s, _p: number("<B", self.encoder_rate),
            MessageId.SET_VIDEO_MODE: self._on_video_mode,
            MessageId.SET_EXPOSURE: lambda _s, _p: STATUS_OK,
            MessageId.SET_DYNAMIC_RATE: lambda _s, _p: STATUS_OK,
            MessageId.SET_STABILISATION: lambda _s, _p: STATUS_OK,
            MessageId.TAKE_PICTURE: lambda _s, _p: STATUS_REFUSED,
            MessageId.START_CALIBRATION: lambda _s, _p: STATUS_OK,
            # nobody turns it: it never goes on
            MessageId.CALIBRATION_STATUS: lambda _s, _p: bytes(5),
        }

    @staticmethod
    def _number(form: str, value) -> bytes:
        return STATUS_OK + struct.pack(form, value)

    def _on_sticks(self, now_s: float, packet: Packet) -> bytes:
        self.flight.sticks(now_s, messages.decode_sticks(packet.payload))
        return b""

    def _on_land(self, _now_s: float, packet: Packet) -> bytes:
        """0 lands, 1 stops a landing."""
        self.flight.cancel_landing() if packet.payload[:1] == b"\x01" else self.flight.land()
        return STATUS_OK

    def _set(self, name: str, value: float) -> bytes:
        if not 0.0 < value <= 100.0:  # also what is no number
            return STATUS_REFUSED
        setattr(self.flight, name, value)
        return STATUS_OK

    def _on_low_battery(self, _now_s: float, packet: Packet) -> bytes:
        percent = int.from_bytes(packet.payload[:2], "little")
        if not packet.payload or percent > 100:
            return STATUS_REFUSED
        self.battery.low_percent = float(percent)
        return STATUS_OK

    def _on_start_video(self, _now_s: float, _packet: Packet) -> bytes:
        self.video_wanted = self.key_picture_wanted = True
        return STATUS_OK

    def _on_encoder_rate(self, _now_s: float, packet: Packet) -> bytes:
        if not packet.payload or packet.payload[0] > 5:
            return STATUS_REFUSED
        self.encoder_rate = packet.payload[0]
        return STATUS_OK

    def _on_video_mode(self, _now_s: float, packet: Packet) -> bytes:
        """0 is 4:3, which it has; 1 is 16:9, a part of the same picture, which it has not."""
        return STATUS_OK if packet.payload[:1] == b"\x00" else STATUS_REFUSED

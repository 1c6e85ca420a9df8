# SPDX-License-Identifier: Apache-2.0
"""What the Tello's messages hold. Numbers and layouts: tellopy 0.7.0 and the protocol page of
tellopilots.com."""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Optional

CONNECT, CONNECTED = b"conn_req:", b"conn_ack:"
EMERGENCY = b"emergency"
STATUS_OK, STATUS_REFUSED = b"\x00", b"\x01"
_FLIGHT = struct.Struct("<hhhhhBBBhhBBBBBBB")
_CENTRE, _THROW = 1024, 660.0
_AXIS = 0x7FF


class MessageId(IntEnum):
    """Numbers of messages, named as what they do."""

    GET_SSID = 0x0011
    SET_SSID = 0x0012
    GET_PASSWORD = 0x0013
    SET_PASSWORD = 0x0014
    WIFI = 0x001A
    SET_ENCODER_RATE = 0x0020
    SET_DYNAMIC_RATE = 0x0021
    SET_STABILISATION = 0x0024
    START_VIDEO = 0x0025
    GET_ENCODER_RATE = 0x0028
    TAKE_PICTURE = 0x0030
    SET_VIDEO_MODE = 0x0031
    SET_EXPOSURE = 0x0034
    LIGHT = 0x0035
    VERSION = 0x0045
    TIME = 0x0046
    LOADER_VERSION = 0x0049
    STICKS = 0x0050
    TAKE_OFF = 0x0054
    LAND = 0x0055
    FLIGHT = 0x0056
    SET_HEIGHT_LIMIT = 0x0058
    START_CALIBRATION = 0x005A
    CALIBRATION_STATUS = 0x005B
    FLIP = 0x005C
    THROW_AND_GO = 0x005D
    PALM_LAND = 0x005E
    LOG_HEADER = 0x1050
    LOG_DATA = 0x1051
    LOG_CONFIG = 0x1052
    SET_LOW_BATTERY = 0x1055
    GET_HEIGHT_LIMIT = 0x1056
    GET_LOW_BATTERY = 0x1057
    SET_TILT_LIMIT = 0x1058
    GET_TILT_LIMIT = 0x1059


class FlyMode(IntEnum):
    """``fly_mode`` of the flight data, numbered as DJI's flight controllers do."""

    ATTITUDE = 1
    POSITION = 6
    TAKE_OFF = 11
    LANDING = 12


@dataclass(frozen=True)
class TelloSticks:
    """-1..1 each: roll to the right, pitch forward, throttle up, yaw to the right; the switch for
    fast mode."""

    roll: float = 0.0
    pitch: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0
    fast: bool = False


@dataclass(frozen=True)
class FlightData:
    """What message 0x0056 says. Speeds in its axes north, east, down; ``percent`` of the
    battery."""

    height_m: float = 0.0
    v_ned_mps: tuple = (0.0, 0.0, 0.0)
    flown_s: float = 0.0
    percent: int = 100
    volts: float = 4.2
    left_s: float = 780.0
    sees_ground: bool = True
    windy: bool = False
    flying: bool = False
    on_ground: bool = True
    motors: bool = False
    hovers: bool = False
    low: bool = False
    critical: bool = False
    mode: FlyMode = FlyMode.POSITION
    camera: int = 0
    hot: bool = False


def decode_connect(data: bytes) -> Optional[int]:
    """Video port of a connection request; None where it is none.

    >>> decode_connect(b"conn_req:" + bytes([0x96, 0x17]))
    6038
    """
    if not data.startswith(CONNECT) or len(data) != len(CONNECT) + 2:
        return None
    return struct.unpack_from("<H", data, len(CONNECT))[0]


def encode_connected(video_port: int) -> bytes:
    """The answer to a connection request."""
    return CONNECTED + struct.pack("<H", video_port)


def decode_sticks(payload: bytes) -> TelloSticks:
    """Sticks of a payload of 6 bytes and more (a clock follows). Raises ValueError where it is
    shorter.

    Four axes of 11 bits, 1024 in the middle, 660 to either side; bit 44 is the fast mode.
    """
    if len(payload) < 6:
        raise ValueError(f"sticks of {len(payload)} bytes; 6 are needed")
    packed = int.from_bytes(payload[:6], "little")
    axes = [((packed >> shift & _AXIS) - _CENTRE) / _THROW for shift in (0, 11, 22, 33)]
    return TelloSticks(*(min(1.0, max(-1.0, axis)) for axis in axes), bool(packed >> 44 & 1))


def encode_flight(data: FlightData) -> bytes:
    """24 bytes of flight data, as firmware since 2018 sends them."""
    d, dm = data, lambda value: max(-32768, min(32767, int(round(10.0 * value))))
    sensors = 0x01 | 0x02 | 0x04 * d.sees_ground | 0x80 * d.windy
    flags = (
        0x01 * d.flying
        | 0x02 * d.on_ground
        | 0x04 * d.motors
        | 0x08 * d.hovers
        | 0x20 * d.low
        | 0x40 * d.critical
    )
    return _FLIGHT.pack(
        dm(d.height_m),
        *(dm(v) for v in d.v_ned_mps),
        dm(d.flown_s),
        sensors,
        0,
        int(d.percent),
        int(1000 * d.volts),
        min(32767, int(d.left_s)),
        flags,
        int(d.mode),
        0,
        d.camera,
        7 * d.motors,
        0,
        0x01 * d.hot,
    )


def encode_text(text: str) -> bytes:
    """Status, length, characters: how names are answered."""
    return STATUS_OK + bytes([len(text)]) + text.encode("ascii")


def encode_version(version: str) -> bytes:
    """Status and 30 characters."""
    return STATUS_OK + version.encode("ascii").ljust(30, b"\x00")

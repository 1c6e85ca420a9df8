# SPDX-License-Identifier: Apache-2.0
"""Records of the Tello's flight log (message 0x1051): framed, with a payload that is XORed by its
tick's low byte.

Frames: the log's world has z down and x where the vehicle looked when it was switched on; its body
is forward, right, down. Layouts: tellopy 0.7.0 and TelloSwift's Protocol.h; the IMU's 120 bytes as
recorded from a real Tello (tests/data of tellopy's repository, flight of 2026-09-27): the
accelerometer in units of g, -1 on z at rest.
"""

import struct
from typing import Sequence

from fcsv_sim.tello.packets import crc8, crc16

TICKS_PER_S = 2344062.0
MVO, IMU, GYRO, TOF, CONTROL = 29, 2048, 1305, 16, 1306
POSITION_BITS, VELOCITY_BITS = 0x70, 0x07  # of MVO's byte 76: which of x, y, z hold
G_MPS2 = 9.81


def tick_of(since_boot_s: float) -> int:
    """The drone's 32-bit counter; it wraps every half hour."""
    return int(since_boot_s * TICKS_PER_S) & 0xFFFFFFFF


def record(number: int, tick: int, payload: bytes) -> bytes:
    """One record: 0x55, length, CRC-8, number, tick, XORed payload, CRC-16."""
    start = struct.pack("<BH", 0x55, len(payload) + 12)
    head = start + struct.pack("<BHI", crc8(start), number, tick)
    key = tick & 0xFF
    body = head + bytes(byte ^ key for byte in payload)
    return body + struct.pack("<H", crc16(body))


def mvo(
    v_ned_mps, p_ned_m, height_m: float, valid: int, observations: int, sigma_m: float = 0.05
) -> bytes:
    """Visual odometry, 80 bytes: velocity (cm/s), position (m), covariances, height, and which of
    them hold."""
    p, v = sigma_m**2, 0.04**2
    return struct.pack(
        "<H3h3f6f6fffB3x",
        observations & 0xFFFF,
        *(_short(100.0 * x) for x in v_ned_mps),
        *p_ned_m,
        p,
        0.0,
        0.0,
        p,
        0.0,
        p,
        v,
        0.0,
        0.0,
        v,
        0.0,
        v,
        height_m,
        0.01,
        valid,
    )


def imu(
    accel_frd_mps2, gyro_frd_radps, q_wxyz, a_ned_mps2, v_ned_mps, height_m: float, celsius: float
) -> bytes:
    """Attitude record, 120 bytes. Accelerations in the body are written in g; ``a_ned_mps2`` is
    without gravity."""
    return struct.pack(
        "<2d21f3hh2x10x",
        0.0,
        0.0,
        height_m,
        *(a / G_MPS2 for a in accel_frd_mps2),
        *gyro_frd_radps,
        height_m,
        *q_wxyz,
        *a_ned_mps2,
        *v_ned_mps,
        0.0,
        0.0,
        0.0,
        0,
        0,
        0,
        _short(100.0 * celsius),
    )


def gyro(rates_frd_radps: Sequence) -> bytes:
    """Three stages of the gyroscope's filter, 37 bytes."""
    return b"\x02" + struct.pack("<9f", *(float(x) for stage in rates_frd_radps for x in stage))


def tof(height_m: float, counter: int) -> bytes:
    """The time-of-flight sensor below, in millimetres (the unit is not confirmed)."""
    return struct.pack("<hBB", _short(1000.0 * height_m), 1, counter & 0xFF)


def control(columns: Sequence[float]) -> bytes:
    """Internal quantities of its controller: eight numbers behind six bytes that nobody knows."""
    return bytes(6) + struct.pack("<8h", *(_short(c) for c in columns))


def _short(value: float) -> int:
    return max(-32768, min(32767, int(round(value))))

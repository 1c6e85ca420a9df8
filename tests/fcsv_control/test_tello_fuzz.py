# SPDX-License-Identifier: Apache-2.0
"""What no Tello would send, at the ports of its link and in its decoders: nothing dies, a Tello is
heard after it."""

import random
import socket
import struct
import time

import numpy as np
from support.waiting import within
from tellopy._internal import crc, protocol

from fcsv_control.tello.library import Hears, RadioParameters, TelloRadio
from fcsv_control.tello.telemetry import OwnOdometry, flight_report
from fcsv_control.tello.video import Video
from fcsv_sim.machines.machines import free_port

INPUTS = 10_000
FLIGHT, LOG, WIFI = 0x0056, 0x1051, 0x001A
NUMBERS = [FLIGHT, LOG, WIFI, 0x0035, 0x1050, 0x1052, 0x0062, 0x0063, 0x0046, 0x005B, 0x0045]
# 1.5 m, 63 %, in the air
FLYING = bytes([15, 0]) + bytes(10) + bytes([63]) + bytes(4) + bytes([1]) + bytes(6)


def noise(random_, size):
    return random_.getrandbits(8 * size).to_bytes(size, "little") if size else b""


def packet(message, payload):
    """As a Tello sends it, with right checksums."""
    head = struct.pack("<BH", 0xCC, len(payload) + 11 << 3)
    whole = head + struct.pack("<BBHH", crc.crc8(bytearray(head)), 0x88, message, 0) + payload
    return whole + struct.pack("<H", crc.crc16(bytearray(whole)))


def record(random_, number, payload):
    """A record of a log with its own length and key, as it is within a log message."""
    key = random_.randrange(256)
    head = struct.pack("<BBBBHI", 0x55, len(payload) + 12, 0, 0, number, random_.getrandbits(32))
    return head[:6] + bytes([key]) + head[7:] + bytes(b ^ key for b in payload)


def garbage(random_):
    """Noise; packets of any kind with any payload; such that are cut or changed; logs with records
    of noise."""
    payload = noise(random_, random_.choice([0, 1, 2, 9, 23, 24, 40, 200]))
    if random_.random() < 0.3:
        records = [
            record(
                random_, random_.choice([29, 2048, 7]), noise(random_, random_.choice([3, 80, 132]))
            )
        ]
        payload = b"\x00" + b"".join(records) + payload
    good = packet(random_.choice([*NUMBERS, random_.randrange(1 << 16)]), payload)
    at = random_.randrange(len(good))
    return random_.choice(
        [
            good,
            good,
            good,
            good[:at],
            good[:at] + bytes([good[at] ^ 1 << random_.randrange(8)]) + good[at + 1 :],
            noise(random_, random_.randrange(1, 300)),
            b"conn_ack:" + noise(random_, random_.randrange(3)),
        ]
    )


until = within(5.0)


def test_ten_thousand_strange_inputs_end_no_link_of_a_tello(capfd):
    random_, reports, own, motions = random.Random(1), [], OwnOdometry(), []
    hears = Hears(
        flight=lambda _s, data: reports.append(flight_report(data)),
        imu=lambda s, imu: motions.append(own.imu(s, imu)),
        packet=lambda _s: None,
        video=lambda _s, _data: None,
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tello:
        tello.bind(("127.0.0.1", 0))
        port, pictures = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
        radio = TelloRadio(
            "uav1",
            RadioParameters(
                address="127.0.0.1",
                tello_port=tello.getsockname()[1],
                port=port,
                video_port=pictures,
            ),
            hears,
        )
        try:
            for k in range(INPUTS):
                tello.sendto(garbage(random_), ("127.0.0.1", port))
                if k % 20 == 0:
                    tello.sendto(noise(random_, random_.randrange(1, 100)), ("127.0.0.1", pictures))
                    time.sleep(0.002)  # its thread shall take them
            until(lambda: len(reports) > INPUTS // 100)  # some were flight data
            assert all(thread.is_alive() for thread in radio._threads)
            reports.clear()
            until(
                lambda: (
                    tello.sendto(packet(FLIGHT, FLYING), ("127.0.0.1", port))
                    and any(
                        r is not None and r.in_the_air and abs(r.height_m - 1.5) < 1e-9
                        for r in reports
                    )
                )
            )
        finally:
            radio.close()
    assert all(
        m is None or np.isfinite(m.T_own_body).all() and np.isfinite(m.v_body_mps).all()
        for m in motions
    )
    capfd.readouterr()  # tellopy prints what it does not understand


def test_ten_thousand_strange_records_leave_no_odometry_that_is_no_number():
    random_, own = random.Random(2), OwnOdometry()
    edges = [float("nan"), float("inf"), -float("inf"), 3e38, -3e38, 1e-40, 0.0, 1.0]
    names = "acc_x acc_y acc_z gyro_x gyro_y gyro_z q0 q1 q2 q3 vg_x vg_y vg_z".split()
    for k in range(INPUTS):
        imu = protocol.LogImuAtti()
        for name in names:
            setattr(
                imu,
                name,
                random_.choice(edges) if random_.random() < 0.2 else random_.uniform(-1.0, 1.0),
            )
        motion = own.imu(0.1 * k, imu)
        assert (
            motion is None
            or np.isfinite(
                np.hstack(
                    [
                        motion.T_own_body.ravel(),
                        motion.v_body_mps,
                        motion.gyro_radps,
                        motion.accel_mps2,
                    ]
                )
            ).all()
        )


def test_ten_thousand_strange_datagrams_end_no_video():
    random_, video = random.Random(3), Video()
    for k in range(INPUTS):
        start = random_.choice(
            [b"", b"\x00\x00\x00\x01\x67", b"\x00\x00\x01\x65", b"\x00\x00\x01\x41"]
        )
        number = bytes([k // 3 & 0xFF, random_.choice([0, 1, 0x82, random_.randrange(256)])])
        head = number[: random_.choice([0, 1, 2, 2, 2, 2])]
        video.add(0.01 * k, head + start + noise(random_, random_.randrange(60)))
    assert sum(video.dropped.values()) > INPUTS // 100

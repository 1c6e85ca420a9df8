# SPDX-License-Identifier: Apache-2.0
"""The simulated Tello's video: how it is cut, and that unmodified tellopy and PyAV see the world
with it."""

import os
import signal
import subprocess
import sys
import threading
import time

import av
import cv2
import numpy as np
import psutil
import pytest
from support.tello_air import free_udp_port, until
from support.towns import street_renderer

from fcsv_geometry import transforms
from fcsv_sim.sensors.camera import CameraParameters
from fcsv_sim.tello.encoder import Encoder
from fcsv_sim.tello.pictures import SimulatedVideoParameters
from fcsv_sim.tello.radio import WifiParameters
from fcsv_sim.tello.video import MOST_PACKETS, Packets, units

SMALL = CameraParameters(width=480, height=360, horizontal_fov_deg=70.1)
FIRST_S = 120.0  # a machine that has not compiled the renderer yet


def kinds(datagrams):
    """NAL unit types in order."""
    return [u[4] & 0x1F for u in units(b"".join(d[2:] for d in datagrams))]


def noisy(seed, size=(90, 120)):
    """A picture that no encoder makes small."""
    return np.random.default_rng(seed).integers(0, 255, (*size, 3), np.uint8)


def smooth(k, size=(90, 120)):
    v, u = np.mgrid[: size[0], : size[1]]
    values = 127 + 60 * np.sin(u / 17.0 + 0.2 * k) + 60 * np.cos(v / 13.0)
    return np.repeat(values[..., None], 3, 2).astype(np.uint8)


def test_a_key_picture_begins_with_its_parameter_sets_and_others_have_none():
    encoder, packets = Encoder(120, 90, 5.0), Packets()
    cut = [packets.cut(encoder.encode(smooth(k), 2e6, k == 3)) for k in range(5)]
    assert [kinds(c) for c in cut] == [[7, 8, 5], [1], [1], [7, 8, 5], [1]]
    for k, datagrams in enumerate(cut):
        assert [d[0] for d in datagrams] == [k] * len(datagrams)
        assert [d[1] & 0x7F for d in datagrams] == list(range(len(datagrams)))
        assert [d[1] >> 7 for d in datagrams] == [0] * (len(datagrams) - 1) + [1]
        assert max(len(d) for d in datagrams) <= 1460


def test_what_is_cut_decodes_to_the_pictures():
    encoder, packets, decoder = (
        Encoder(120, 90, 5.0),
        Packets(),
        av.CodecContext.create("h264", "r"),
    )
    stream = b"".join(
        d[2:] for k in range(6) for d in packets.cut(encoder.encode(smooth(k), 2e6, not k))
    )
    seen = [
        f.to_ndarray(format="rgb24")
        for p in [*decoder.parse(stream), *decoder.parse()]
        for f in decoder.decode(p)
    ]
    assert len(seen) == 6
    for k, picture in enumerate(seen):
        # of 255, at constant rate factor 33
        assert np.abs(picture.astype(float) - smooth(k)).mean() < 4.0
        assert np.abs(picture.astype(float) - smooth(k + 3)).mean() > 12.0


def test_a_picture_that_cannot_be_numbered_is_not_sent():
    datagrams = Packets().cut(b"\x00\x00\x00\x01\x65" + bytes([0xAA]) * 1458 * MOST_PACKETS)
    assert not datagrams and not Packets().cut(b"no video")


def test_numbers_of_pictures_wrap():
    packets, unit = Packets(), b"\x00\x00\x00\x01\x41\xaa"
    assert [packets.cut(unit)[0][0] for _ in range(257)][-2:] == [255, 0]


def test_fewer_bits_where_the_client_asks_for_fewer():
    lengths = []
    for bit_per_s in (1e6, 4e6):
        encoder = Encoder(960, 720, 5.0)
        lengths.append(
            sum(len(encoder.encode(noisy(k, (720, 960)), bit_per_s, not k)) for k in range(20))
        )
    # 4 s, and a second of buffer
    assert lengths[0] < 0.5 * lengths[1] and lengths[0] * 8 < 1.5 * (4.0 * 1e6 + 1e6)


def video(**changes):
    return SimulatedVideoParameters(
        "street", vehicles_dir="config/vehicles", rate_hz=5.0, camera=SMALL, **changes
    )


def notes(folder):
    rows = [
        line.split(",")
        for line in (folder / "truth_cameras_tello1.csv").read_text().splitlines()[1:]
    ]
    return [
        transforms.from_xyz_quaternion(*np.split(np.array(row[2:], float), [3])) for row in rows
    ]


def like(a, b):
    """Correlation of two pictures' grey values, whatever their exposure."""
    flat = [
        cv2.GaussianBlur(cv2.cvtColor(p, cv2.COLOR_RGB2GRAY).astype(float), (0, 0), 2.0).ravel()
        for p in (a, b)
    ]
    return float(np.corrcoef(*flat)[0, 1])


class Watcher:
    """Decodes tellopy's own video stream in a thread, as its examples do.

    The stream ends for good where nothing comes for 5 s: it is asked for once the Tello sends.
    """

    def __init__(self, client):
        client.tello.start_video()
        until(lambda: client.events["video_data"], FIRST_S, "video")
        self.pictures, self._stream = [], client.tello.get_video_stream()
        self._thread = threading.Thread(target=self._decode, daemon=True)
        self._thread.start()

    def _decode(self):
        container = av.open(
            self._stream, format="h264", options={"probesize": "4096", "analyzeduration": "0"}
        )
        for frame in container.decode(video=0):
            self.pictures.append(frame.to_ndarray(format="rgb24"))


def test_tellopys_video_stream_shows_the_world_from_where_it_is(
    tello_air, tmp_path, root, monkeypatch
):
    monkeypatch.chdir(root)
    network = tello_air.network()
    clear = WifiParameters(loss=0.0)
    drone = tello_air.drone(network, start_xyz_yaw=(3.0, 0.5, 0.0, 0.0), radio=clear, video=video())
    client = tello_air.client(network).connect()
    client.tello.takeoff()
    watcher = Watcher(client)
    until(lambda: watcher.pictures, FIRST_S, "a picture")
    until(lambda: drone.drone.flight.state == "FLY", 15.0, "in the air")
    begun = len(notes(tmp_path))
    client.tello.set_yaw(0.4)
    until(lambda: abs(drone.drone.drone.felt.yaw_rad) > 1.0, 20.0, "turns")
    client.tello.set_yaw(0.0)
    until(lambda: len(watcher.pictures) > begun + 8, 60.0, "pictures")
    pictures, poses = list(watcher.pictures), notes(tmp_path)
    assert pictures[0].shape == (360, 480, 3) and not client.tello.video_data_loss
    renderer = street_renderer()
    seen = [renderer.render(pose, SMALL.model, samples=1)[0] for pose in poses]
    # of the noted poses that pictures show: a busy decoder leaves some out, so counting does not
    # tell
    order = []
    for k in np.linspace(0, len(pictures) - 1, 5).astype(int):
        likeness = [like(pictures[k], s) for s in seen]
        order.append(int(np.argmax(likeness)))
        assert max(likeness) > 0.95
    assert order[-1] > begun > order[0]
    assert like(pictures[0], seen[order[-1]]) < 0.8  # it has turned by a radian


def test_pictures_come_again_after_loss_and_after_its_camera_died(tello_air, root, monkeypatch):
    """One of 50 packets lost: a picture that is broken stays so until the next key picture, which
    tellopy asks for.

    Of some 20 packets of a key picture all arrive in two of three cases.
    """
    monkeypatch.chdir(root)
    network = tello_air.network()
    drone = tello_air.drone(network, radio=WifiParameters(loss=0.02), video=video())
    client = tello_air.client(network).connect()
    client.tello.start_video()
    until(lambda: len(client.events["video_data"]) > 50, FIRST_S, "video")
    until(lambda: client.tello.video_data_loss, FIRST_S, "tellopy counts what is lost")
    first = drone.shell.camera.pid
    os.kill(first, signal.SIGKILL)
    until(lambda: drone.shell.camera.pid != first, 10.0, "its camera is started again")
    again_s = time.monotonic()
    until(
        lambda: decoded([d for s, d in client.events["video_data"] if s > again_s]) > 3,
        FIRST_S,
        "pictures again",
    )


def test_its_camera_ends_with_it_whatever_kills_it(tmp_path, root):
    command = [
        sys.executable,
        "-m",
        "fcsv_sim.tello.command",
        "--address",
        "127.0.0.1",
        "--port",
        str(free_udp_port()),
        "--sim-dir",
        str(tmp_path),
        "--world",
        "field",
    ]
    process = subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE)
    try:
        process.stdout.readline()
        camera = until(lambda: psutil.Process(process.pid).children(), 20.0, "its camera")[0]
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    until(
        lambda: not camera.is_running() or camera.status() == psutil.STATUS_ZOMBIE,
        FIRST_S,
        "its camera ends",
    )


def decoded(datagrams):
    """How many pictures come out of them."""
    decoder, count = av.CodecContext.create("h264", "r"), 0
    for data in datagrams:
        for packet in decoder.parse(data[2:]):
            try:
                count += len(decoder.decode(packet))
            except av.error.InvalidDataError:
                continue
    return count


def test_no_picture_before_it_is_asked_for_and_none_without_a_client(tello_air, root, monkeypatch):
    monkeypatch.chdir(root)
    network = tello_air.network()
    drone = tello_air.drone(network, video=video())
    client = tello_air.client(network).connect()
    time.sleep(3.0)
    assert not drone.shell.camera.sent and not client.events["video_data"]
    pid = drone.shell.camera.pid
    drone.close()
    tello_air._things.remove(drone)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)

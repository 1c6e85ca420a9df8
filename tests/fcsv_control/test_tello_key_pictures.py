# SPDX-License-Identifier: Apache-2.0
"""A radio that loses packets: how long nothing is shown, with and without requests for key pictures
at once."""

import doctest
import socket

import numpy as np
import pytest

from fcsv_control.tello import key_pictures
from fcsv_control.tello.key_pictures import KeyPictures
from fcsv_control.tello.library import Hears, RadioParameters, TelloRadio
from fcsv_control.tello.video import Video
from fcsv_sim.machines.machines import free_port
from fcsv_sim.tello.encoder import Encoder
from fcsv_sim.tello.messages import MessageId
from fcsv_sim.tello.packets import decode
from fcsv_sim.tello.radio import SimulatedWifi
from fcsv_sim.tello.radio import WifiParameters as Air
from fcsv_sim.tello.video import Packets

RATE_HZ, DELAY_S, FLOWN_S = 5.0, 0.1, 120.0
TELLOPY_ASKS_S = 2.0  # docs/design/trackers.md#the-simulated-tello
SPECKLE = np.random.default_rng(1).integers(0, 90, (136, 180, 3), dtype=np.uint8)


def drawn(k):
    """Structure that moves, detailed enough for key pictures of many packets."""
    y, x = np.mgrid[0:136, 0:180]
    red = 80 + 60 * np.sin((x + 5 * k) / 12.0) * np.cos(y / 17.0)
    return np.dstack([red, red[:, ::-1], 160 - red]).astype(np.uint8) + SPECKLE


class Burst:
    """Packets are lost in runs: a run begins at one of ``apart`` packets, and takes ``long`` on
    average."""

    def __init__(self, apart, long, seed=5):
        self._random, self._apart, self._long, self._in = (
            np.random.default_rng(seed),
            apart,
            long,
            False,
        )

    def takes(self):
        self._in = self._random.random() < (
            1.0 - 1.0 / self._long if self._in else 1.0 / self._apart
        )
        return self._in


def flown(at_once, loss=0.0, burst=None):
    """(gaps between pictures that were shown (s), key pictures sent, requests): the simulated
    Tello's encoder, packets and radio, which give key pictures only where one was asked for."""
    encoder, packets, radio = (
        Encoder(180, 136, RATE_HZ),
        Packets(),
        SimulatedWifi(Air(loss=loss), 3, 0.0),
    )
    video, keys = Video(), KeyPictures()
    asked_s, key, sent_keys, requests = -np.inf, False, 0, 0
    waits, shown, k, now_s = [], [0.0], 0, 0.0
    while now_s < FLOWN_S:
        now_s += 0.01
        if now_s - asked_s >= TELLOPY_ASKS_S:
            asked_s, requests = now_s, requests + 1
            radio.send(now_s, True, "key")
        key = bool(radio.arrived(now_s, True)) or key
        if now_s >= k / RATE_HZ:
            waits.append((now_s + DELAY_S, packets.cut(encoder.encode(drawn(k), 4e6, key))))
            sent_keys, key, k = sent_keys + key, False, k + 1
        while waits and waits[0][0] <= now_s:
            for datagram in waits.pop(0)[1]:
                if burst is None or not burst.takes():
                    radio.send(now_s, False, datagram)
        for datagram in radio.arrived(now_s, False):
            picture = video.add(now_s, datagram)
            if picture is not None:
                shown.append(now_s)
            if at_once and keys.due(now_s, video.broken):
                requests += 1
                radio.send(now_s, True, "key")
    return np.diff([*shown, now_s]), sent_keys, requests


@pytest.mark.parametrize("loss, burst", [(0.05, None), (0.0, (60, 4))])
def test_after_a_loss_pictures_come_again_sooner_than_by_tellopys_requests(loss, burst):
    """Each loss costs up to 2 s until tellopy asks, and as long again where the key picture loses a
    packet, too."""
    (before, _, _), (now, _, _) = (
        flown(at_once, loss, burst and Burst(*burst)) for at_once in (False, True)
    )
    lost_before_s, lost_s = (gaps[gaps > 1.0].sum() for gaps in (before, now))
    print(
        f"loss {loss}, bursts {burst}: more than 1 s without a picture: {lost_before_s:.0f} s of {FLOWN_S:.0f} s, "
        f"now {lost_s:.0f} s; the longest {before.max():.1f} s, now {now.max():.1f} s"
    )
    assert before.max() > 4.0 and lost_before_s > 0.3 * FLOWN_S  # the fault is shown
    assert now.max() < 0.6 * before.max() and lost_s < 0.5 * lost_before_s


def test_where_nothing_is_lost_nothing_is_asked_for():
    gaps, keys, requests = flown(True)
    assert gaps[1:].max() < 0.5 and requests == FLOWN_S / TELLOPY_ASKS_S and keys == requests


def test_doctests():
    result = doctest.testmod(key_pictures)
    assert result.attempted and not result.failed


def test_requests_are_half_a_second_apart_and_end_with_the_key_picture():
    keys = KeyPictures()
    asked_s = [t for t in np.arange(0.0, 3.0, 0.01) if keys.due(t, broken=0.2 <= t < 1.9)]
    assert asked_s == pytest.approx([0.2, 0.7, 1.2, 1.7], abs=0.011) and keys.asked == 4


def test_a_radio_that_was_not_asked_for_video_asks_for_no_key_picture(monkeypatch):
    sent = []
    ports = [free_port(socket.SOCK_DGRAM) for _ in range(3)]
    own = RadioParameters(
        address="127.0.0.1", tello_port=ports[0], port=ports[1], video_port=ports[2]
    )
    nothing = lambda *_: None  # noqa: E731
    radio = TelloRadio("uav1", own, Hears(nothing, nothing, nothing, nothing))
    try:
        monkeypatch.setattr(
            radio._tello,
            "send_packet",
            lambda packet: sent.append(bytes(packet.get_buffer())) or True,
        )
        radio.key_picture()
        assert not sent
        radio._tello.video_enabled = True
        radio.key_picture()
    finally:
        radio.close()
    assert MessageId.START_VIDEO in [decode(data).message for data in sent]


def test_what_comes_is_broken_from_a_loss_until_a_key_picture_is_on_its_way():
    """Nothing is asked for before anything came, nor while the answer is coming."""
    encoder, packets = Encoder(180, 136, RATE_HZ), Packets()
    first, second, third, key = (
        packets.cut(encoder.encode(drawn(k), 4e6, k in (0, 3))) for k in range(4)
    )
    video = Video()
    assert not video.broken

    def after(datagrams):
        for datagram in datagrams:
            video.add(0.0, datagram)
        return video.broken

    assert not after(first)
    assert after([*second[:-1], third[0]])  # its last packet was lost
    assert not after(key[:1])
    assert not after(key[1:-1])
    # the key picture lost its last one, too
    assert after([bytes([key[0][0] + 1, 0x80]) + third[0][2:]])

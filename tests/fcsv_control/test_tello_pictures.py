# SPDX-License-Identifier: Apache-2.0
"""A Tello's video from datagrams: pictures at once, and none that is smeared."""

import numpy as np
import pytest

from fcsv_control.tello.video import Video
from fcsv_sim.tello.encoder import Encoder
from fcsv_sim.tello.video import Packets

KEYS = (0, 6)


def drawn(k):
    """Structure that moves: 120 x 90."""
    y, x = np.mgrid[0:90, 0:120]
    red = 127 + 100 * np.sin((x + 9 * k) / 12.0) * np.cos(y / 17.0)
    return np.dstack([red, red[:, ::-1], 255 - red]).astype(np.uint8)


@pytest.fixture(scope="module")
def sent():
    """Datagrams of 12 pictures, of which 0 and 6 are key pictures; detailed enough for several
    packets each."""
    encoder, packets, noise = Encoder(120, 90, 5.0), Packets(), np.random.default_rng(1)
    speckle = noise.integers(0, 40, (90, 120, 3), dtype=np.uint8)
    return [
        packets.cut(encoder.encode(drawn(k) // 2 + speckle, 4e6, k in KEYS)) for k in range(12)
    ], speckle


def shown(video, pictures, without=(), start_s=100.0):
    """By its number, what came of each picture; its first packet arrives 1 s after the one of the
    picture before."""
    found = {}
    for k, datagrams in enumerate(pictures):
        for n, datagram in enumerate(datagrams):
            picture = None if (k, n) in without else video.add(start_s + k + 0.01 * n, datagram)
            if picture is not None:
                found[k] = picture
    return found


def test_each_picture_comes_with_its_last_packet_and_the_stamp_of_its_first(sent):
    pictures, speckle = sent
    assert min(len(pictures[k]) for k in KEYS) >= 3  # parameter sets, and the picture
    found = shown(Video(), pictures)
    assert sorted(found) == list(range(12))
    for k, picture in found.items():
        assert picture.arrived_s == 100.0 + k
        off = [
            np.abs(picture.rgb.astype(float) - (drawn(j) // 2 + speckle)).mean() for j in range(12)
        ]
        assert np.argmin(off) == k


@pytest.mark.parametrize("lost", [(2, 0), (2, -1)])
def test_after_a_loss_nothing_is_shown_until_the_next_key_picture(sent, lost):
    pictures, _ = sent
    lost = (lost[0], lost[1] % len(pictures[lost[0]]))
    video = Video()
    assert sorted(shown(video, pictures, without={lost})) == [0, 1, 6, 7, 8, 9, 10, 11]
    assert (
        video.dropped["pictures with lost packets"] == 1
        and video.dropped["pictures before a key picture"] >= 2
    )


def test_a_loss_of_whole_pictures_is_seen_by_their_numbers(sent):
    pictures, _ = sent
    lost = {(k, n) for k in (2, 3) for n in range(len(pictures[k]))}
    assert sorted(shown(Video(), pictures, without=lost)) == [0, 1, 6, 7, 8, 9, 10, 11]


def test_who_listens_late_waits_for_a_key_picture(sent):
    video = Video()
    assert sorted(shown(video, sent[0][3:])) == [3, 4, 5, 6, 7, 8]  # pictures 6 to 11
    assert video.dropped["pictures before a key picture"] == 3


def test_packets_of_a_picture_out_of_order_or_twice_make_it_once(sent):
    pictures, _ = sent
    mixed = [[*reversed(p), p[0], p[-1]] for p in pictures]
    assert sorted(shown(Video(), mixed)) == list(range(12))


def test_parameter_sets_that_are_numbered_by_themselves_count_for_the_next_key_picture(sent):
    key = sent[0][0]
    sets, rest = key[:2], key[2:]
    apart = [bytes([9, k | 0x80 * (k == 1)]) + d[2:] for k, d in enumerate(sets)]
    picture = [bytes([10, k | 0x80 * (k == len(rest) - 1)]) + d[2:] for k, d in enumerate(rest)]
    assert sorted(shown(Video(), [apart, picture])) == [1]


def test_what_is_no_video_does_no_harm(sent):
    """10 000 random datagrams, and then a picture."""
    video, random = Video(), np.random.default_rng(2)
    for _ in range(10_000):
        datagram = random.bytes(random.integers(0, 60))
        start = b"\x00\x00\x00\x01\x65" if random.random() < 0.3 else b""
        video.add(0.0, datagram[:2] + start + datagram[2:])
    assert 0 in shown(video, [sent[0][6]])

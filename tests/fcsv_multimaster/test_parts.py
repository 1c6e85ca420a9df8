# SPDX-License-Identifier: Apache-2.0
"""The relay's parts without a network or a master; time is an argument."""

import doctest

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fcsv_control.mission.watches import telemetry
from fcsv_geometry.streams import arrivals
from fcsv_geometry.streams.flow import RateGate
from fcsv_multimaster import fkie
from fcsv_multimaster.errors import EndpointError, PictureError, WireError
from fcsv_multimaster.links import LinkRule, TrafficClass, load_links
from fcsv_multimaster.network import wire
from fcsv_multimaster.network.addresses import AddressWatch, local_addresses
from fcsv_multimaster.network.endpoints import parse_endpoint, parse_peers
from fcsv_multimaster.network.transport import ZenohTransport
from fcsv_multimaster.relay import order
from fcsv_multimaster.relay.measure import PeerMeasure, SignOfLife
from fcsv_multimaster.relay.outbound import Message, Pacer, Remembered, Repeater
from fcsv_multimaster.relay.parcel import Parcel
from fcsv_multimaster.relay.peer import Peer
from fcsv_multimaster.relay.picture_codec import (
    AdaptiveJpeg,
    H264Decoder,
    H264Encoder,
    decode_jpeg,
    h264_available,
)
from fcsv_multimaster.relay.sent_times import SentTimes

CRITICAL = TrafficClass("datagram", "real_time", True, max_age_s=5.0)
EVENT = TrafficClass("urgent", "data_high", True, latched=True)
BULK = TrafficClass("bulk", "background", False, max_age_s=3.0)
CAPTURE = TrafficClass("bulk", "data", True, max_age_s=10.0)


def message(number, traffic=BULK, topic="/t", born_s=0.0, size=60000):
    return Message(
        topic, LinkRule(topic, traffic), "p/T", "0" * 32, bytes(size), born_s, number, number
    )


# ---- wire ----------------------------------------------------------------------------------------


def test_a_parcel_and_every_note_come_out_as_they_went_in():
    head = wire.Head(wire.JPEG, 7, 5, 8, 6, 9, 1.5, "0123456789abcdef" * 2)
    assert wire.unpack(wire.pack(head, b"data")) == (head, b"data")
    for note in (
        wire.Ping(1, 2, 2.0, 3.0, "host a at 10.0.0.1"),
        wire.Pong(1, 2.0, 3.0, 4.0),
        wire.Acknowledgement(1, 2, True),
    ):
        assert wire.unpack_note(wire.pack_note(note)) == note


@given(st.binary(max_size=200))
def test_any_bytes_are_understood_or_refused_by_one_error(payload):
    for read in (wire.unpack, wire.unpack_note):
        try:
            read(payload)
        except WireError:
            pass


def test_another_version_of_the_language_is_named():
    head = wire.Head(wire.RAW, 1, 0, 1, 1, 0, 0.0, "0" * 32)
    with pytest.raises(WireError, match="version 5"):
        wire.unpack(b"\x05" + wire.pack(head, b"")[1:])
    with pytest.raises(WireError, match="md5"):
        wire.pack(wire.Head(wire.RAW, 1, 0, 1, 1, 0, 0.0, "*"), b"")


# ---- what is measured ----------------------------------------------------------------------------


def test_ages_follow_the_monotonic_clocks_whatever_the_wall_clocks_do():
    peer = PeerMeasure()
    assert peer.on_sign_of_life(1, 10.0) is SignOfLife.NEW
    # the peer's clock steps by an hour
    for i, wall_s in enumerate((0.0, 3600.0, 3600.0, 3600.0, 3600.0, 3600.0)):
        peer.clocks.answered(10.0 + i, 10.02 + i, 500.01 + i, wall_s)
    assert peer.clocks.age_s(500.0, 10.05) == pytest.approx(0.05)
    assert peer.clocks.wall_offset_s == 3600.0 and peer.clocks.round_trip_s == pytest.approx(0.02)


def test_a_second_machine_of_the_same_name_is_told_from_a_restart():
    peer = PeerMeasure()
    assert [
        peer.on_sign_of_life(1, 0.0),
        peer.on_sign_of_life(1, 0.5),
        peer.on_sign_of_life(2, 0.6),
        peer.on_sign_of_life(1, 0.7),
    ] == [SignOfLife.NEW, SignOfLife.SAME, SignOfLife.DOUBLE, SignOfLife.SAME]
    assert peer.on_sign_of_life(2, 5.0) is SignOfLife.NEW and not peer.alive(6.5)


def test_of_two_machines_with_one_name_the_second_does_not_take_the_place_of_the_first_in_a_cut():
    peer = PeerMeasure()
    for at_s in np.arange(0.0, 3.0, 0.25):
        assert peer.on_sign_of_life(1, at_s) is not SignOfLife.DOUBLE
        assert peer.on_sign_of_life(2, at_s + 0.1, "host b") is SignOfLife.DOUBLE
    assert peer.twin(3.0) == "host b"
    assert {peer.on_sign_of_life(2, s, "host b") for s in np.arange(3.0, 60.0, 0.5)} == {
        SignOfLife.DOUBLE
    } and not peer.alive(60.0)
    assert peer.on_sign_of_life(3, 61.0) is SignOfLife.NEW  # the first was started again
    assert (
        peer.on_sign_of_life(2, 61.1) is SignOfLife.DOUBLE
        and peer.on_sign_of_life(3, 100.0) is SignOfLife.SAME
    )
    assert (
        peer.on_sign_of_life(2, 159.0) is SignOfLife.DOUBLE
        and peer.on_sign_of_life(2, 160.1) is SignOfLife.NEW
        and peer.twin(160.1) is None
    )


def test_who_is_not_meant_by_a_peer_knows_it_but_not_right_after_his_restart():
    peer = PeerMeasure()
    for at_s in np.arange(0.0, 10.0, 0.25):
        peer.on_sign_of_life(1, at_s)
        peer.addressed(7 if at_s < 1.5 else 5, 5, at_s)
        assert not peer.displaced(at_s)
    for at_s in np.arange(10.0, 15.0, 0.25):
        peer.on_sign_of_life(1, at_s)
        peer.addressed(7, 5, at_s)
        assert peer.displaced(at_s) == (at_s > 13.0)
    assert not peer.displaced(20.0)  # it is gone itself


def test_loss_counts_gaps_and_forgives_what_comes_late():
    peer = PeerMeasure()
    for sequence in (1, 2, 5, 4, 6):
        peer.came("/t", sequence, 100, 0.01, 1.0)
    assert peer.report(2.0)["topics"]["/t"]["loss"] == pytest.approx(1 / 6)
    assert peer.overtaken("/t", 6) and not peer.overtaken("/t", 7)


# ---- what waits ----------------------------------------------------------------------------------


def test_a_command_is_repeated_until_acknowledged_and_not_when_it_is_too_old():
    repeater = Repeater()
    repeater.add(message(1, CRITICAL, size=50), 0.0)
    repeater.add(message(2, CRITICAL, size=50), 0.0)
    assert repeater.due(0.01, None) == []
    assert [m.number for m in repeater.due(0.05, None)] == [1, 2]
    repeater.acknowledged(1)
    sent = [t for t in np.arange(0.06, 8.0, 0.01) for m in repeater.due(t, 0.02)]
    assert len(sent) > 30 and max(sent) <= 5.0 and repeater.expired == 1 and len(repeater) == 0


def test_only_the_last_value_of_an_event_is_repeated():
    repeater = Repeater()
    for number in (1, 2, 3):
        repeater.add(message(number, EVENT), 0.0)
    assert [m.number for m in repeater.due(100.0, None)] == [3]


def test_pictures_that_a_slow_link_cannot_carry_get_rarer_not_older():
    """100 kB/s for 30 pictures of 60 kB a second, 20 ms away."""
    pacer, arrivals, link_free_s, number = Pacer(), [], 0.0, 0
    flying = []
    for step in range(20000):
        now_s = step * 1e-3
        for done in [f for f in flying if f[0] <= now_s]:
            flying.remove(done)
            pacer.acknowledged(done[1].number, now_s)
            arrivals.append((now_s, now_s - done[1].born_s))
        if step % 33 == 0:
            number += 1
            pacer.offer(message(number, born_s=now_s))
        m = pacer.next_message(now_s)
        if m is not None:
            pacer.sent(m, 60000, now_s)
            link_free_s = max(link_free_s, now_s) + 0.6
            flying.append((link_free_s + 0.02, m))
    late = [age_s for at_s, age_s in arrivals if at_s > 10.0]
    # the link takes 0.6 s for one: one under way and at most one begun behind it
    assert len(late) == pytest.approx(10 / 0.6, abs=2) and max(late) < 1.35
    assert pacer.limited(20.0) and 0.5e5 < pacer.budget_octets_s(20.0) < 1.5e5


def test_captures_keep_their_order_and_survive_a_cut_in_the_middle_and_starve_nobody():
    pacer = Pacer()
    pacer.offer(message(1))
    for number in (2, 3):
        pacer.offer(message(number, CAPTURE, "/c"))
    first = pacer.next_message(0.0)
    pacer.sent(first, 60000, 0.0)
    assert first.number == 2
    pacer.cut()
    assert [pacer.next_message(1.0).number for _ in range(3)] == [2, 1, 3]


def test_captures_that_were_lost_on_the_way_keep_their_order():
    pacer = Pacer()
    for number in (1, 2, 3, 4):
        pacer.offer(message(number, CAPTURE, "/c"))
    for _ in range(3):
        pacer.sent(pacer.next_message(0.0), 60000, 0.0)
    assert [pacer.next_message(5.0).number for _ in range(4)] == [1, 2, 3, 4]


@pytest.mark.parametrize("each_s", [1.6, 3.2])  # 200 kB at 1 and at 0.5 Mbit/s
def test_a_slow_link_does_not_carry_the_same_pictures_again_and_again(each_s):
    """Ten a second are wanted; a stream delivers in order, and all that is put into it."""
    pacer, stream, came, sent = Pacer(), [], [], 0
    for step in range(8000):
        now_s = step * 0.01
        while stream and stream[0][0] <= now_s:
            number = stream.pop(0)[1]
            pacer.acknowledged(number, now_s)
            came.append(number)
        if step % 10 == 0:
            pacer.offer(message(step, CAPTURE, "/c", born_s=now_s))
        m = pacer.next_message(now_s)
        if m is not None:
            sent += 1
            pacer.sent(m, 200000, now_s)
            stream.append(((stream[-1][0] if stream else now_s) + each_s, m.number))
    again = len(came) - len(set(came))
    assert len(came) > 0.95 * 80.0 / each_s - 1 and again <= 3, came
    assert list(dict.fromkeys(came)) == sorted(set(came))


def test_what_fell_into_a_cut_is_sent_again_though_the_link_was_slow_before():
    pacer = Pacer()
    for number in (1, 2, 3):
        pacer.offer(message(number, CAPTURE, "/c"))
    pacer.sent(pacer.next_message(0.0), 200000, 0.0)
    assert pacer.next_message(2.6).number == 1, "too early"
    pacer.sent(message(1, CAPTURE, "/c"), 200000, 2.6)
    pacer.acknowledged(1, 3.2)
    pacer.sent(pacer.next_message(3.3), 200000, 3.3)
    assert pacer.next_message(8.2).number == 3 and pacer.next_message(8.4).number == 2, (
        "it doubled its patience: 5 s since the last"
    )


def test_what_came_too_early_waits_but_not_for_ever():
    assert doctest.testmod(order).attempted and not doctest.testmod(order).failed
    waits = order.DeliveryOrder()
    # 6 to 8 are not early
    assert waits.came(7, "/t", 5, 5, 5, 0.0) == [5] and waits.came(7, "/t", 9, 9, 9, 0.0) == [9]
    # repeated, as commands are: at once, whatever came before
    assert waits.came(7, "/t", 7, 7, 7, 0.0) == [7]
    assert waits.came(7, "/t", 12, 10, 12, 0.0) == [] and waits.came(7, "/u", 2, 1, 22, 0.0) == []
    assert waits.overdue(0.9) == [] and waits.overdue(1.1) == [12, 22] and waits.overdue(9.0) == []
    # 13 expired
    assert waits.came(7, "/t", 14, 12, 14, 2.0) == [] and waits.came(7, "/t", 15, 15, 15, 2.0) == [
        14,
        15,
    ]
    # a new boot
    assert waits.came(7, "/t", 17, 16, 17, 3.0) == [] and waits.came(8, "/t", 1, 1, 1, 3.0) == [
        17,
        1,
    ]


def test_only_what_is_from_before_the_contact_holds_others_up():
    peer = Peer("control", {}, {})
    sent = []
    for now_s in (0.0, 0.5, 2.0, 2.1):
        for heard_s in np.arange(max(0.4, now_s - 0.9), now_s, 0.3):
            peer.on_sign_of_life(7, heard_s)
        m = Message("/t", LinkRule("/t", CRITICAL), "p/T", "0" * 32, b"", now_s)
        peer.number(m)
        peer.repeater.add(m, now_s)
        sent.append(m)
    assert [m.early for m in sent] == [True, True, False, False] and [
        peer.first(m) for m in sent
    ] == [1, 1, 1, 1]
    peer.repeater.all_early()  # a cut: what waits is from before the next contact
    assert [m.early for m in sent] == [True] * 4
    peer.repeater.acknowledged(sent[0].number)
    assert [peer.first(m) for m in sent[1:]] == [2, 2, 2]
    peer.repeater.acknowledged(sent[1].number)
    assert [peer.first(m) for m in sent[2:]] == [3, 3]
    peer.repeater.acknowledged(sent[2].number)
    assert (
        peer.first(sent[3]) == 4
        and peer.repeater.acknowledged(sent[3].number)
        and len(peer.repeater) == 0
    )


def test_a_rate_limit_holds_on_average_for_any_rhythm():
    limit = RateGate.bursting(10.0)
    assert sum(limit.passes(t) for t in np.arange(0.0, 10.0, 1 / 33)) == pytest.approx(100, abs=2)


def test_duplicates_are_known():
    remembered = Remembered(3)
    assert [remembered.first_time(n) for n in (1, 2, 1, 3, 4, 2)] == [
        True,
        True,
        False,
        True,
        True,
        False,
    ]


# ---- pictures ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def picture():
    coarse = np.random.default_rng(1).integers(0, 255, (12, 16, 3), dtype=np.uint8)
    return cv2.resize(coarse, (320, 240), interpolation=cv2.INTER_CUBIC)


def test_jpeg_gives_way_until_it_fits_and_comes_back(picture):
    jpeg = AdaptiveJpeg()
    sizes = [len(jpeg.encode(picture, 150000.0, 30.0)) for _ in range(10)]
    assert sizes[-1] * 30.0 <= 150000.0 < sizes[0] * 30.0
    small = decode_jpeg(jpeg.encode(picture, 150000.0, 30.0), (240, 320))
    # a quarter of the size still shows what is there: the coarse pattern is 20 px wide
    assert small.shape == picture.shape and np.abs(small.astype(int) - picture).mean() < 12
    for _ in range(10):
        jpeg.encode(picture, None, 30.0)
    assert jpeg.step == 0


def test_h264_follows_the_stream_and_waits_for_a_whole_picture_after_a_gap(picture):
    if not h264_available():
        pytest.skip("PyAV with libx264 is not installed")
    encoder, decoder = H264Encoder(), H264Decoder()
    units = [encoder.encode(np.roll(picture, i, 1), 5e5, 30.0, keyframe=i == 8) for i in range(12)]
    out = [decoder.decode(u, i) for i, u in enumerate(units) if i != 5]
    assert [o is not None for o in out] == [True] * 5 + [False] * 2 + [True] * 4
    # quantisation at 4 Mbit/s and halved colour; a wrong picture (shifted by 20) differs by 30 and
    # more
    assert np.abs(out[-1].astype(int) - np.roll(picture, 11, 1)).mean() < 6
    assert sum(map(len, units[1:8])) / 7 < 0.5 * len(units[0])


@pytest.mark.parametrize("data", [b"", b"\xff\xd8 no picture", bytes(100)])
def test_a_malformed_jpeg_is_an_error(data):
    with pytest.raises(PictureError):
        decode_jpeg(data)


# ---- keys ----------------------------------------------------------------------------------------


def test_without_keys_nothing_leaves_the_machine():
    with pytest.raises(EndpointError, match="has no keys"):
        ZenohTransport("a", parse_endpoint("0.0.0.0:7447"), {}, None, print, print)
    with pytest.raises(EndpointError, match="has no keys"):
        ZenohTransport(
            "a", parse_endpoint("127.0.0.1:7447"), {"b": None}, None, print, print, discovery=True
        )


# ---- addresses -----------------------------------------------------------------------------------


def test_another_address_is_noticed_once_it_stays():
    looks = iter(
        [
            {"10.0.0.1"},
            {"10.0.0.1"},
            set(),
            set(),
            {"10.0.0.1"},
            {"10.0.0.2"},
            {"10.0.0.3"},
            {"10.0.0.3"},
            {"10.0.0.3"},
        ]
    )
    watch = AddressWatch(lambda: next(looks))
    assert [watch.changed() for _ in range(8)] == [False] * 6 + [True, False]
    assert not any(a.startswith("127.") for a in local_addresses())


# ---- the list, for fkie --------------------------------------------------------------------------


def test_fkie_gets_the_same_topics_and_nothing_else(root):
    links, peers = (
        load_links(root / "config/links/default.yaml"),
        parse_peers("control=10.0.0.1:7447,uav2=10.0.0.3:7447"),
    )
    topics = fkie.sync("uav1", links, peers)["sync_topics"]
    assert {"/uav1/odometry/state", "/uav1/command", "/home", "/uav2/odometry/state"} <= set(topics)
    assert "/uav2/command" not in topics and "/rosout" not in topics
    found = fkie.discovery(peers)
    assert found["robot_hosts"] == ["10.0.0.1", "10.0.0.3"] and not found["send_mcast"]
    assert fkie.discovery({**peers, "uav3": None})["send_mcast"]


# ---- from when what came counts ------------------------------------------------------------------


def parcel(topic, came_s, age_s, traffic, unsure_s=0.0):
    return Parcel(
        "uav2",
        topic,
        "p/T",
        "0" * 32,
        1,
        wire.RAW,
        b"",
        LinkRule(topic, traffic),
        age_s,
        came_s,
        unsure_s,
    )


def test_states_that_came_are_told_with_when_they_were_sent_at_the_latest():
    state, sent = TrafficClass("datagram", "interactive_high", False, max_age_s=1.0), SentTimes()
    sent.came(parcel("/uav2/odometry/state", 20.0, 0.7, state, 0.1))
    sent.came(parcel("/uav2/mavros/state", 20.0, None, state))  # before the clocks are known
    sent.came(parcel("/uav2/odometry/state", 20.1, 0.2, state, 0.1))
    for traffic in (CRITICAL, EVENT, BULK):
        sent.came(parcel("/uav2/other", 20.0, 0.1, traffic))
    assert sent.drain() == {"/uav2/odometry/state": pytest.approx(19.8), "/uav2/mavros/state": 19.0}
    assert sent.drain() == {}


def test_an_age_is_no_surer_than_the_pings_by_which_clocks_are_known():
    peer = PeerMeasure()
    assert peer.clocks.unsure_s == 0.0  # no age at all
    # 0.3 s there and 0.1 s back, or the other way round
    peer.clocks.answered(10.0, 10.4, 500.3, 0.0)
    peer.clocks.answered(11.0, 11.8, 501.4, 0.0)
    assert peer.clocks.unsure_s == pytest.approx(0.2)
    # sent at 9.7 of our clock
    assert peer.clocks.age_s(500.0, 10.0) + peer.clocks.unsure_s >= 0.0 + (10.0 - 9.7)


def test_what_nobody_measured_is_as_old_as_the_shipped_links_let_through(root):
    links = load_links(root / "config/links/default.yaml")
    assert links.classes["state"].max_age_s == arrivals.UNMEASURED_S
    topics = {
        r.topic.replace("{vehicle}/", ""): r.traffic
        for r in (*links.to_control, *links.between_vehicles)
    }
    for topic in (
        telemetry.ODOMETRY,
        telemetry.STATE,
        telemetry.BATTERY,
        telemetry.GUARDIAN,
        telemetry.RECORDER,
    ):
        assert topics[f"/{topic}"] == links.classes["state"], topic


def test_ages_survive_restarts_and_a_relay_that_says_nothing():
    assert doctest.testmod(arrivals).attempted and not doctest.testmod(arrivals).failed
    known, topic = arrivals.Arrivals(), "/uav2/odometry/state"
    known.came(topic, "/relay")
    assert known.since_s(topic, 10.0) == 9.0, "never told: not fresh"
    known.on_sent([topic], [9.95])
    assert known.since_s(topic, 10.0) == 9.95
    assert known.since_s(topic, 10.1) == 9.95, (
        "of the next the relay has not told yet: the one before counts"
    )
    assert known.since_s(topic, 300.0) == 299.0, (
        "a relay that restarted: no older than it lets through"
    )
    known.on_sent([topic], [310.0])
    assert known.since_s(topic, 300.0) == 300.0, (
        "told of one that is still to come: this one is not younger for that"
    )
    known.came(topic, "/uav2/odometry")
    assert known.since_s(topic, 320.0) == 320.0, "no relay is between"


def test_the_missions_view_is_as_old_as_the_relay_measured():
    known = arrivals.Arrivals()
    vehicle = telemetry.VehicleTelemetry(
        np.eye(4), lambda topic, came_s: known.since_s(f"/uav2/{topic}", came_s)
    )
    topics = [
        f"/uav2/{t}"
        for t in (telemetry.ODOMETRY, telemetry.STATE, telemetry.BATTERY, telemetry.RECORDER)
    ]
    for topic in topics:
        known.came(topic, "/relay")
    vehicle.odometry(50.0, np.eye(4), (0.1, 0.0, 0.0))
    vehicle.state(50.0, "GUIDED", True, True)
    vehicle.battery(41.0, 0.9)
    vehicle.recorder(50.0, "", 1)
    ages = lambda: [  # noqa: E731
        getattr(vehicle.view(50.1, None), f"{n}_age_s") for n in ("pose", "state", "recorder")
    ]
    assert ages() == [pytest.approx(1.1)] * 3
    known.on_sent(topics, [49.9, 49.8, 40.0, 49.7])
    assert ages() == [pytest.approx(a) for a in (0.2, 0.3, 0.4)]
    assert vehicle.view(50.1, None).battery_share == 0.9
    known.on_sent(topics[1:2], [50.5])
    vehicle.state(50.6, "GUIDED", True, True)
    assert np.isnan(vehicle.view(50.6, None).battery_share), (
        "10 s before the state by when both were sent"
    )

# SPDX-License-Identifier: Apache-2.0
"""What a rule carries whole arrives in order and once, also what was published before the other
side was there."""

import threading
import time
from contextlib import ExitStack, closing

import pytest
from support.waiting import within

from fcsv_multimaster.errors import EndpointError
from fcsv_multimaster.links import load_links
from fcsv_multimaster.network import joining
from fcsv_multimaster.network.endpoints import parse_endpoint
from fcsv_multimaster.relay import exchange as exchanges
from fcsv_multimaster.relay import order
from fcsv_multimaster.relay.exchange import Exchange
from fcsv_sim.machines.machines import free_port

until = within(30.0)
LINKS = """
classes:
  critical: {link: datagram, priority: real_time, reliable: true, max_age_s: 5.0}
  stream: {link: urgent, priority: data_high, reliable: true, max_age_s: 5.0}
  captures: {link: bulk, priority: data, reliable: true, max_age_s: 60.0}
to_control:
  - {topic: "/{vehicle}/critical", class: critical}
  - {topic: "/{vehicle}/stream", class: stream}
  - {topic: "/{vehicle}/captures", class: captures}
"""


@pytest.fixture
def exchange(tmp_path):
    """exchange(name, deliver) of two machines on loopback; closed at the end."""
    path = tmp_path / "links.yaml"
    path.write_text(LINKS)
    links = load_links(path)
    ends = {
        n: parse_endpoint(f"127.0.0.1:{free_port()}/{free_port()}") for n in ("control", "uav1")
    }
    with ExitStack() as stack:

        def make(name, deliver=lambda _parcel: None):
            peers = {n: e for n, e in ends.items() if n != name}
            made = Exchange(name, links, ends[name], peers, None, deliver, print, lambda *_: None)
            return stack.enter_context(closing(made))

        yield make


@pytest.mark.parametrize("kind", ["critical", "stream", "captures"])
def test_what_was_sent_before_and_while_the_peer_appears_comes_in_order_and_once(
    exchange, kind, monkeypatch
):
    # a machine so busy that a second passes is no failure
    monkeypatch.setattr(order, "_LONGEST_S", 30.0)
    got, sent, over = [], [], threading.Event()
    uav1 = exchange("uav1")

    def speak():
        while not over.is_set():
            sent.append(len(sent))
            uav1.send(f"/uav1/{kind}", "std_msgs/String", "0" * 32, "", b"%d" % sent[-1])
            time.sleep(0.02)

    speaker = threading.Thread(target=speak, daemon=True)
    speaker.start()
    until(lambda: len(sent) > 30, what="messages from before the contact")
    exchange("control", lambda parcel: got.append(int(parcel.data)))
    until(lambda: got, what="the first message")
    # more would be after the contact, where a message that is lost holds up no other
    time.sleep(0.3)
    over.set()
    speaker.join()
    until(lambda: len(got) >= len(sent), what=f"{len(sent)} messages, but {got}")
    time.sleep(0.5)
    assert got == sent and len(sent) > 30


def test_a_link_that_lost_a_peer_is_opened_anew_and_captures_go_on_in_order_and_once(
    exchange, monkeypatch
):
    """That Zenoh loses a peer that listens needs a cut that ends at one moment of few: here it is
    only said so."""
    monkeypatch.setattr(joining, "_HALF_OPEN_S", 0.0)
    got, sent, over = [], [], threading.Event()
    uav1 = exchange("uav1")
    exchange("control", lambda parcel: got.append(int(parcel.data)))
    transport, told = uav1._transport, []
    listening, session = transport.listening, lambda: transport._sessions["bulk"]
    monkeypatch.setattr(
        transport,
        "listening",
        lambda link: told.pop() if link == "bulk" and told else listening(link),
    )

    def speak():
        while not over.is_set():
            sent.append(len(sent))
            uav1.send("/uav1/captures", "std_msgs/String", "0" * 32, "", b"%d" % sent[-1])
            time.sleep(0.1)

    speaker = threading.Thread(target=speak, daemon=True)
    speaker.start()
    until(lambda: got, what="the first capture")
    before = session()
    told.append((1, 0))
    until(lambda: session() is not before, what="another session")
    count = len(sent)
    until(lambda: got[-1] > count, what="captures by the new session")
    over.set()
    speaker.join()
    until(lambda: got[-1] == sent[-1], what=f"{len(sent)} captures, but {got}")
    assert got == sorted(set(got)) and listening("bulk") == (1, 1)


def test_a_link_that_cannot_be_opened_anew_is_said_to_and_tried_again(exchange, monkeypatch):
    monkeypatch.setattr(joining, "_HALF_OPEN_S", 0.0)
    monkeypatch.setattr(exchanges, "_LOOK_S", 0.1)
    problems, tries = [], []
    uav1 = exchange("uav1")
    exchange("control")
    transport = uav1._transport
    until(lambda: transport.listening("bulk") == (1, 1), what="contact")
    reopen, listening, told = transport.reopen, transport.listening, [(1, 0)]
    monkeypatch.setattr(uav1, "_problem", lambda name, text: problems.append((name, text)))
    monkeypatch.setattr(
        transport,
        "listening",
        lambda link: told.pop() if link == "bulk" and told else listening(link),
    )

    def fails_twice(links):
        tries.append(links)
        if len(tries) < 3:
            transport._close_links(links)
            raise EndpointError("the port is taken")
        reopen(links)

    monkeypatch.setattr(transport, "reopen", fails_twice)
    said = lambda: [text for name, text in problems if name == "bulk link"]  # noqa: E731
    until(lambda: len(said()) >= 3, what="what is said of three tries")
    until(lambda: listening("bulk") == (1, 1), what="contact again")
    assert set(tries) == {("bulk",)} and said()[:3] == ["the port is taken"] * 2 + [""]

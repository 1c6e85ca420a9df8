# SPDX-License-Identifier: Apache-2.0
"""What of a vehicle's diagnostics crosses the radio: the worst, at once, and never more than 2
kbit/s."""

import doctest
import random

import pytest
from support.waiting import within

from fcsv_control.flight_check import digest
from fcsv_control.flight_check.digest import ERROR, OK, STALE, WARN, Digest, Status
from fcsv_control.ros.checks.diagnostics_digest import (
    ON_THE_WAY_BYTES,
    array,
    on_the_way_bytes,
    statuses_of,
)

until = within(20.0)


def told(d, now_s, *statuses):
    d.tell(now_s, [Status(*s) for s in statuses])
    return d.due(now_s, on_the_way_bytes)


def test_only_what_is_wrong_is_told_the_worst_first_of_those_as_bad_the_oldest():
    d = Digest()
    d.tell(0.0, [Status("b", WARN, "old")])
    lines = told(d, 1.0, ("a", WARN, "new"), ("c", ERROR, "bad"), ("d", OK, "well"))
    assert [line.name for line in lines] == ["c", "b", "a"]


def test_a_change_goes_out_at_once_and_so_does_its_end():
    d = Digest()
    assert told(d, 0.0, ("a", OK, "well")) == (), "that it is well is told first"
    assert told(d, 1.0, ("a", OK, "well")) is None
    assert [s.level for s in told(d, 1.7, ("a", ERROR, "no poses"))] == [ERROR]
    assert told(d, 2.3, ("a", OK, "well")) == ()


def test_while_all_is_well_it_is_told_every_5_s_and_what_is_wrong_every_second():
    d = Digest()
    well = [t for t in range(21) if told(d, float(t), ("a", OK, "well")) is not None]
    wrong = [t for t in range(21, 41) if told(d, float(t), ("a", WARN, "slow")) is not None]
    assert well == [0, 5, 10, 15, 20] and wrong == list(range(21, 41))


def test_a_wrong_line_whose_node_falls_silent_is_stale_and_later_forgotten():
    d = Digest()
    told(d, 0.0, ("a", WARN, "slow"))
    assert [s.level for s in d.lines(4.9)] == [WARN] and [s.level for s in d.lines(5.1)] == [STALE]
    assert d.lines(61.0) == ()
    assert d.due(61.0, on_the_way_bytes) == (), "its end is told"


def test_others_on_the_same_master_are_left_out():
    d = Digest("tello1/")
    assert [
        s.name
        for s in told(
            d, 0.0, ("tello1/x", WARN, ""), ("tello2/x", ERROR, ""), ("tello10/x", ERROR, "")
        )
    ] == ["tello1/x"]


def test_the_worst_line_of_any_length_is_out_within_a_second_however_much_changes():
    d, random_ = Digest(), random.Random(3)
    waiting_s, worst_s, sent_bytes = None, 0.0, []
    shown = None
    for k in range(60 * 50):
        now_s = k / 50.0
        if k % 10 == 0:
            flapping = [
                Status(f"node{i:02d}" + "x" * 50, random_.choice((OK, WARN)), "±" * 200)
                for i in range(20)
            ]
            d.tell(now_s, [*flapping, Status("y" * 70, ERROR if (k // 170) % 2 else OK, "z" * 300)])
        lines = d.due(now_s, on_the_way_bytes)
        if lines is not None:
            sent_bytes.append(on_the_way_bytes(lines))
            shown = lines[0].level if lines else OK
        wanted = d.lines(now_s)[0].level if d.lines(now_s) else OK
        waiting_s = None if shown == wanted else now_s if waiting_s is None else waiting_s
        worst_s = max(worst_s, 0.0 if waiting_s is None else now_s - waiting_s)
    assert worst_s <= 1.0 + 1e-6
    assert max(sent_bytes) <= 240, "more would have to wait for longer than a second"
    kbit_s = 8e-3 * sum(sent_bytes) / 60.0
    print(
        f"20 lines that flap and one long error, 60 s: {kbit_s:.2f} kbit/s, a change out after {worst_s:.2f} s"
    )
    assert kbit_s <= 2.0


@pytest.mark.parametrize("wrong, most_kbit_s", [(0, 0.16), (1, 1.3), (20, 2.0)])
def test_what_stays_as_it_is_takes_this_much_of_the_radio(wrong, most_kbit_s):
    d, sent = Digest(), 0
    for t in range(600):
        lines = told(
            d,
            float(t),
            *((f"uav1/node{k}: health", WARN, "slow or silent: pictures") for k in range(wrong)),
        )
        sent += 0 if lines is None else on_the_way_bytes(lines)
    print(f"{wrong} lines wrong, 600 s: {8e-3 * sent / 600.0:.2f} kbit/s")
    assert 8e-3 * sent / 600.0 <= most_kbit_s


def test_what_has_no_room_is_counted():
    lines = told(
        Digest(),
        0.0,
        *((f"uav1/node{k}: health", WARN, "slow or silent: pictures") for k in range(20)),
    )
    assert lines[-1].name == "" and lines[-1].text == f"and {21 - len(lines)} more"


def test_a_level_that_is_none_counts_as_stale():
    assert told(Digest(), 0.0, ("a", 9, "?"))[0].level == STALE


def test_lines_survive_the_message():
    lines = (Status("uav1/tags: health", WARN, "10° off"), Status("", WARN, "and 3 more"))
    assert tuple(statuses_of(array(lines, 1.0))) == lines
    assert on_the_way_bytes(()) == 20 + ON_THE_WAY_BYTES


def test_what_nodes_publish_comes_in_and_the_worst_goes_out(monkeypatch):
    """The topics, without a master."""
    import io

    import rospy
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    from fcsv_control.flight_check.messages import DiagnosticsCame
    from fcsv_control.ros.checks import diagnostics_digest

    published, heard, came = [], {}, []

    class Publisher:
        def __init__(self, topic, *_, **__):
            assert topic == "diagnostics/worst"

        def publish(self, message):
            published.append(message)

    monkeypatch.setattr(rospy, "Publisher", Publisher)
    monkeypatch.setattr(
        rospy, "Subscriber", lambda topic, kind, call, **_: heard.update({topic: (kind, call)})
    )
    monkeypatch.setattr(rospy, "get_time", lambda: 12.0)
    topics = diagnostics_digest.DiagnosticsTopics(came.append)
    kind, call = heard["/diagnostics"]
    told, buffer = kind(), io.BytesIO()
    DiagnosticArray(
        status=[DiagnosticStatus(level=2, name="a", message="m"), DiagnosticStatus(name="b")]
    ).serialize(buffer)
    told._buff = buffer.getvalue()
    call(told)
    assert came == [DiagnosticsCame([Status("a", ERROR, "m"), Status("b", OK, "")])]
    topics.publish([Status("a", ERROR, "m")])
    (out,) = published
    assert [(s.level, s.name, s.message) for s in out.status] == [(2, "a", "m")]
    assert out.header.stamp.to_sec() == 12.0


def test_examples():
    done = doctest.testmod(digest)
    assert done.attempted and not done.failed

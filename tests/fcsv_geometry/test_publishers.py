# SPDX-License-Identifier: Apache-2.0
"""rospy's manager of registrations, told news and answers in the order that loses a publisher."""

import threading

import pytest
from support.waiting import within

pytest.importorskip("rospy")

from rospy.impl.registration import RegManager

from fcsv_geometry.ros import publishers

until = within(10.0)


class Handler:
    """In place of the node: notes to what it is to connect."""

    def __init__(self):
        self.done, self.connected = False, []

    def _connect_topic(self, topic, uri):
        self.connected.append((topic, uri))
        return 1, "", 0


@pytest.fixture
def told(monkeypatch):
    """told(updates, count): to what a manager connects that finds all of them waiting when it comes
    to look."""
    import rospy.impl.registration as registration

    monkeypatch.setattr(registration, "add_preshutdown_hook", lambda _hook: None)
    # as another test of this process may have left it
    monkeypatch.setattr(registration, "is_shutdown", lambda: False)

    def connects(updates, count):
        handler = Handler()
        manager = RegManager(handler)
        for update in updates:
            manager.publisher_update(*update)
        turns = threading.Thread(target=manager.run, daemon=True)
        turns.start()
        until(lambda: not manager.updates, what="all was looked at")
        until(lambda: len(handler.connected) >= count, what=f"{count} connections")
        handler.done = True  # before, what was taken out last would not be connected
        turns.join(5.0)
        return sorted(handler.connected)

    return connects


def test_an_older_answer_does_not_stand_for_the_news(told, monkeypatch):
    """The master told of a publisher before its answer, from when there was none, was taken in."""
    monkeypatch.setattr(RegManager, "publisher_update", RegManager.publisher_update)
    publishers.keep_all()
    late_answer = [("/t", ["http://a:1"]), ("/u", ["http://b:1"]), ("/t", [])]
    assert told(late_answer, 2) == [("/t", "http://a:1"), ("/u", "http://b:1")]
    assert told([("/t", ["a", "b"]), ("/t", ["b", "c"])], 3) == [
        ("/t", "a"),
        ("/t", "b"),
        ("/t", "c"),
    ]
    assert told([("/t", [])], 0) == []

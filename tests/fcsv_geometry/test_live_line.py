# SPDX-License-Identifier: Apache-2.0
"""The line that shows what a long command does: in place on a terminal, now and then elsewhere."""

import contextlib
import io
import sys
import time

import pytest

from fcsv_geometry.programs.live_line import IN_PLACE_S, LOGGED_S, Counter, LiveLine, Steps


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


def test_elsewhere_than_on_a_terminal_it_is_printed_every_quarter_of_a_minute(clock):
    out = io.StringIO()
    live = LiveLine(out, clock)
    for _ in range(100):
        clock.now_s += 0.5
        live.status(f"at {clock.now_s:g}")
    assert out.getvalue().splitlines() == ["at 115", "at 130", "at 145"]


def test_a_line_that_stays_counts_as_a_sign_of_life(clock):
    out = io.StringIO()
    live = LiveLine(out, clock)
    clock.now_s += LOGGED_S - 1.0
    live.say("something happened")
    clock.now_s += LOGGED_S - 1.0
    live.status("still going")
    assert out.getvalue() == "something happened\n"


def test_on_a_terminal_it_changes_in_place_and_leaves_no_trace(clock):
    out = io.StringIO()
    live = LiveLine(out, clock, terminal=True)
    live.status("one")
    live.status("too soon")
    clock.now_s += IN_PLACE_S
    live.status("two " + 400 * "x")
    live.say("stays")
    live.status("three")
    live.clear()
    live.clear()
    text = out.getvalue()
    assert "too soon" not in text and text.count("\n") == 1
    assert text.startswith("\r\x1b[Kone\r\x1b[Ktwo xxx") and text.endswith(
        "\r\x1b[Kstays\n\r\x1b[Kthree\r\x1b[K"
    )
    assert max(map(len, text.replace("\r\x1b[K", "\n").splitlines())) < 300, (
        "a long line would wrap and not be erased"
    )


def test_steps_are_shown_while_their_body_is_busy():
    out = io.StringIO()
    steps = Steps(LiveLine(out, terminal=True), "reading pictures")
    with steps.shown():
        deadline = time.monotonic() + 20.0
        while "reading pictures" not in out.getvalue() and time.monotonic() < deadline:
            pass  # busy, as a matcher is
        steps.begin("matching", 0.3)
        while "matching" not in out.getvalue() and time.monotonic() < deadline:
            pass
    assert "  0%| reading pictures, " in out.getvalue() and " 30%| matching, " in out.getvalue()
    assert out.getvalue().endswith("\r\x1b[K")


def test_a_counter_goes_on_while_nothing_is_done(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    out = Terminal()
    monkeypatch.setattr(sys, "stderr", out)
    with contextlib.closing(Counter(3, "flight", "flights")) as counter:
        counter.show(1)
        before = len(out.getvalue())
        time.sleep(1.3)
        assert len(out.getvalue()) > before and "1/3" in out.getvalue()

# SPDX-License-Identifier: Apache-2.0
"""A whole mission from the operator's window: real clicks, keys and drags on a screen, from its
list to its report.

The story is in support/window_flight.py; what the demo leaves behind meanwhile, test_demo.py looks
at. All else of the window is tested against the view-model (tests/fcsv_console).
"""

import csv
import re

import numpy as np
import pytest
from support.demos import said
from support.window_flight import DRAGGED, GATHERED_MAP, TO_M

from fcsv_geometry.missions.mission import load_mission

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(1800)]


@pytest.fixture
def seen(operated):
    return operated[1]


def events(path):
    """(who, what) -> the last answer."""
    with open(path, newline="") as file:
        return {(row["who"], row["what"]): row["answer"] for row in csv.DictReader(file)}


def test_a_goal_is_dragged_while_it_is_allowed_and_flown_where_it_was_put(seen, flown):
    """On the plan view, before the fleet is there; the comments of the file stay."""
    assert not seen["dragged while it is locked"] and seen["list closed"] == 0
    text = (flown / "mine.yaml").read_text()
    assert (
        text.startswith("# The demo's")
        and load_mission(flown / "mine.yaml").configurations[DRAGGED].baseline_m == TO_M
    )
    assert f"captured horizontal {TO_M:g} m" in said(flown)


def test_amber_lines_are_accepted_by_their_names(flown):
    (kept, *_) = sorted((flown / "session").glob("console_events_*.csv"))
    accepted = {
        what: answer for (who, what), answer in events(kept).items() if what.startswith("accept ")
    }
    assert accepted["accept uav1 disk"], accepted


def test_nothing_is_flown_by_a_slip_nor_unrehearsed(seen):
    assert "rehears" in seen["locked"] or "set home" in seen["locked"]
    assert seen["rehearsal"].startswith("rehearsed: 4 of 4 recorded")
    assert seen["after a slip"][1] == "execute"
    assert seen["after a slip of the key"] == ("CONFIGURATIONS", "resume")


def test_a_window_that_is_killed_in_flight_is_missed_by_nobody_and_the_next_one_knows_everything(
    seen,
):
    assert (
        "!!" not in seen["said without a window"] and "paused" not in seen["said without a window"]
    )
    new = seen["new window"]
    assert new["flown by"] == ["mission", "mission"] and all(
        m.startswith("GUIDED, ARMED") for m in new["mode"]
    )
    assert (
        all(re.match(r"[+-]\d+\.\d ", words) for words in new["in home"])
        and len(new["running"]) == 1
    )


def test_after_the_flight_it_points_at_what_was_recorded_in_this_simulation(seen, flown):
    """The machines are off: nothing is violet, and no host is offered that a simulation does not
    have."""
    assert seen["places"] == ["", str(flown / "session"), str(flown / "map")]
    assert f"all machines recorded into {flown / 'session'}" in seen["nothing to gather"]
    assert seen["over"].startswith("DONE: all configurations flown")


def test_it_gathers_maps_and_opens_the_report(seen, flown):
    assert seen["gathered"].startswith("done: ") and seen["mapped"].startswith("done: ")
    assert seen["opened"] == [f"file://{flown / GATHERED_MAP}/report.html"] and seen["closed"] == 0
    demos_own, gathered = (
        np.load(flown / folder / "depth.npy") for folder in ("map", GATHERED_MAP)
    )
    np.testing.assert_array_equal(gathered, demos_own)


def test_every_command_is_kept_with_its_answer_and_exported(flown):
    """By the window that was killed, too: all but the last two seconds."""
    first, second = sorted((flown / "session").glob("console_events_*.csv"))
    before, after = events(first), events(flown / "events.csv")
    asked = {
        ("operator", what): by
        for by, whats in (
            (before, ("calibrate", "set home", "execute")),
            (after, ("pause", "hand over")),
        )
        for what in whats
    }
    assert all(by[key] for key, by in asked.items()), (before, after)
    assert ("operator", "hand over") not in before and ("gather", "runs") in after
    assert events(second).keys() >= after.keys() - {
        key for key in after if key[1].startswith("export")
    }

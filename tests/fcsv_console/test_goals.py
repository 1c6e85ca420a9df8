# SPDX-License-Identifier: Apache-2.0
"""Goals that are dragged in rviz: each only once it was enabled, and only along its way."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fcsv_console.model.console import Console
from fcsv_console.model.goals import GoalEnabled, GoalMoved, GoalsElsewhere
from fcsv_console.model.turns import Turns, Window

OUTDOOR = Path(__file__).resolve().parents[2] / "config/missions/outdoor.yaml"


@pytest.fixture
def c():
    made = Console(["uav1", "uav2"])
    made.load(OUTDOOR)
    return made


def baselines(c):
    return [r.baseline_m for r in c.file.rows]


def test_a_goal_is_dragged_once_it_was_enabled_and_not_by_the_enable_of_another(c):
    before = baselines(c)
    c.tell(1.0, GoalMoved(2, (0.0, -7.0, 0.0)))
    c.tell(1.0, GoalEnabled(1, True))
    c.tell(1.0, GoalMoved(2, (0.0, -7.0, 0.0)))
    assert baselines(c) == before
    c.tell(1.0, GoalEnabled(2, True))
    c.tell(1.0, GoalMoved(2, (3.0, -7.04, 5.0)))
    assert baselines(c) == [2.0, 4.0, 7.0, *before[3:]], "sideways alone, in whole steps"
    c.tell(1.0, GoalEnabled(2, False))
    c.tell(1.0, GoalMoved(2, (0.0, -9.0, 0.0)))
    assert c.file.rows[2].baseline_m == 7.0
    assert [g.enabled for g in c.view(2.0).goals] == [False, True] + [False] * 6


def test_a_vertical_goal_is_dragged_up_and_never_through_home(c):
    c.tell(1.0, GoalEnabled(6, True))
    c.tell(1.0, GoalMoved(6, (1.0, -4.0, 7.96)))
    assert c.file.rows[6].baseline_m == 8.0
    c.tell(1.0, GoalMoved(6, (0.0, 0.0, -3.0)))
    assert c.file.rows[6].baseline_m == 8.0, "a list that cannot be flown does not come of it"
    assert c.view(1.1).problems[0].startswith("goal 7 stays: configurations[6].baseline_m")


def test_one_that_was_let_go_of_where_it_may_not_be_is_drawn_anew(c):
    before = c.view(1.0).goals
    assert c.view(1.1).goals == before
    c.tell(1.2, GoalMoved(0, (0.0, -3.0, 0.0)))
    after = c.view(1.3).goals
    assert after != before and [g.p_home_m for g in after] == [g.p_home_m for g in before]


def test_another_number_of_configurations_disables_all(c):
    c.tell(1.0, GoalEnabled(7, True))
    text = c.file.text
    c.edit(text.rstrip().rsplit("\n", 1)[0] + "\n")
    assert not any(g.enabled for g in c.view(1.0).goals) and len(c.view(1.0).goals) == 7
    c.tell(1.0, GoalMoved(7, (0.0, 0.0, 3.0)))
    c.tell(1.0, GoalEnabled(7, True))
    c.edit("no mission")
    assert c.view(1.0).goals == ()
    c.tell(1.0, GoalMoved(0, (0.0, -3.0, 0.0)))
    assert c.file.text == "no mission"


def test_a_sweep_has_no_goal_that_could_be_dragged():
    c = Console(["uav1", "uav2"])
    c.load(OUTDOOR.parent / "sweep.yaml")
    text = c.file.text
    c.tell(1.0, GoalEnabled(0, True))
    c.tell(1.0, GoalMoved(0, (0.0, -3.0, 0.0)))
    assert c.file.rows and c.view(1.0).goals == () and c.file.text == text


def test_a_place_that_is_none_changes_nothing(c):
    before = baselines(c)
    c.tell(1.0, GoalEnabled(0, True))
    c.tell(1.0, GoalMoved(0, (0.0, math.nan, 0.0)))
    assert baselines(c) == before and "p_home_m holds nan" in c.view(1.1).problems[0]


def test_a_marker_has_arrows_along_its_way_only_while_it_may_be_dragged(c):
    pytest.importorskip("interactive_markers")
    from fcsv_console.ros.goal_markers import marker
    from fcsv_geometry.rotations import matrix_of_quaternion

    for index in (2, 6):
        c.tell(1.0, GoalEnabled(index, True))
    goals = c.view(1.0).goals
    assert [len(marker(g).controls) for g in goals] == [
        2 if g.index in (2, 6) else 1 for g in goals
    ]
    for index, along in ((2, (0.0, 1.0, 0.0)), (6, (0.0, 0.0, 1.0))):
        made = marker(goals[index])
        q = made.controls[1].orientation
        x_axis = matrix_of_quaternion((q.x, q.y, q.z, q.w))[:, 0]
        assert np.abs(x_axis @ along) == pytest.approx(1.0) and made.header.frame_id == "home"
    assert [marker(goals[k]).controls[0].markers[1].text for k in (0, 2)] == ["2 m", "6 m, free"]


def test_of_two_windows_the_one_that_was_opened_first_has_the_goals_until_it_dies(c):
    """A second window that is opened shows none in between, whoever hears the other first."""
    one, two = Turns(Window(10.0, "/console_1")), Turns(Window(20.0, "/console_2"))
    alive, had = [one], []
    for k in range(200):
        now_s = 0.1 * k
        alive = [one, two] if k == 50 else [two] if k == 120 else [one] if k == 170 else alive
        for turns in alive:
            if turns.due(now_s):
                one.on_window(now_s, turns.own)
                two.on_window(now_s, turns.own)
        had.append([turns.own.name for turns in alive if turns.mine(now_s)])
    assert all(len(names) <= 1 for names in had)
    assert had[26:120] == [["/console_1"]] * 94 and had[120] == []
    assert had[146:170] == [["/console_2"]] * 24 and two.due(99.0) and not two.due(99.4)


def test_whose_the_goals_are_is_told_where_it_changes(c):
    for at_s, name in ((1.0, "/console_1"), (2.0, "/console_1"), (3.0, "")):
        c.tell(at_s, GoalsElsewhere(name))
    told = [e.what for e in c.view(4.0).events]
    assert told == [
        "goals in rviz are of /console_1, opened before this window",
        "goals in rviz are this window's again",
    ]


def test_windows_tell_each_other_on_their_topic(monkeypatch):
    """With a topic and clocks that stand in for rospy's."""
    from fcsv_console.ros import window_turns

    heard, told, clock = [], {"/one": [], "/two": []}, SimpleNamespace(now_s=100.0)
    names = iter(("/one", "/one", "/two", "/two"))
    send = SimpleNamespace(publish=lambda word: [hear(word) for hear in heard])
    monkeypatch.setattr(window_turns.rospy, "get_name", lambda: next(names))
    monkeypatch.setattr(window_turns.rospy, "Publisher", lambda *_a, **_k: send)
    monkeypatch.setattr(
        window_turns.rospy, "Subscriber", lambda _topic, _kind, hear, **_k: heard.append(hear)
    )
    monkeypatch.setattr(
        window_turns,
        "time",
        SimpleNamespace(time=lambda: clock.now_s, monotonic=lambda: clock.now_s),
    )
    one = window_turns.WindowTurns(told["/one"].append)
    clock.now_s += 1.5
    two = window_turns.WindowTurns(told["/two"].append)
    for _ in range(40):
        clock.now_s += 0.1
        has = one.mine(), two.mine()
    assert has == (True, False) and told == {"/one": [], "/two": [GoalsElsewhere("/one")]}
    clock.now_s += 2.6
    assert two.mine() and told["/two"][-1] == GoalsElsewhere(""), "the other died"


class Server:
    """What goal_markers asks of rviz's library, without a master."""

    def __init__(self, _namespace):
        self.markers, self.callbacks, self.applied = {}, {}, 0

    def clear(self):
        self.markers, self.callbacks = {}, {}

    def get(self, name):
        return self.markers[name]

    def insert(self, marker, callback, kind=255):
        self.markers[marker.name] = marker
        self.callbacks[marker.name, kind] = callback

    def applyChanges(self):
        self.applied += 1


def test_what_is_asked_of_a_marker_reaches_the_view_model_and_comes_back(c, monkeypatch):
    pytest.importorskip("interactive_markers")
    from visualization_msgs.msg import InteractiveMarkerFeedback as Feedback

    from fcsv_console.ros import goal_markers

    monkeypatch.setattr(goal_markers, "InteractiveMarkerServer", Server)
    told = []
    markers = goal_markers.GoalMarkers(told.append)
    server = markers._server

    def shown():
        while told:
            c.tell(1.0, told.pop(0))
        markers.show(c.view(1.0).goals)
        return server.markers["goal_3"]

    def ask(kind, **more):
        feedback = Feedback(marker_name="goal_3", event_type=kind, **more)
        if kind == Feedback.MOUSE_UP:
            feedback.pose.position.y = -6.5
        call = server.callbacks.get(("goal_3", kind)) or server.callbacks["goal_3", 255]
        call(feedback)

    assert len(shown().controls) == 1 and [e.title for e in shown().menu_entries] == [
        "[ ] Drag this goal"
    ]
    assert server.applied == 1, "nothing changed"
    ask(Feedback.MOUSE_UP)
    assert shown().pose.position.y == -6.0 and server.applied == 2, (
        "it goes back to where it stands"
    )
    ask(Feedback.MENU_SELECT, menu_entry_id=1)
    assert len(shown().controls) == 2 and shown().menu_entries[0].title == "[x] Drag this goal"
    ask(Feedback.POSE_UPDATE)
    assert told == [], "while it is dragged nothing is asked"
    ask(Feedback.MOUSE_UP)
    assert shown().pose.position.y == -6.5 and c.file.rows[2].baseline_m == 6.5
    ask(Feedback.MENU_SELECT, menu_entry_id=1)
    assert len(shown().controls) == 1
    markers.show(())
    assert server.markers == {}, "home is not set any more"

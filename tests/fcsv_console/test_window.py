# SPDX-License-Identifier: Apache-2.0
"""The real window without a screen: clicks, held keys, drags; names for a screen reader; reasons in
tooltips."""

import math
import time
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("python_qt_binding")

from python_qt_binding import QtCore, QtGui, QtWidgets
from python_qt_binding.QtTest import QTest

from fcsv_console.model import above_view, actions, facts, mission_file, samples
from fcsv_console.model.console import Console
from fcsv_control.conditions import Grade

SITE = str(Path(__file__).resolve().parents[2] / "config/missions/site.yaml")
OUTDOOR = str(Path(__file__).resolve().parents[2] / "config/missions/outdoor.yaml")
KEYS = QtCore.Qt
STEP_S = 0.005


class Clock:
    """Of the buttons that are held: it goes on with ``go_on``, however long a busy machine
    takes."""

    now_s = 0.0

    @staticmethod
    def monotonic():
        return Clock.now_s


@pytest.fixture(autouse=True)
def buttons_by_the_clock(monkeypatch):
    monkeypatch.setattr("fcsv_console.qt.hold.time", Clock)


@pytest.fixture
def shown(app, opened):
    """shown(situation) -> (window, console, what it asked for)."""

    def show(situation, mission=OUTDOOR):
        console = samples.console(mission)
        samples.SAMPLES[situation](console)
        window, asked = opened(console), []
        window.asked.connect(lambda name, given: asked.append((name, given)))
        app.installEventFilter(window.keys)
        window.show()
        window.activateWindow()
        window.setFocus()
        app.processEvents()
        return window, console, asked

    return show


def hold(app, widget, key, seconds):
    """Press, wait with the event loop running, let go; a window gives keys to what has the
    focus."""
    widget = (QtWidgets.QApplication.focusWidget() or widget) if widget.isWindow() else widget
    QTest.keyPress(widget, key)
    go_on(app, seconds)
    QTest.keyRelease(widget, key)
    go_on(app, 0.1)  # until then it may have been the key's own repetition


def go_on(app, seconds):
    """The event loop runs."""
    app.processEvents()
    for _ in range(round(seconds / STEP_S)):
        app.processEvents()
        time.sleep(STEP_S)
        Clock.now_s += STEP_S


def test_a_window_that_ended_leaves_nothing_that_goes_on(app):
    from fcsv_console.qt.window import ConsoleWindow

    before, gone = set(app.allWidgets()), []
    window = ConsoleWindow(samples.console(OUTDOOR).view(samples.NOW_S))
    window.show()
    window.resize(960, 540)  # timers of its tables are due
    window.mission.table._fitting.destroyed.connect(lambda: gone.append("timer"))
    window.keys.destroyed.connect(lambda: gone.append("keys"))
    window.end()
    assert sorted(gone) == ["keys", "timer"] and set(app.allWidgets()) == before
    app.processEvents()


def test_every_control_has_a_name_for_a_screen_reader(shown):
    window, _, _ = shown("flying")
    kinds = (
        QtWidgets.QPushButton,
        QtWidgets.QTableWidget,
        QtWidgets.QPlainTextEdit,
        QtWidgets.QProgressBar,
        QtWidgets.QTabWidget,
        QtWidgets.QDockWidget,
    )
    controls = [c for kind in kinds for c in window.findChildren(kind)]
    controls += [window.plan, window.headline, window.problems, window.map.stereo, window.verdict]
    own = [c for c in controls if not isinstance(c.parent(), QtWidgets.QDockWidget)]
    assert len(own) > 20 and not [type(c).__name__ for c in own if not c.accessibleName()]


def test_every_action_has_a_button_a_key_of_its_own_and_a_reason_where_it_is_not_enabled(shown):
    window, console, _ = shown("ground")
    assert set(window.buttons) == {row[0] for row in actions.TABLE}
    assert len({b.action.key for b in window.buttons.values()}) == len(window.buttons)
    for name, action in console.view(samples.NOW_S).actions.items():
        button = window.buttons[name]
        assert button.isEnabled() == action.enabled and (action.why_not in button.toolTip())
        assert action.why_not in button.accessibleDescription()


@pytest.mark.parametrize(
    "name, key", [("pause", KEYS.Key_P), ("skip", KEYS.Key_K), ("abort", KEYS.Key_A)]
)
def test_an_action_by_mouse_and_by_key(shown, app, name, key):
    window, _, asked = shown("flying")
    QTest.mouseClick(window.buttons[name], KEYS.LeftButton)
    assert asked == [(name, {})]
    hold(app, window, key, 0.0)
    assert asked == [(name, {})] * 2


def test_what_is_not_enabled_is_not_asked_for(shown, app):
    window, _, asked = shown("ground")
    for key in (KEYS.Key_C, KEYS.Key_P, KEYS.Key_G, KEYS.Key_X):
        hold(app, window, key, 0.0)
    QTest.mouseClick(window.buttons["calibrate"], KEYS.LeftButton)
    assert asked == []


def test_handing_over_needs_a_second(shown, app):
    window, _, asked = shown("ready")
    hold(app, window, KEYS.Key_G, 0.3)
    assert asked == [] and window.buttons["hand_over"].share == 0.0
    hold(app, window, KEYS.Key_G, 1.2)
    assert asked == [("hand_over", {})]


def test_a_late_window_does_not_take_a_keys_repetition_for_letting_go(shown, app):
    """Qt tells of a release and a press that are none, where it finds the repetition late."""
    window, _, asked = shown("ready")
    QTest.keyPress(window, KEYS.Key_G)
    for _ in range(6):
        go_on(app, 0.2)
        QTest.keyRelease(window, KEYS.Key_G)
        QTest.keyPress(window, KEYS.Key_G)
    assert asked == [("hand_over", {})]
    QTest.keyRelease(window, KEYS.Key_G)
    go_on(app, 0.1)
    assert window.buttons["hand_over"].share == 0.0


def test_a_hold_is_judged_when_it_is_let_go_of(shown, app):
    window, _, asked = shown("ready")
    hold(app, window, KEYS.Key_G, 0.95)
    assert asked == []


@pytest.mark.parametrize("focus", ["window", "check", "text", "pause"])
def test_space_stops_all_wherever_the_focus_is(shown, app, focus):
    window, _, asked = shown("wrong")
    window.mission._tabs.setCurrentIndex(1)
    widget = {
        "window": window,
        "check": window.check,
        "text": window.mission.text,
        "pause": window.buttons["skip"],
    }[focus]
    widget.setFocus()
    app.processEvents()
    hold(app, widget, KEYS.Key_Space, 0.1)
    assert asked == [], "a tap is a slip, and clicks no button"
    hold(app, widget, KEYS.Key_Space, 0.7)
    assert asked == [("stop_all", {})]


def test_stop_all_by_the_mouse_and_without_a_master(shown, app):
    window, _, asked = shown("silent")
    button = window.buttons["stop_all"]
    QTest.mousePress(button, KEYS.LeftButton)
    go_on(app, 0.7)
    QTest.mouseRelease(button, KEYS.LeftButton)
    assert asked == [("stop_all", {})]


def test_letters_in_the_editor_write(shown, app):
    window, console, asked = shown("flying")
    window.edited.connect(console.edit)
    window.mission._tabs.setCurrentIndex(1)
    text = window.mission.text
    text.setFocus()
    app.processEvents()
    text.moveCursor(QtGui.QTextCursor.End)
    QTest.keyClicks(text, "pa: 1")
    assert asked == [] and text.toPlainText().endswith("pa: 1")
    window.show_view(console.view(samples.NOW_S))
    assert window.mission.note.text() == "line 13: pa: is not known"
    (mark,) = text.extraSelections()
    assert mark.cursor.blockNumber() == 12 and not window.mission.save.isEnabled()


def test_a_changed_file_is_saved_and_one_with_an_error_is_not(shown, tmp_path):
    window, console, _ = shown("flying")
    path = tmp_path / "mine.yaml"
    path.write_text(Path(OUTDOOR).read_text())
    console.load(str(path))
    window.edited.connect(console.edit)
    window.show_view(console.view(samples.NOW_S))
    assert not window.mission.save.isEnabled()
    console.drag(0, 3.0)
    window.show_view(console.view(samples.NOW_S))
    assert window.mission.note.text() == "mine.yaml, changed and not saved"
    window.mission.save.click()
    assert mission_file.load(path).rows[0].baseline_m == 3.0
    window.show_view(console.view(samples.NOW_S))
    assert window.mission.note.text() == "mine.yaml" and not window.mission.save.isEnabled()


@pytest.fixture
def folder(shown, tmp_path):
    """(window, console, show) with two mission files in a folder, outdoor.yaml loaded."""
    window, console, _ = shown("flying")
    for name in ("outdoor.yaml", "short.yaml"):
        (tmp_path / name).write_text((Path(OUTDOOR).parent / name).read_text())
    window.edited.connect(console.edit)
    window.opened.connect(console.load)
    console.load(str(tmp_path / "outdoor.yaml"))

    def show():
        window.show_view(console.view(samples.NOW_S))

    show()
    return window, console, show


def names_in(files):
    return [files.item(k).text() for k in range(files.count())]


def click_on(files, k):
    QTest.mouseClick(
        files.viewport(), KEYS.LeftButton, pos=files.visualItemRect(files.item(k)).center()
    )


def test_a_file_of_the_folder_is_loaded_by_click_and_by_enter(shown, folder, app):
    window, console, show = folder
    files = window.mission.files
    assert names_in(files) == ["> outdoor", "short"] and files.isVisible()
    click_on(files, 1)
    show()
    assert Path(console.file.source).name == "short.yaml" and names_in(files) == [
        "outdoor",
        "> short",
    ]
    files.setFocus()
    files.setCurrentRow(0)
    hold(app, window, KEYS.Key_Return, 0.0)
    show()
    assert (
        Path(console.file.source).name == "outdoor.yaml"
        and window.mission.note.text() == "outdoor.yaml"
    )


def test_beside_a_playback_the_place_of_the_files_says_that_there_is_none(opened, app, tmp_path):
    console = Console(["uav1", "uav2"])
    console.tell(samples.NOW_S, facts.MissionFlown(Path(OUTDOOR).read_text()))
    window = opened(console)
    window.show()
    files = window.mission.files
    assert (
        len(console.file.rows) == 8
        and files.count() == 0
        and files.empty == files.accessibleDescription()
    )
    assert files.empty.startswith("No file is loaded") and "Open" in files.empty

    def inked():
        picture = files.viewport().grab().toImage()
        return len({picture.pixel(x, y) for x in range(picture.width()) for y in range(0, 60)}) > 1

    assert inked()
    for name in ("gone", "."):
        console.load(str(tmp_path / name / "mine.yaml"))
        window.show_view(console.view(samples.NOW_S))
        assert files.empty == f"No mission files in {(tmp_path / name)}" and inked()
    console.load(OUTDOOR)
    window.show_view(console.view(samples.NOW_S))
    assert files.empty == files.accessibleDescription() == "" and files.count() > 1


def test_changes_that_are_not_saved_are_not_lost_by_loading_another_file(
    shown, folder, app, monkeypatch
):
    window, console, show = folder
    files = window.mission.files
    console.drag(0, 3.0)
    show()
    changed = console.file.text
    assert names_in(files)[0] == "> outdoor *"
    for k in (1, 0, 1):
        click_on(files, k)
    QTest.mouseDClick(
        files.viewport(), KEYS.LeftButton, pos=files.visualItemRect(files.item(1)).center()
    )
    short = str(Path(console.file.source).with_name("short.yaml"))
    monkeypatch.setattr(QtWidgets.QFileDialog, "getOpenFileName", lambda *_: (short, ""))
    window.mission.findChild(QtWidgets.QPushButton, "open").click()
    assert (
        window.mission.note.text()
        == "outdoor.yaml has changes: save or revert them, then load short.yaml"
    )
    assert console.file.text == changed
    window.mission.revert.click()
    show()
    assert console.file.rows[0].baseline_m == 2.0 and not window.mission.revert.isVisible()
    window.mission.text.undo()
    show()
    assert console.file.text == changed, "what was reverted is not lost either"
    window.mission.save.click()
    show()
    click_on(files, 1)
    show()
    assert Path(console.file.source).name == "short.yaml" and not window.mission.save.isEnabled()


def test_a_file_that_changed_on_the_disk_is_read_anew_and_one_that_came_is_listed(
    shown, folder, app
):
    window, console, show = folder
    files, path = window.mission.files, Path(console.file.source)
    path.write_text(path.read_text().replace("baseline_m: 2.0", "baseline_m: 2.5"))
    click_on(files, 0)
    show()
    assert console.file.rows[0].baseline_m == 2.5 and window.mission.note.text() == "outdoor.yaml"
    (path.parent / "a.yaml").write_text("name: a")
    until_s = time.monotonic() + 20.0
    while len(names_in(files)) < 3 and time.monotonic() < until_s:
        go_on(app, 0.02)
    assert names_in(files) == ["a", "> outdoor", "short"]
    click_on(files, 0)
    show()
    assert console.file.error and window.mission.note.text() == console.file.error.words


def test_the_files_have_a_tab_of_their_own_where_there_is_no_room_beside(shown, folder, app):
    window, console, show = folder
    window.resize(960, 540)
    app.processEvents()
    tabs = window.mission.findChild(QtWidgets.QTabWidget)
    assert [tabs.tabText(k) for k in range(tabs.count())][
        -1
    ] == "F&iles" and not window.mission.files.isVisible()
    tabs.setCurrentWidget(window.mission.files)
    assert window.mission.files.isVisible()
    click_on(window.mission.files, 1)
    assert Path(console.file.source).name == "short.yaml"
    window.resize(1366, 740)
    app.processEvents()
    assert window.mission.files.isVisible() and window.mission.table.isVisible()


def test_a_goal_is_dragged_only_while_it_is_allowed(shown, app):
    window, console, _ = shown("flying")
    window.goal_changed.connect(console.drag)
    plan, row = window.plan, console.file.rows[3]

    def drag():
        scale = plan.scale
        begin, end = (
            QtCore.QPoint(*(int(round(v)) for v in scale.to_px(0.0, -y)))
            for y in (row.baseline_m, 9.0)
        )
        QTest.mousePress(plan, KEYS.LeftButton, KEYS.NoModifier, begin)
        QTest.mouseMove(plan, end)
        QTest.mouseRelease(plan, KEYS.LeftButton, KEYS.NoModifier, end)

    drag()
    assert console.file.rows[3].baseline_m == 8.0
    hold(app, window, KEYS.Key_D, 0.0)
    assert plan.editable
    drag()
    assert console.file.rows[3].baseline_m == pytest.approx(9.0, abs=0.1), (
        "a pixel is 4 cm here, a step 10 cm"
    )
    assert console.file.mission is not None and "# Thesis 6.7" in console.file.text


def test_a_goal_is_turned_by_its_knob_and_by_keys_only_while_it_is_allowed(shown, app):
    window, console, _ = shown("flying")
    window.goal_changed.connect(console.drag)
    window.goal_turned.connect(lambda index, tilt_deg: console.drag(index, tilt_deg, "tilt_deg"))
    plan, row = window.plan, console.file.rows[3]

    def turn(index, tilt_deg):
        scale = plan.scale
        middle, knob = (
            scale.to_px(*row.goal_m[:2]),
            above_view.handle(console.file.rows[index], scale),
        )
        heading = math.radians(tilt_deg)
        there = middle[0] - 60.0 * math.sin(heading), middle[1] - 60.0 * math.cos(heading)
        begin, end = (QtCore.QPoint(*(int(round(v)) for v in p)) for p in (knob, there))
        QTest.mousePress(plan, KEYS.LeftButton, KEYS.NoModifier, begin)
        QTest.mouseMove(plan, end)
        plan.grab()
        QTest.mouseRelease(plan, KEYS.LeftButton, KEYS.NoModifier, end)
        plan.show_view(console.view(11.0))

    turn(3, 12.0)
    assert console.file.rows[3].tilt_deg == row.tilt_deg
    plan.editable = True
    turn(3, 12.0)
    assert console.file.rows[3].tilt_deg == pytest.approx(12.0, abs=1.0), "a pixel is 1 degree here"
    assert console.file.rows[3].baseline_m == row.baseline_m and "# Thesis 6.7" in console.file.text
    turn(3, 80.0)
    assert console.file.rows[3].tilt_deg == 30.0
    for _ in range(4):
        QTest.keyClick(plan, KEYS.Key_PageDown)
    assert "goal 4 is chosen" in plan.accessibleDescription()
    QTest.keyClick(plan, KEYS.Key_Right, KEYS.ShiftModifier)
    QTest.keyClick(plan, KEYS.Key_Right)
    assert (console.file.rows[3].tilt_deg, console.file.rows[3].baseline_m) == (
        29.0,
        row.baseline_m + 0.1,
    )
    for _ in range(2):
        QTest.keyClick(plan, KEYS.Key_PageDown)
    QTest.keyClick(plan, KEYS.Key_Up, KEYS.ShiftModifier)
    assert console.file.rows[5].axis == "vertical" and console.file.rows[5].tilt_deg == 0.0
    QTest.keyClick(plan, KEYS.Key_Up)
    assert console.file.rows[5].baseline_m == pytest.approx(5.1)


def test_stations_are_drawn_named_and_chosen_by_a_click(shown, app):
    window, console, asked = shown("flying", SITE)
    view = console.view(samples.NOW_S)
    marks = above_view.stations(view)
    assert [m.name for m in marks] == ["south", "middle", "north"]
    assert [m.running for m in marks].count(True) == 1 and marks[1].rows == (4, 5, 6, 7)
    assert math.isclose(marks[2].headings_rad[0], math.radians(-30.0))
    assert "station middle" in window.plan.accessibleDescription()
    scale = window.plan.scale
    for mark in marks:
        u, v = scale.to_px(*mark.place_m)
        assert 0.0 < u < scale.width and 0.0 < v < scale.height
    at = QtCore.QPoint(*map(round, scale.to_px(*marks[1].place_m)))
    QTest.mouseClick(window.plan, KEYS.LeftButton, pos=at)
    assert window.mission.table.chosen() == [4, 5, 6, 7]
    numbers = [window.mission.table.item(row, 0).text() for row in (2, 4, 11)]
    assert numbers == ["> 3 south 30°", "5 middle 20°", "12 north 0°"]
    assert window.plan.grab().toImage().width() > 0
    assert window.buttons["resume_station"].isVisible()
    assert not window.buttons["resume_station"].isEnabled(), "it takes the place of Execute"
    for name, key in (("skip_station", KEYS.Key_J), ("repeat_station", KEYS.Key_T)):
        assert window.buttons[name].isVisible()
        window.setFocus()
        hold(app, window, key, 0.05)
        assert asked[-1] == (name, {})


def test_without_stations_there_are_no_buttons_of_them(shown):
    window, console, _ = shown("flying")
    assert above_view.stations(console.view(samples.NOW_S)) == []
    for name in actions.OF_STATIONS:
        assert not window.buttons[name].isVisible() and not window.buttons[name].isEnabled()


def test_gauges_tell_how_far_who_flies_is_from_its_place(shown):
    from fcsv_console.model.gauges import gauges

    window, console, _ = shown("flying")
    view = window.plan._view
    own, other = gauges(view)
    assert (own.name, other.name) == ("uav1", "uav2")
    place, row = view.vehicles[1].place.value, view.file.rows[view.running]
    assert (
        other.left_m == pytest.approx(place.p_home_m[1] + row.baseline_m)
        and abs(other.left_m) < 0.1
    )
    assert other.words in window.plan.accessibleDescription()
    assert gauges(replace(view, running=None)) == () and not gauges(console.view(view.now_s + 60.0))


def test_what_mocap_and_gimbals_see_is_painted_only_while_it_is_known(shown):
    from fcsv_console.qt import colours

    window, console, _ = shown("flying")
    plan = window.plan
    samples.ground_cameras(console)
    window.show_view(console.view(samples.NOW_S))
    scale = plan.scale
    u, v = (round(x) for x in scale.to_px(2.9, 3.0))  # in the mocap's view alone, far from all else
    ground = plan.palette().color(QtGui.QPalette.Base)
    with_it = plan.grab().toImage()
    assert (
        with_it.pixelColor(u, v) != ground
        and "what the mocap sees is drawn" in plan.accessibleDescription()
    )
    eye = with_it.pixelColor(*(round(x) for x in scale.to_px(-2.5, -0.4)))
    assert eye == QtGui.QColor(colours.VEHICLES[1]), (
        "a gimbal has the colour of the vehicle that it follows"
    )
    later = replace(window._view, ground_views=())
    window.show_view(later)
    assert plan.scale != scale, "the vehicles have the picture for themselves"
    plan.show_view(replace(later, ground_views=()))
    assert "mocap" not in plan.accessibleDescription()


def test_the_wheel_on_the_height_bar_changes_a_vertical_goal_while_it_is_allowed(shown, app):
    window, console, _ = shown("flying")
    window.goal_changed.connect(console.drag)
    plan = window.plan
    at = QtCore.QPoint(plan.width() - 20, int(round(plan.bar.to_px(7.0))))

    def wheel(position, notches=2):
        QTest.mouseMove(plan, position)
        where = QtCore.QPointF(position)
        plan._mouse = where
        event = QtGui.QWheelEvent(
            where,
            where,
            QtCore.QPoint(),
            QtCore.QPoint(0, 120 * notches),
            KEYS.NoButton,
            KEYS.NoModifier,
            KEYS.NoScrollPhase,
            False,
        )
        app.sendEvent(plan, event)

    before = [r.baseline_m for r in console.file.rows]
    wheel(at)
    assert [r.baseline_m for r in console.file.rows] == before
    window.drag.click()
    wheel(at)
    assert [r.baseline_m for r in console.file.rows] == [*before[:6], 8.0, 10.0]
    scale = plan.scale.px_per_m
    wheel(QtCore.QPoint(40, 40))
    assert plan.scale.px_per_m > scale, "elsewhere it zooms"
    rows = console.file.rows
    assert (
        above_view.wheeled(rows[5], -100.0) == 0.1
        and above_view.wheeled(rows[0], 2.0) == rows[0].baseline_m
    )


def test_an_amber_line_is_accepted_by_its_name(shown, app):
    window, _, asked = shown("ground")
    assert not window.accept.isEnabled()
    names = [window.check.item(i, 1).text() for i in range(window.check.rowCount())]
    window.check.selectRow(names.index("pre-arm"))
    assert not window.accept.isEnabled() and "it is RED" in window.accept.toolTip()
    window.check.selectRow(names.index("battery"))
    assert window.accept.isEnabled()
    hold(app, window, KEYS.Key_Return, 0.0)
    assert asked == [("accept", {"vehicle": "uav2", "line": "battery"})]


def test_the_line_that_is_chosen_stays_chosen_where_another_comes_above_it(shown, app):
    """The worst stand first: the row under the selection is another line's all of a sudden."""
    window, console, asked = shown("ground")

    def lines():
        return [
            tuple(window.check.item(i, k).text() for k in (0, 1))
            for i in range(window.check.rowCount())
        ]

    window.check.selectRow(lines().index(("uav2", "battery")))
    slow = {("uav1", "camera"): {"state": Grade.AMBER, "what": "0.4 pictures a second"}}
    told = [
        replace(li, **slow.get((li.vehicle, li.name), {}))
        for li in console.view(samples.NOW_S).check
    ]
    console.tell(samples.NOW_S, facts.FlightCheckReport(tuple(told)))
    window.show_view(console.view(samples.NOW_S))
    assert (
        lines() == [("uav1", "pre-arm"), ("uav1", "camera"), ("uav2", "battery")]
        and window.accept.isEnabled()
    )
    hold(app, window, KEYS.Key_Return, 0.0)
    assert asked == [("accept", {"vehicle": "uav2", "line": "battery"})]
    console.tell(
        samples.NOW_S, facts.FlightCheckReport(tuple(li for li in told if li.name != "battery"))
    )
    window.show_view(console.view(samples.NOW_S))
    assert window.check.chosen() == [] and not window.accept.isEnabled(), (
        "it is gone: no other is chosen for it"
    )


def test_execute_takes_the_configurations_that_are_chosen(shown, app):
    window, _, asked = shown("ready")
    window.mission.table.selectRow(2)
    hold(app, window, KEYS.Key_X, 1.2)
    assert asked == [("execute", {"configurations": [2]})]


def test_a_vehicle_that_vanishes_is_shown_and_nothing_is_lost_on_the_way_back(shown):
    window, console, _ = shown("flying")
    window.show_view(console.view(samples.NOW_S + 1.2))
    flown = [window.vehicles.item(0, k).text() for k in (1, 2)]
    assert all(words.startswith("not heard for 1.2 s") for words in flown), flown
    samples.flying(console)
    window.show_view(console.view(samples.NOW_S))
    assert window.vehicles.item(0, 1).text() == "mission"


def test_the_worst_line_of_diagnostics_is_seen_without_scrolling(shown, app):
    window, _, _ = shown("ground")
    app.processEvents()
    table = window.vehicles
    (k,) = (i for i in range(table.rowCount()) if table.item(i, 0).text() == "diagnostics")
    item = table.item(k, 2)
    assert item.text() == "WARN tags: slow or silent: pictures"
    assert table.viewport().rect().contains(table.visualItemRect(item))


def test_the_docks_open_and_close_by_key(shown, app):
    window, _, _ = shown("silent")
    for key, dock in ((KEYS.Key_F4, window.pictures), (KEYS.Key_F5, window.after)):
        hold(app, window, key, 0.0)
        assert dock.isVisible()
        hold(app, window, key, 0.0)
        assert not dock.isVisible()


@pytest.mark.parametrize("size", [(1366, 740), (960, 540)])
def test_rviz_stands_in_the_plans_place_then_alone_then_the_plan_is_back(shown, app, size):
    """It says in its place what is missing: without a master it is not started. Who is above whom
    is always told."""
    window, console, _ = shown("wrong")
    console.tell(samples.NOW_S, facts.MasterReport("the master does not answer"))
    window.resize(*size)
    window.show_view(console.view(samples.NOW_S))
    for _ in range(4):
        app.processEvents()
    before = window.panels.sizes()
    for rviz_wide, others in ((before[0], True), (sum(before), False)):
        hold(app, window, KEYS.Key_F2, 0.0)
        assert window.size() == QtCore.QSize(*size) and not window.plan.isVisible()
        assert window.map.rviz.isVisible() and window.map.rviz.width() >= rviz_wide
        assert window.vehicles.isVisible() is window.events.isVisible() is others
        assert "uav2 is 5.0 m above uav1" in window.stop_words.text()
        assert (
            any(p in window.stop_words.text() for p in console.view(samples.NOW_S).problems)
            is not others
        )
        for name in ("stop_all", "land", "abort"):
            button = window.buttons[name]
            assert button.visibleRegion().boundingRect().size() == button.size()
    assert "open it again" in window.map.rviz.findChild(QtWidgets.QLabel).text()
    hold(app, window, KEYS.Key_F2, 0.0)
    assert (
        window.plan.isVisible() and window.vehicles.isVisible() and window.panels.sizes() == before
    )
    assert "above" not in window.stop_words.text()


def test_function_keys_work_while_the_focus_is_in_a_field(shown, app):
    window, _, asked = shown("landed")
    hold(app, window, KEYS.Key_F5, 0.0)
    window.after.fields["sources"].setFocus()
    app.processEvents()
    hold(app, window, KEYS.Key_P, 0.0)
    assert (
        asked == []
        and window.after.isVisible()
        and window.after.fields["sources"].text().endswith("p")
    )
    hold(app, window, KEYS.Key_F5, 0.0)
    assert not window.after.isVisible()


def test_a_plan_from_the_form_stands_in_the_list_and_its_rehearsal_is_asked_for(shown, app):
    window, console, asked = shown("ready")
    form = window.mission.plan
    window.planned.connect(lambda wanted: form.show_planned(console.plan(wanted)))
    form.range.setValue(240)
    form.number.setValue(2)
    form.error.setText("much")
    form.go.click()
    assert "'much' is not understood" in form.note.text() and len(console.file.rows) == 8
    form.error.setText("10%")
    form.go.click()
    assert "2 configurations, to 240 m" in form.note.text() and len(console.file.rows) == 2
    window.show_view(console.view(samples.NOW_S))
    assert window.mission.note.text() == "outdoor.yaml, changed and not saved"
    assert (
        window.mission.rehearsal.text() == "not rehearsed"
        and not window.buttons["execute"].isEnabled()
    )
    assert "it reads its file when it starts" in window.buttons["execute"].toolTip()
    hold(app, window, KEYS.Key_V, 0.0)
    hold(app, window, KEYS.Key_W, 1.2)
    assert asked == [("rehearse", {}), ("waive", {})]


@pytest.mark.parametrize("situation", samples.SAMPLES)
@pytest.mark.parametrize("size", [(1366, 740), (960, 540)])
def test_every_situation_is_drawn_at_a_small_size_too(shown, app, situation, size):
    """960 x 540 is a screen of 1920 x 1080 at 200 %."""
    window, _, _ = shown(situation)
    window.resize(*size)
    app.processEvents()
    picture = window.grab().toImage()
    assert (picture.width(), picture.height()) == size, "the window takes no more than it is given"
    assert len({picture.pixel(x, 200) for x in range(0, picture.width(), 3)}) > 3
    stop = window.buttons["stop_all"]
    assert stop.isVisible() and stop.visibleRegion().boundingRect().size() == stop.size()


@pytest.mark.parametrize("size", [(1366, 740), (960, 540)])
def test_no_figure_of_a_vehicle_or_a_configuration_is_cut(shown, app, size):
    window, _, _ = shown("wrong")
    window.resize(*size)
    for _ in range(4):
        app.processEvents()
    vehicles, table = window.vehicles, window.mission.table
    for i in range(vehicles.rowCount()):
        assert vehicles.rowHeight(i) >= vehicles.sizeHintForRow(i), vehicles.item(i, 0).text()
    assert vehicles.rowHeight(0) > vehicles.rowHeight(1), (
        "the guardian's reason takes a second line"
    )
    assert table.horizontalScrollBar().maximum() == 0
    for k in range(table.columnCount()):
        assert table.columnWidth(k) >= table.sizeHintForColumn(k), table.horizontalHeaderItem(
            k
        ).text()
    assert size[1] == 540 or table.verticalScrollBar().maximum() == 0, (
        "eight configurations without scrolling"
    )


@pytest.mark.parametrize("size, told", [((1366, 740), 2), ((960, 540), 1)])
def test_problems_leave_the_flight_check_its_room(shown, app, size, told):
    window, console, _ = shown("wrong")
    window.resize(*size)
    window.show_view(console.view(samples.NOW_S))
    for _ in range(4):
        app.processEvents()
    problems = console.view(samples.NOW_S).problems
    assert len(
        window.problems.text().splitlines()
    ) == told and window.problems.toolTip().splitlines() == list(problems)
    assert window.check.geometry().bottom() < window.problems.geometry().top()
    assert window.problems.geometry().bottom() <= window.problems.parentWidget().height()


@pytest.mark.parametrize("key, name", [(KEYS.Key_F4, "pictures"), (KEYS.Key_F5, "after")])
def test_what_is_opened_at_200_percent_stands_in_place_of_the_panels(shown, app, key, name):
    window, _, _ = shown("silent")
    window.resize(960, 540)
    app.processEvents()
    for _ in range(2):
        hold(app, window, key, 0.05)
        assert window.size() == QtCore.QSize(960, 540) and getattr(window, name).isVisible()
        assert window.panels.isHidden() and window.buttons["land"].isVisible()
        stop = window.buttons["stop_all"]
        assert stop.visibleRegion().boundingRect().size() == stop.size()
        hold(app, window, key, 0.05)
        assert window.panels.isVisible() and not getattr(window, name).isVisible()
    hold(app, window, key, 0.05)
    window.resize(1366, 900)
    app.processEvents()
    assert window.panels.isVisible(), "there is room for both"
    window.resize(960, 540)
    app.processEvents()
    assert window.panels.isHidden()


def test_who_is_above_whom_is_told_where_the_panels_are_hidden(shown, app):
    window, console, _ = shown("wrong")
    window.resize(960, 540)
    hold(app, window, KEYS.Key_F5, 0.05)
    window.show_view(console.view(samples.NOW_S))
    assert "uav2 is 5.0 m above uav1" in window.stop_words.text() and window.stop_words.isVisible()


@pytest.mark.parametrize("situation", ["ground", "flying", "landed"])
def test_the_names_of_home_and_vehicles_cover_no_vehicle_and_no_goal(shown, situation):
    plan = shown(situation)[0].plan
    pixmap = QtGui.QPixmap(plan.size())
    painter = QtGui.QPainter(pixmap)
    picture = plan.picture(painter)
    picture.paint()
    painter.end()
    *before, one, two, home = picture.taken
    for label in (one, two, home):
        assert not [b for b in before if above_view._shared(label, b) > 0.0]


@pytest.mark.parametrize("x", [10.0, 150.0, 400.0])
def test_a_name_is_never_cut_by_the_height_bar(shown, x):
    plan = shown("flying")[0].plan
    pixmap = QtGui.QPixmap(plan.size())
    painter = QtGui.QPainter(pixmap)
    box = plan.picture(painter).label(
        QtCore.QPointF(min(x, plan.width()), 100.0), "uav2  +10.0 m, 12.3 s old"
    )
    painter.end()
    assert box.width() > 60.0 and box.right() < plan.width() - 64.0


@pytest.mark.parametrize("size", [(1366, 740), (960, 540)])
def test_events_and_their_answers_are_read_whole(shown, app, size):
    window, _, _ = shown("flying")
    window.resize(*size)
    for _ in range(4):
        app.processEvents()
    events = window.events
    assert "hand over → confirmed: execute" in [
        events.item(k, 2).text() for k in range(events.rowCount())
    ]
    for row in range(events.rowCount()):
        assert events.rowHeight(row) >= events.sizeHintForRow(row)
    assert sum(events.columnWidth(k) for k in range(3)) <= events.viewport().width()


# ---- what stands out, and what does not move -----------------------------------------------------


def standing_out(window):
    return [
        b.accessibleName() for b in window.findChildren(QtWidgets.QPushButton) if b.property("next")
    ]


@pytest.mark.parametrize(
    "situation, names",
    [
        ("starting", ["Rehearse"]),
        ("ground", []),
        ("calibrated", ["Set home"]),
        ("ready", ["Execute"]),
        ("flying", []),
        ("wrong", []),
        ("landed", ["After the flight"]),
    ],
)
def test_one_button_stands_out_at_most(shown, situation, names):
    window, console, _ = shown(situation)
    assert standing_out(window) == names
    window.show_view(replace(console.view(samples.NOW_S), guide=type(window._view.guide)("over")))
    assert standing_out(window) == [], "and no longer than it is next"


def test_in_the_dock_the_step_that_is_next_stands_out_in_place_of_the_button_that_opens_it(
    shown, app
):
    window, console, _ = shown("landed")
    console.tell(samples.NOW_S, facts.JobProgress("map", "done", words="wrote a map"))
    console.tell(samples.NOW_S, facts.PlacesFound(True, True))
    hold(app, window, KEYS.Key_F5, 0.0)
    window.show_view(console.view(samples.NOW_S))
    assert standing_out(window) == ["Report"]


@pytest.mark.parametrize("size", [(1366, 740), (960, 540)])
def test_nothing_moves_when_words_become_longer(shown, app, size):
    window, console, _ = shown("flying")
    window.resize(*size)
    parts = (
        window.plan,
        window.vehicles,
        window.check,
        window.events,
        window.mission.table,
        window.progress,
    )

    def places():
        for _ in range(4):
            app.processEvents()
        return [QtCore.QRect(p.mapTo(window, QtCore.QPoint(0, 0)), p.size()) for p in parts]

    view = console.view(samples.NOW_S)
    window.show_view(replace(view, problems=()))
    before = places()
    long = "it goes on and on, and says one thing after another, " * 9
    stop = replace(view.stop, value=facts.StopReport("stop", long))
    told = replace(
        view,
        guide=replace(view.guide, headline=long),
        problems=(long,) * 5,
        stop=stop,
        stereo=replace(view.stereo, go=False, reasons=(long,)),
        rehearsal=replace(view.rehearsal, state="broken", words=long),
    )
    window.show_view(told)
    assert places() == before
    for label in (window.headline, window.problems, window.map.stereo, window.mission.rehearsal):
        assert label.shown.endswith("…") and long[:40] in label.toolTip(), (
            "what is cut is in the tooltip"
        )
        assert label.shown.count("\n") < label.lines
    window.show_view(replace(view, guide=replace(view.guide, headline="short")))
    assert window.headline.shown == "short" and window.headline.toolTip() == ""


def test_a_view_is_drawn_whole_within_the_picture(shown):
    window, console, _ = shown("flying")
    plan = window.plan
    for v in console.view(samples.NOW_S).vehicles:
        for corner in above_view.sight(v.place.value, plan._fov_rad):
            u, w = plan.scale.to_px(*corner)
            assert 0.0 <= u <= plan.scale.width and 0.0 <= w <= plan.scale.height


def test_an_empty_panel_says_why_it_is_empty(app, opened):
    console = Console(["uav1", "uav2"])
    window = opened(console)
    window.show()
    window.show_pictures.click()
    app.processEvents()
    boxes = (*window.pictures.boxes.values(), window.pictures.map)
    assert (
        "No picture of uav1 was heard yet" in boxes[0].empty
        and "live map does not run" in boxes[2].empty
    )

    def inked(box):
        picture = box.grab().toImage()
        return (
            len(
                {
                    picture.pixel(x, y)
                    for x in range(picture.width())
                    for y in range(picture.height() - 20)
                }
            )
            > 1
        )

    assert all(inked(box) for box in boxes)
    console.tell(samples.NOW_S, facts.MapReport("waiting", "no configuration yet"))
    window.show_view(console.view(samples.NOW_S))
    assert boxes[2].empty.endswith("(live map: waiting: no configuration yet)")

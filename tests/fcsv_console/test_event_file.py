# SPDX-License-Identifier: Apache-2.0
"""Events are kept with the session, whole and not too often; where they cannot be kept this is told
once."""

import pytest
from support.waiting import within

from fcsv_console.model.events import EventLog

pytest.importorskip("rospy")

from fcsv_console.ros.event_file import EventFile


def written(file):
    """Once its thread has ended."""
    within(10.0)(lambda: not file._writer.is_alive(), what="its thread ends")
    return file.path.read_text().splitlines() if file.path.exists() else None


def test_what_changed_is_kept_and_answers_too(tmp_path):
    log, told = EventLog(), []
    file = EventFile(tmp_path / "session", told.append, 1.7e9)
    assert file.path.name == "console_events_20231114T221320Z.csv"
    file.keep(10.0, log)
    assert written(file) is None, "nothing happened yet"
    number = log.add(1.7e9, "operator", "land all")
    file.keep(10.1, log)
    assert written(file)[1].endswith(",operator,land all,,info")
    log.answer(number, "sent", True)
    file.keep(10.2, log)
    assert len(written(file)) == 2 and "sent" not in written(file)[1], "not so soon"
    file.keep(12.2, log)
    assert written(file)[1].endswith(",operator,land all,sent,info")
    log.add(1.7e9, "console", "closes")
    file.close(log)
    assert len(written(file)) == 3 and told == [] and len(list(file.path.parent.iterdir())) == 1


def test_a_folder_that_cannot_be_is_told_once(tmp_path):
    (tmp_path / "session").write_text("a file stands there")
    log, told = EventLog(), []
    file = EventFile(tmp_path / "session", told.append, 0.0)
    for k in range(3):
        log.add(0.0, "a", "b")
        file.keep(10.0 * k, log)
        written(file)
    file.close(log)
    (only,) = told
    assert only.topic == "events" and only.why.startswith("not kept: ") and "session" in only.why


def test_a_sound_is_made_for_warnings_and_only_where_it_was_asked_for(opened, monkeypatch):
    from python_qt_binding.QtWidgets import QApplication

    from fcsv_console.model import samples

    beeps = []
    monkeypatch.setattr(QApplication, "beep", lambda *_: beeps.append(1))
    c = samples.console("config/missions/outdoor.yaml")
    samples.flying(c)
    window = opened(c)

    def happens(level):
        c.log.add(0.0, "uav1 autopilot", "EKF variance", level=level)
        window.show_view(c.view(samples.NOW_S))

    happens("error")
    assert beeps == [] and not window.sound.isChecked(), "off by default"
    window.sound.setChecked(True)
    window.show_view(c.view(samples.NOW_S))
    happens("info")
    assert beeps == []
    happens("warning")
    assert beeps == [1]
    window.show_view(c.view(samples.NOW_S))
    assert beeps == [1], "once"

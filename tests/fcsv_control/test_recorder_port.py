# SPDX-License-Identifier: Apache-2.0
"""The recorder's port: pictures only while they are wanted, session.yaml, a disk that fills, and
silence."""

import math
from dataclasses import replace

import pytest

from fcsv_control.agent.messages import Pictures
from fcsv_control.recorder_port import (
    EndRecording,
    PartWritten,
    PictureCame,
    RecorderPort,
    RecorderReport,
    SaveSession,
    SessionSaved,
    Written,
)
from fcsv_control.recording import RecorderParameters
from fcsv_control.session import new_session
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.vehicles.telemetry import Diagnosis

IMAGE = PictureCame("/uav1/camera/color/image_raw", b"picture", image=True)
INFO = PictureCame("/uav1/camera/color/camera_info", b"info", image=False)
WELL = Written("/out/uav1.bag", 3, 2_000_000, 1, "", free_bytes=10 << 30)


def parameters(**changed):
    return RecorderParameters(**{"role": "vehicle", "name": "uav1", "folder": "/out", **changed})


def told(port, now_s, *messages):
    for message in messages:
        port.receive(now_s, message)
    return port.step(now_s)


def of(out, kind):
    return [o for o in out if isinstance(o, kind)]


@pytest.fixture
def session(root):
    mission = load_mission(root / "config/missions/short.yaml")
    return new_session(mission, ["uav1", "uav2"], "2026-01-02T03:04:05Z")


@pytest.mark.parametrize("first", [False, True])
def test_pictures_are_written_only_while_they_are_wanted(first):
    port = RecorderPort(parameters(pictures_on=first), 0.0)
    assert told(port, 0.1, IMAGE, INFO) == ([IMAGE, INFO] if first else [])
    assert told(port, 1.0, Pictures(True), IMAGE, INFO) == [IMAGE, INFO]
    assert told(port, 2.0, Pictures(False), IMAGE) == []


def test_what_the_writer_did_is_told():
    port = RecorderPort(parameters(pictures_on=True), 0.0)
    out = told(port, 0.5, WELL)
    (status,) = of(out, RecorderReport)
    assert status == RecorderReport(WELL.path, True, 3, 2_000_000, 1, math.inf, "")
    assert of(out, Diagnosis)[0].problems == {"disk": "", "pictures": ""}
    assert not of(out, SaveSession), "a vehicle writes no session.yaml"


def test_a_disk_that_fills_ends_the_recording_once_and_says_what_to_do():
    port = RecorderPort(parameters(least_free_mib=500), 0.0)
    full = replace(WELL, free_bytes=499 << 20)
    out = told(port, 1.0, full)
    (end,) = of(out, EndRecording)
    assert "less than 500 MiB are free on the disk of /out; make room" in end.why
    assert of(out, RecorderReport)[0].problem == end.why
    again = told(port, 2.0, replace(full, problem=end.why))
    assert not of(again, EndRecording) and of(again, RecorderReport)[0].problem == end.why


def test_a_camera_that_falls_silent_while_pictures_are_wanted_is_said():
    port = RecorderPort(parameters(no_picture_s=2.0), 0.0)

    def said(now_s, *messages):
        return of(told(port, now_s, *messages, WELL), Diagnosis)[0].problems["pictures"]

    assert said(50.0) == "", "nobody wants pictures"
    assert said(51.0, Pictures(True)) == ""
    assert said(55.0, INFO) == "uav1: no picture for 2 s", "a camera_info is no picture"
    assert said(55.5, IMAGE) == ""


def test_further_parts_go_into_the_session_until_it_is_saved(session):
    port = RecorderPort(
        parameters(role="control", name="control", vehicles=["uav1", "uav2"], mission="short.yaml"),
        0.0,
        session,
    )
    own = replace(WELL, path="/out/control.bag")
    assert not of(told(port, 1.0, own), SaveSession), "its first bags are in it"
    (save,) = told(port, 2.0, PartWritten("uav2", "uav2.1.bag"))
    assert save.session.parts == {"uav2": ["uav2.1.bag"]}
    assert of(told(port, 3.0, own), SaveSession) == [save], "the disk had refused it"
    port.receive(3.0, SessionSaved(save.session))
    assert told(port, 4.0, PartWritten("uav2", "uav2.1.bag")) == []
    (save,) = of(told(port, 5.0, replace(own, path="/out/control.1.bag")), SaveSession)
    assert save.session.parts == {"uav2": ["uav2.1.bag"], "control": ["control.1.bag"]}


def test_what_it_does_not_know_is_refused():
    with pytest.raises(TypeError, match="takes no str"):
        RecorderPort(parameters(), 0.0).receive(0.0, "a text")

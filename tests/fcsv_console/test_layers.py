# SPDX-License-Identifier: Apache-2.0
"""The terminal view, and messages into facts, without a master."""

import io
import math
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console as Screen

from fcsv_console.model import facts, samples
from fcsv_console.model.console import Console
from fcsv_console.terminal.screen import screen
from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.vehicles.modes import Mode

OUTDOOR = str(Path(__file__).resolve().parents[2] / "config/missions/outdoor.yaml")


def printed(view, width=80):
    out = io.StringIO()
    Screen(file=out, width=width).print(screen(view))
    return out.getvalue().splitlines()


def sample(name):
    c = samples.console(OUTDOOR)
    samples.SAMPLES[name](c)
    return c.view(samples.NOW_S)


@pytest.mark.parametrize("name", samples.SAMPLES)
def test_every_situation_fits_on_one_screen_of_80_columns(name):
    lines = printed(sample(name))
    assert max(len(line) for line in lines) <= 80 and len(lines) <= (25 if name == "wrong" else 24)
    assert "S stop all" in lines[0] and "L land all" in lines[0], "however low the terminal is"


@pytest.mark.parametrize(
    "name, words",
    [
        ("ground", ["uav1    pre-arm    RED", "amber   38 %", "on the ground, motors off"]),
        (
            "ready",
            [
                "Home is set. Execute [X] flies 8",
                "82%, 9:17 left",
                "pilot, LOITER",
                "flight check: green",
            ],
        ),
        (
            "starting",
            [
                "10 lines wait, normal for about a minute: uav1 ekf",
                "flight check: starting, 10 of 32 lines",
            ],
        ),
        (
            "calibrated",
            [
                "Calibrated well: 25 views, 0.13°. Fly uav1 to its view, then Set home [H]",
                "2.1 m up",
            ],
        ),
        ("flying", ["3/8 horizontal 6 m: to 361 m", "GO: the pair is as planned", "REC 96 min"]),
        (
            "wrong",
            [
                "stop all (the operator",
                "uav2 is 5.0 m above uav1",
                "p_odom_m holds nan",
                "guardian: hold",
            ],
        ),
        ("silent", ["not heard for 2.4 s", "the ROS master does not answer", "no recorder"]),
    ],
)
def test_a_situation_is_told_in_words(name, words):
    text = "\n".join(printed(sample(name)))
    assert not [w for w in words if w not in text]


def test_poses_in_odometry_in_home_and_against_the_others_stand_whole_in_80_columns():
    text = printed(sample("flying"))
    assert len(
        text
    ) <= 24 and "uav2    odometry +0.2 -6.0 +8.0 m, +2°  home +0.0 -6.0 +0.0 m, +1°" in map(
        str.rstrip, text
    )
    assert [line.rstrip() for line in text if " from " in line] == [
        "uav2    from uav1: 6.02 m (+0.0 -6.0 +0.0), +1°"
    ]
    gone = "\n".join(printed(sample("silent")))
    assert "odometry +0.2 -4.0 +8.0 m, +2°  home +0.0 -4.0 +0.0 m, +1°, 2.4 s old" in gone
    assert "from uav1: not known" in "\n".join(printed(Console(["uav1", "uav2"]).view(0.0)))


def test_a_console_that_heard_nothing_shows_it():
    text = "\n".join(printed(Console(["uav1", "uav2"]).view(0.0)))
    assert (
        "no mission is heard" in text
        and "not heard yet" in text
        and "flight check: starting, not heard" in text
    )


def test_colours_are_never_the_only_sign():
    """The printed text has no colours at all, and each state differs in it."""
    assert len({"\n".join(printed(sample(name))) for name in samples.SAMPLES}) == len(
        samples.SAMPLES
    )


# ---- messages ------------------------------------------------------------------------------------


def test_diagnostics_of_a_vehicle_become_a_fact_without_what_is_well():
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    from fcsv_console.ros import messages

    kind, convert = messages.OF_VEHICLE["diagnostics/worst"]
    told = [DiagnosticStatus(level=level, name=f"n{level}", message="m") for level in (2, 0, 3, 9)]
    assert kind is DiagnosticArray
    assert convert("uav1", DiagnosticArray(status=told)) == facts.Diagnosed(
        "uav1", (("n2", 2, "m"), ("n3", 3, "m"))
    )


def test_the_pyramids_of_the_node_markers_become_what_cameras_on_the_ground_see():
    """By the functions that draw them for rviz, so that neither side drifts."""
    from fcsv_console.ros import ground_views
    from fcsv_geometry import transforms
    from fcsv_geometry.camera import PinholeCamera
    from fcsv_tracking.ros.tracking_markers import gimbal_views, mocap_view

    mocap = mocap_view("mocap", (47.0, 43.0))
    found = ground_views.seen(
        mocap, transforms.from_xyz_yaw(np.array([1.0, 2.0, 3.0]), math.pi / 2.0)
    )
    corners = np.array(found.corners_m)
    assert found.gimbal_of == "" and found.eye_m == pytest.approx((1.0, 2.0, 3.0))
    assert np.ptp(corners[:, 1]) == pytest.approx(0.0, abs=1e-9), (
        "turned to the left it looks along home's y"
    )
    reach_m = corners[0, 1] - 2.0
    assert reach_m > 1.0 and np.ptp(corners[:, 0]) == pytest.approx(
        2 * reach_m * math.tan(math.radians(47.0 / 2))
    )
    assert np.ptp(corners[:, 2]) == pytest.approx(2 * reach_m * math.tan(math.radians(43.0 / 2)))
    assert mocap.ns == ground_views.MOCAP
    (gimbal,) = gimbal_views({"uav2": PinholeCamera(600.0, 600.0, 320.0, 240.0, 640, 480)})
    found = ground_views.seen(gimbal, np.eye(4), 0.3)
    assert gimbal.ns == ground_views.GIMBALS and (found.gimbal_of, found.age_s) == ("uav2", 0.3)
    assert np.ptp(np.array(found.corners_m)[:, 2]) == 0.0, "an optical frame looks along z"
    with pytest.raises(FcsvError):
        gimbal.points = gimbal.points[:5]
        ground_views.seen(gimbal, np.eye(4))


def test_messages_become_facts():
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import BatteryState, CompressedImage

    from fcsv_console.ros import messages
    from fcsv_geometry import transforms
    from fcsv_geometry.missions.camera_places import camera_place
    from fcsv_geometry.missions.mission import StereoConfiguration
    from fcsv_geometry.ros import conversions
    from mavros_msgs.msg import State

    def convert(topic, message):
        return messages.OF_VEHICLE[topic][1]("uav2", message)

    told = convert(
        "mavros/state", State(connected=True, armed=True, mode=Mode.GUIDED, system_status=5)
    )
    assert told == facts.AutopilotReport("uav2", True, True, Mode.GUIDED, 5)
    assert math.isnan(convert("mavros/battery", BatteryState(percentage=-0.01)).share)
    pose = PoseWithCovarianceStamped()
    pose.pose.pose = conversions.transform_to_pose(
        camera_place(StereoConfiguration("horizontal", 4.0, 10.0))
    )
    seen = convert("camera_pose", pose)
    assert seen.p_home_m == pytest.approx((0.0, -4.0, 0.0)) and seen.heading_rad == pytest.approx(
        math.radians(10.0)
    )
    assert seen.pitch_rad == pytest.approx(0.0)
    odometry = Odometry()
    odometry.pose.pose = conversions.transform_to_pose(
        transforms.from_xyz_yaw((1.0, 2.0, 3.0), -0.5)
    )
    assert convert("odometry/state", odometry).yaw_rad == pytest.approx(-0.5)
    picture = CompressedImage(format="jpeg", data=b"\xff\xd8\xff")
    assert convert("camera/color/image_raw/compressed", picture) == facts.PreviewReport(
        "uav2", 0.0, b"\xff\xd8\xff"
    )


def test_a_picture_as_a_vehicle_records_it_is_shown_like_one_that_crossed_the_radio():
    """Of a bag that is played; one of another encoding is told."""
    import cv2
    from sensor_msgs.msg import Image

    from fcsv_console.ros import messages
    from fcsv_console.ros.hearing import Hearing

    ((topic, (_, convert)),) = messages.RECORDED.items()
    image = Image(height=2, width=3, encoding="rgb8", step=9, data=bytes([200, 100, 50] * 6))
    told = convert("uav2", image)
    shown = cv2.imdecode(np.frombuffer(told.data, np.uint8), cv2.IMREAD_COLOR)
    assert shown.shape == (2, 3, 3) and np.abs(shown.astype(int) - (50, 100, 200)).max() < 12, (
        "JPEG"
    )
    with pytest.raises(FcsvError, match="13UC5"):
        convert("uav2", Image(height=2, width=3, encoding="13UC5", step=9, data=bytes(18)))
    assert (
        topic in Hearing(["uav2"], recorded=True)._of_vehicle
        and topic not in Hearing(["uav2"])._of_vehicle
    )


def test_a_message_that_cannot_be_read_is_told_and_nothing_else():
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from sensor_msgs.msg import CompressedImage

    from fcsv_console.ros import messages
    from fcsv_console.ros.hearing import Hearing

    hearing = Hearing(["uav2"])
    nan = PoseWithCovarianceStamped()
    nan.pose.pose.position.x = math.nan
    picture = CompressedImage(format="h265", data=b"\0\0")
    bad = (
        ("camera_pose", nan),
        ("camera_pose", PoseWithCovarianceStamped()),
        ("camera/color/image_raw/compressed", picture),
    )
    for topic, message in bad:
        hearing._keep(
            lambda t=topic, m=message: [messages.OF_VEHICLE[t][1]("uav2", m)], "uav2", topic
        )
    told = [fact for _, fact in hearing.drain()]
    assert [type(fact) for fact in told] == [facts.Unusable] * 3 and "h265" in told[2].why
    c = Console(["uav1", "uav2"])
    for fact in told:
        c.tell(0.0, fact)
    assert len(c.view(0.1).problems) == 3


def test_links_of_the_relay_become_radios():
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    from fcsv_console.ros import messages

    values = [KeyValue("round_trip_s", "0.0062"), KeyValue("in_loss", "-")]
    array = DiagnosticArray(
        status=[
            DiagnosticStatus(name="link control-uav1", level=b"\0", values=values),
            DiagnosticStatus(name="other"),
        ]
    )
    (radio,) = messages.radios(array)
    assert radio.vehicle == "uav1" and radio.round_trip_s == 0.0062 and math.isnan(radio.loss)


def test_a_master_that_comes_back_is_told_of_everything_again(monkeypatch):
    import rospy

    from fcsv_console.ros import hearing as module

    answers, again = iter([None, False, True]), []
    hearing = module.Hearing(["uav1"])

    def knows():
        try:
            return next(answers)
        except StopIteration:
            hearing._over.set()
            return True

    monkeypatch.setattr(module, "_LOOK_S", 0.001)
    monkeypatch.setattr(module, "master_knows_us", knows)
    monkeypatch.setattr(module, "register_again", lambda: again.append(time.monotonic()))
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    hearing._watch_master()
    assert len(again) == 1
    assert [fact.problem for _, fact in hearing.drain()] == [module.NO_MASTER, "", "", ""]


def run_status(*arguments):
    """The command as a process, on no master: nothing listens on port 1."""
    command = (
        "import sys; from fcsv_console.ros.status_command import main; sys.exit(main(sys.argv[1:]))"
    )
    env = dict(os.environ, ROS_MASTER_URI="http://127.0.0.1:1")
    return subprocess.run(
        [sys.executable, "-c", command, *arguments],
        env=env,
        capture_output=True,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
    )


def test_without_a_master_it_says_so_and_ends():
    done = run_status("--once", "--mission", OUTDOOR)
    assert done.returncode == 0, done.stderr
    assert "the ROS master does not answer" in done.stdout and "8 configurations" in done.stdout


def test_a_vehicle_without_a_file_is_named():
    done = run_status("--once", "--vehicles", "uav9")
    assert (
        done.returncode == 2 and done.stderr.startswith("status: ") and "uav9.yaml" in done.stderr
    )


class Shell:
    def __init__(self):
        self.console, self.did = Console(["uav1", "uav2"]), []

    def view(self):
        return self.console.view(time.monotonic())

    def do(self, name):
        self.did.append(name)


def test_keys_are_capital_letters_and_what_is_not_enabled_is_told_and_not_sent():
    from fcsv_console.ros.status_command import press

    shell = Shell()
    for key in ("s", "l", "p", "x", "", "S", "L", "P"):
        press(shell, key)
    assert shell.did == ["stop_all", "land"]
    assert (
        shell.view().events[-1].answer
        == "not now: the mission node is not heard: start it, or mend its file"
    )


def test_the_terminal_resumes_what_is_paused_and_hands_nobody_over():
    from fcsv_console.ros.status_command import press

    shell = Shell()
    green = tuple(Line(name, "battery", Grade.GREEN, "80 %") for name in ("uav1", "uav2"))
    shell.console.tell(time.monotonic(), facts.FlightCheckReport(green))
    for phase, waits_for in (("SET_HOME", "execute"), ("CONFIGURATIONS", "resume")):
        shell.console.tell(time.monotonic(), facts.MissionReport(phase, "", waits_for, 0, 2))
        press(shell, "G")
    assert shell.did == ["hand_over"]
    answers = [e.answer for e in shell.view().events if e.answer]
    assert answers == ["not now: nothing waits for Resume; vehicles are handed over in the window"]

# SPDX-License-Identifier: Apache-2.0
"""Scripted situations: what screenshots and tests of the layers show. Facts go in as they do from
topics."""

import math
from dataclasses import replace
from functools import lru_cache, wraps
from typing import Callable, Dict, List, Sequence, Tuple

import cv2
import numpy as np

from fcsv_console.model import facts as f
from fcsv_console.model.after import Places
from fcsv_console.model.console import Console
from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_control.mission.activities.stages import RECORDS
from fcsv_geometry.vehicles.modes import Mode

NOW_S = 100.0
_NAMES = ("uav1", "uav2")
_CALIBRATION = f.CalibrationReport(
    (f.CalibratedLink("uav2", "uav1", 25, 0, 0.012, math.radians(0.13)),)
)
_TAG = ((294.5, 235.5), (325.5, 235.5), (325.5, 204.5), (294.5, 204.5))


class _Script:
    """Facts and requests of a situation; ``play`` tells them in order of time, as a flight
    would."""

    def __init__(self, console: Console):
        self.file, self.after = console.file, console.after
        self._console = console
        self._told: List[Tuple[float, Callable[[], None]]] = []

    def tell(self, at_s: float, fact: f.Fact) -> None:
        """Does as Console.tell."""
        self._told.append((at_s, lambda: self._console.tell(at_s, fact)))

    def asked(self, at_s: float, name: str, answer: str) -> None:
        """The operator asked for an action, which was done."""
        self._told.append(
            (at_s, lambda: self._console.answer(self._console.ask(at_s, name), answer, True))
        )

    def play(self) -> None:
        """Tell everything."""
        for _, tell in sorted(self._told, key=lambda told: told[0]):
            tell()


Situation = Callable[[Console], None]


def _in_order(situation: Callable[[_Script], None]) -> Situation:
    @wraps(situation)
    def played(console: Console) -> None:
        script = _Script(console)
        situation(script)
        script.play()

    return played


def console(mission: str) -> Console:
    """Two vehicles and a mission file."""
    made = Console(_NAMES, {"uav1": 1, "uav2": 2})
    made.load(mission)
    made.wall_offset_s = 1.7e9
    return made


def _lines(**wrong: Tuple[Grade, str, str]) -> Tuple[Line, ...]:
    """The table of both vehicles, green but for ``uavN_name=(state, what, remedy)``."""
    names = (
        "link",
        "pre-arm",
        "ekf",
        "estimate",
        "feed",
        "tracker",
        "transmitter",
        "battery",
        "camera",
        "recorder",
        "disk",
        "guardian",
        "agent",
        "radio",
        "clock",
        "tags",
    )
    found = []
    for vehicle in _NAMES:
        for name in names:
            state, what, remedy = wrong.get(f"{vehicle}_{name}", (Grade.GREEN, "well", ""))
            found.append(Line(vehicle, name, state, what, remedy, 75.0))
    return tuple(found)


def _streams(
    c: _Script,
    now_s: float,
    mode: str,
    armed: bool,
    places: Sequence[Tuple[float, float, float]],
    share: float = 0.82,
    quiet: Sequence[str] = (),
) -> None:
    """Three seconds of all streams; those of ``quiet`` stop 2.4 s before. Both vehicles stood on
    the ground."""
    for name in _NAMES:
        c.tell(now_s - 90.0, f.EpochReport(name, 1))
        c.tell(now_s - 90.0, f.AutopilotReport(name, True, False, Mode.STABILIZE))
        c.tell(now_s - 89.9, f.OdometryReport(name, (0.2, 0.0, 0.0)))
    for k in range(30):
        at_s = now_s - 2.9 + 0.1 * k
        for name, place in zip(_NAMES, places):
            if name in quiet and at_s > now_s - 2.4:
                continue
            for third in range(3):
                c.tell(
                    at_s - third / 30.0,
                    f.OdometryReport(name, (place[0] + 0.2, place[1], place[2] + 8.0), 0.03),
                )
                c.tell(
                    at_s - third / 30.0,
                    f.CameraPoseReport(name, place, 0.02 if name == "uav2" else 0.0),
                )
            c.tell(at_s, f.GuardianReport(name))
            c.tell(at_s, f.Agent(name, "mission-812-1" if mode == Mode.GUIDED else ""))
            c.tell(at_s, f.AutopilotReport(name, True, armed, mode))
            if k % 10 == 0:
                c.tell(at_s, f.BatteryReport(name, share - (0.04 if name == "uav2" else 0.0), 15.3))
                c.tell(at_s, f.CameraKnown(name, 640, 480, 601.8, 601.8))
                c.tell(at_s, f.Diagnosed(name))
                c.tell(at_s, f.Recorder(name, mode == Mode.GUIDED, 400 + k, 0, 96.0))
                c.tell(at_s, f.RadioReport(name, 0.006, 0.01))
                c.tell(at_s, f.ClockReport(name, 0.0012, 0.0004))
                taken_s = at_s + (0.012 if name == "uav2" else 0.0)
                c.tell(at_s, f.PreviewReport(name, taken_s, _picture(name)))
                c.tell(
                    at_s,
                    f.TagReport(name, *(((1,), (_TAG,)) if name == "uav2" else ((), ())), taken_s),
                )
                c.tell(at_s, f.PictureCaptured(name, taken_s))
        c.tell(at_s, f.MissionHeartbeat("mission-812-1"))


@lru_cache(None)
def _picture(name: str) -> bytes:
    """Ground, sky, some houses; uav2 sees the tag of the one in front."""
    picture = np.full((480, 640, 3), (225, 190, 150), np.uint8)
    picture[260:] = (90, 120, 105)
    shift = 24 if name == "uav2" else 0
    for k, depth in enumerate((4, 2, 3, 1)):
        left, high = 40 + 150 * k - shift * depth // 2, 40 * depth
        cv2.rectangle(
            picture, (left, 270 - high), (left + 90, 290), (70 + 20 * k, 80, 150 - 25 * k), -1
        )
    if name == "uav2":
        cv2.rectangle(picture, (290, 200), (330, 240), (255, 255, 255), -1)
        cv2.rectangle(picture, (295, 205), (325, 235), (0, 0, 0), -1)
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()


def _mapped(c: _Script) -> None:
    """The live map's reference picture with its depth: nothing in the sky."""
    bgr = cv2.imdecode(np.frombuffer(_picture("uav1"), np.uint8), cv2.IMREAD_COLOR)
    rows = np.arange(480, dtype=np.float32)[:, None] * np.ones((1, 640), np.float32)
    depth = np.where(rows > 250.0, 3000.0 / np.maximum(rows - 240.0, 1.0), np.nan).astype("<f4")
    c.tell(
        NOW_S - 4.0,
        f.MapPicture("reference", 640, 480, np.ascontiguousarray(bgr[:, :, ::-1]).tobytes()),
    )
    c.tell(NOW_S - 4.0, f.MapPicture("depth", 640, 480, depth.tobytes()))


def _rehearsed(c: _Script) -> None:
    words = "8 of 8 recorded in 2:41, never nearer than 1.7 m"
    c.tell(NOW_S - 40.0, f.RehearsalProgress(c.file.text, "passed", words=words))


@_in_order
def on_the_ground(c: _Script) -> None:
    """Sets the scene before take-off: one line red, one amber."""
    places = ((0.0, 0.0, -8.0), (-3.5, 0.0, -8.0))
    _streams(c, NOW_S, Mode.STABILIZE, False, places)
    red = (Grade.RED, "PreArm: Compass not calibrated", "do what the autopilot says")
    amber = (Grade.AMBER, "38 %", "change it; unknown: set BATT_MONITOR")
    c.tell(NOW_S - 0.3, f.FlightCheckReport(_lines(uav2_battery=amber, **{"uav1_pre-arm": red})))
    c.tell(
        NOW_S - 0.1,
        f.MissionReport(
            "WAIT_VEHICLES",
            "waiting for all vehicles",
            "",
            0,
            len(c.file.rows),
            ("flight check: uav1 pre-arm is RED",),
        ),
    )
    c.tell(
        NOW_S - 0.2, f.Diagnosed("uav2", (("uav2/tags: health", 1, "slow or silent: pictures"),))
    )
    c.tell(NOW_S - 1.0, f.VehicleText("uav1", "autopilot", "PreArm: Compass not calibrated", 2))
    c.tell(NOW_S - 5.0, f.RehearsalProgress(c.file.text, "runs", 0.38))


@_in_order
def starting(c: _Script) -> None:
    """Twelve seconds after the start: nothing is wrong, most is not heard yet."""
    soon = dict.fromkeys(
        ("estimate", "feed", "clock", "tags"), (Grade.UNKNOWN, "not heard yet", "")
    )
    soon["ekf"] = (Grade.RED, "no position yet", "wait, or look at what the autopilot says")
    lines = _lines(**{f"{v}_{name}": told for v in _NAMES for name, told in soon.items()})
    for name in _NAMES:
        c.tell(NOW_S - 0.4, f.AutopilotReport(name, True, False, Mode.STABILIZE))
        c.tell(NOW_S - 0.3, f.BatteryReport(name, 0.97, 16.4))
    c.tell(NOW_S - 0.2, f.FlightCheckReport(tuple(replace(li, since_s=12.0) for li in lines)))
    problem = "flight check: uav1 ekf is RED"
    c.tell(
        NOW_S - 0.1,
        f.MissionReport(
            "WAIT_VEHICLES", "waiting for all vehicles", "", 0, len(c.file.rows), (problem,)
        ),
    )


@_in_order
def calibrated(c: _Script) -> None:
    """The column is calibrated; the reference is flown to its view."""
    _streams(c, NOW_S, Mode.LOITER, True, ((0.0, 0.0, -6.0), (-3.5, 0.1, -5.9)))
    c.tell(NOW_S - 0.3, f.FlightCheckReport(_lines()))
    c.tell(NOW_S - 9.0, f.MissionReport("CALIBRATE", "running", "", 0, len(c.file.rows)))
    c.tell(NOW_S - 6.0, f.Calibrated((("uav1", 1), ("uav2", 1)), 0.0))
    c.tell(NOW_S - 6.0, _CALIBRATION)
    detail = "uav2 against uav1: 25 detections (0 rejected), spread 1.2 cm, yaw std 0.13 deg"
    c.tell(NOW_S - 5.9, f.MissionReport("MOVE_HOME", detail, "set_home", 0, len(c.file.rows)))
    c.tell(NOW_S - 0.1, f.MissionReport("MOVE_HOME", detail, "set_home", 0, len(c.file.rows)))
    _rehearsed(c)


@_in_order
def ready(c: _Script) -> None:
    """Home is set; the mission waits to be handed the vehicles."""
    _streams(c, NOW_S, Mode.LOITER, True, ((0.0, 0.0, 0.0), (-3.5, 0.1, 0.1)))
    c.tell(NOW_S - 0.3, f.FlightCheckReport(_lines()))
    c.tell(NOW_S - 60.0, f.Calibrated((("uav1", 1), ("uav2", 1)), 30.0))
    c.tell(NOW_S - 60.0, _CALIBRATION)
    c.tell(NOW_S - 20.0, f.HomeSet("uav1"))
    c.tell(NOW_S - 0.1, f.MissionReport("SET_HOME", "home is set", "execute", 0, len(c.file.rows)))
    _rehearsed(c)


@_in_order
def flying(c: _Script) -> None:
    """The third configuration is recorded."""
    row = c.file.rows[2]
    x, y, z = row.goal_m
    _streams(c, NOW_S, Mode.GUIDED, True, ((0.0, 0.0, 0.0), (x + 0.03, y - 0.02, z + 0.01)), 0.64)
    c.tell(NOW_S - 0.3, f.FlightCheckReport(_lines()))
    c.tell(NOW_S - 200.0, f.Calibrated((("uav1", 1), ("uav2", 1)), 30.0))
    c.tell(NOW_S - 150.0, f.HomeSet("uav1"))
    c.tell(
        NOW_S - 2.0,
        f.MissionReport(
            "CONFIGURATIONS", f"recording {row.title}", "", 2, len(c.file.rows), (), RECORDS
        ),
    )
    c.tell(NOW_S - 4.0, f.MapReport("partial", "2 configurations", 0.71))
    _rehearsed(c)
    _mapped(c)
    c.tell(NOW_S - 0.5, f.EpipolarReport(("uav1", "uav2"), 1.4, 212, 0.4, 1.1))
    c.asked(NOW_S - 30.0, "hand_over", "confirmed: execute")


@_in_order
def wrong(c: _Script) -> None:
    """uav2 is above uav1 and falls silent; uav1's guardian holds; NaN in a pose; stop-all was asked
    for."""
    _streams(c, NOW_S, Mode.GUIDED, True, ((0.0, 0.0, 0.0), (0.3, -0.2, 5.0)), 0.31)
    c.tell(
        NOW_S - 0.3,
        f.FlightCheckReport(
            _lines(uav2_radio=(Grade.RED, "no pose for 2.4 s", "go nearer, turn the antenna"))
        ),
    )
    c.tell(
        NOW_S, f.GuardianReport("uav1", "hold", True, reasons=("the others' places are not known",))
    )
    c.tell(NOW_S, f.OdometryReport("uav1", (math.nan, 0.0, 0.0)))
    c.tell(
        NOW_S - 0.2,
        f.Unusable("uav2", "camera/color/image_raw/compressed", "encoding '13UC5' is no picture"),
    )
    why, problem = (
        "everybody was stopped: confirm 'resume', or abort",
        "everybody was stopped by the operator",
    )
    c.tell(
        NOW_S - 0.1,
        f.MissionReport("CONFIGURATIONS", why, "resume", 5, len(c.file.rows), (problem,)),
    )
    c.tell(
        NOW_S - 0.1,
        f.StopReport("stop", "stop all (the operator at the console); done: uav1; under way: uav2"),
    )


@_in_order
def silent(c: _Script) -> None:
    """uav2 vanished 2.4 s ago; the master does not answer."""
    _streams(c, NOW_S, Mode.GUIDED, True, ((0.0, 0.0, 0.0), (0.0, -4.0, 0.0)), 0.5, ("uav2",))
    c.tell(
        NOW_S - 0.1,
        f.MissionReport("CONFIGURATIONS", "", "", 1, len(c.file.rows), ("uav2 is not heard",)),
    )
    c.tell(NOW_S - 0.1, f.MasterReport("the ROS master does not answer"))


@_in_order
def landed(c: _Script) -> None:
    """The list is flown, the bags are gathered, the map is made."""
    _streams(c, NOW_S, Mode.LAND, False, ((0.0, 0.0, -8.0), (0.4, -3.6, -8.0)), 0.41)
    c.tell(
        NOW_S - 0.1, f.MissionReport("DONE", "all configurations flown", "", 8, len(c.file.rows))
    )
    home = "~/fcsv"
    sources = f"uav1=uav1:fcsv/session uav2=uav2:fcsv/session control={home}/session"
    c.after.places = Places(sources, f"{home}/flight", f"{home}/map")
    c.tell(NOW_S - 60.0, f.PlacesFound(True, False))
    c.tell(NOW_S - 60.0, f.JobProgress("gather", "done", words=f"wrote {home}/flight/session.yaml"))
    c.tell(NOW_S - 5.0, f.JobProgress("map", "runs", 0.62))


@_in_order
def ground_cameras(c: _Script) -> None:
    """Adds cameras, besides ``flying``: what a mocap sees, and a gimbal for each vehicle."""
    c.tell(NOW_S - 0.4, _seen("", (-4.0, 1.0, -0.5), 0.0, 7.0, (47.0, 43.0)))  # thesis table 5.1
    for name, y, place in zip(_NAMES, (0.4, -0.4), ((0.0, 0.0, 0.0), c.file.rows[2].goal_m)):
        c.tell(
            NOW_S - 0.2,
            _seen(
                name, (-2.5, y, -1.2), math.atan2(place[1] - y, place[0] + 2.5), 4.0, (55.0, 43.0)
            ),
        )


def guided_robot(c: _Script) -> None:
    """Adds a robot on the ground, besides ``flying``: a wall with a gap, and its route through it."""
    rows, columns, cell_m = 90, 120, 0.2
    y, x = (cell_m * (k + 0.5) for k in np.indices((rows, columns)))
    percents = np.where(np.hypot(x - 12.0, 1.4 * (y - 9.0)) < 11.5, 0, -1).astype(np.int8)
    percents[(abs(x - 12.0) < 0.4) & (abs(y - 6.0) > 1.5) & (percents == 0)] = 100
    percents[(x > 17.0) & (y > 12.0) & (percents == 0)] = 30
    c.tell(NOW_S - 5.0, f.RobotGround(4.0, -9.0, cell_m, rows, columns, percents.tobytes()))
    c.tell(NOW_S - 4.0, f.RobotRoute(((7.0, 1.0), (14.5, -3.2), (17.5, -3.0), (23.0, 2.0))))
    c.tell(NOW_S - 0.1, f.RobotSeen(9.0, -0.1, -0.5))
    c.tell(NOW_S - 4.0, f.RobotStatus("ground", "a route of 4 corners leads to the goal"))
    c.tell(NOW_S - 4.0, f.RobotStatus("follower", "the robot drives"))


def _seen(
    gimbal_of: str,
    eye_m: Tuple[float, float, float],
    heading_rad: float,
    reach_m: float,
    fov_deg: Tuple[float, float],
) -> f.SeenFrom:
    """A level camera."""
    wide, high = (reach_m * math.tan(math.radians(a / 2.0)) for a in fov_deg)
    x, y, z = eye_m
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return f.SeenFrom(
        gimbal_of,
        eye_m,
        tuple(
            (x + reach_m * c - side * wide * s, y + reach_m * s + side * wide * c, z + up * high)
            for side, up in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ),
    )


SAMPLES: Dict[str, Situation] = {
    "starting": starting,
    "ground": on_the_ground,
    "calibrated": calibrated,
    "ready": ready,
    "flying": flying,
    "wrong": wrong,
    "silent": silent,
    "landed": landed,
}

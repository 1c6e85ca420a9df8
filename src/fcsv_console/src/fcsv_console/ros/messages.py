# SPDX-License-Identifier: Apache-2.0
"""Messages to facts. Each raises FcsvError or ValueError where a message cannot be used; the caller
tells why."""

import math
from typing import Any, Callable, Dict, List, Tuple

import cv2
import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState, CompressedImage, Image
from std_msgs.msg import String

from fcsv_console.model import facts as f
from fcsv_console.model.looking import looks
from fcsv_control.ros.checks import flight_check_messages as check_messages
from fcsv_control.stopping.core import Report
from fcsv_geometry import transforms
from fcsv_geometry.errors import GeometryError
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import (
    Calibration,
    CapturedPicture,
    ClockOffset,
    CommandAck,
    Epoch,
    Epochs,
    FlightCheck,
    GuardianState,
    Heartbeat,
    Home,
    MapState,
    MissionState,
    RecorderStatus,
    StopReport,
    TagDetections,
)
from mavros_msgs.msg import State, StatusText

Convert = Callable[[str, Any], f.Fact]
_PICTURES = (b"\xff\xd8", b"\x89PNG")  # how JPEG and PNG begin


def _state(name: str, m: State) -> f.Fact:
    return f.AutopilotReport(name, m.connected, m.armed, Mode(m.mode), m.system_status)


def _battery(name: str, m: BatteryState) -> f.Fact:
    return f.BatteryReport(name, conversions.battery_share(m), m.voltage)


def _odometry(name: str, m: Odometry) -> f.Fact:
    T_odom_body = conversions.pose_to_transform(m.pose.pose)
    x, y, z = (float(v) for v in T_odom_body[:3, 3])
    return f.OdometryReport(name, (x, y, z), transforms.yaw(T_odom_body))


def _camera(name: str, m: PoseWithCovarianceStamped) -> f.Fact:
    T_home_cam = conversions.pose_to_transform(m.pose.pose)
    x, y, z = (float(v) for v in T_home_cam[:3, 3])
    heading, pitch_rad, roll_rad = looks(T_home_cam[:3, :3])
    return f.CameraPoseReport(name, (x, y, z), heading, pitch_rad, roll_rad)


def _picture(name: str, m: CompressedImage) -> f.Fact:
    if not m.data.startswith(_PICTURES):
        raise GeometryError(
            f"encoding '{m.format}' with {len(m.data)} octets is no JPEG or PNG picture"
        )
    return f.PreviewReport(name, m.header.stamp.to_sec(), bytes(m.data))


def _tags(name: str, m: TagDetections) -> f.Fact:
    corners = [tuple(zip(d.corners_px[::2], d.corners_px[1::2])) for d in m.detections]
    if not all(math.isfinite(x) for four in corners for corner in four for x in corner):
        raise GeometryError("a corner of a tag is not finite")
    return f.TagReport(
        name, tuple(d.id for d in m.detections), tuple(corners), m.header.stamp.to_sec()
    )


def _reference(_name: str, m: Image) -> f.Fact:
    rgb = np.ascontiguousarray(conversions.image_to_array(m, "rgb8"))
    return f.MapPicture("reference", rgb.shape[1], rgb.shape[0], rgb.tobytes())


def _depth(_name: str, m: Image) -> f.Fact:
    if m.encoding != "32FC1":
        raise GeometryError(f"encoding '{m.encoding}' is no depth in metres (32FC1)")
    depth = conversions.image_to_array(m)
    return f.MapPicture("depth", depth.shape[1], depth.shape[0], depth.astype("<f4").tobytes())


def _guardian(name: str, m: GuardianState) -> f.Fact:
    return f.GuardianReport(
        name, m.action, m.holds, m.uncontrolled, m.lost, m.taken, tuple(m.reasons), tuple(m.forbids)
    )


def _diagnosed(name: str, m: DiagnosticArray) -> f.Fact:
    levels = (DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE)
    return f.Diagnosed(
        name, tuple((s.name, s.level, s.message) for s in m.status if s.level in levels)
    )


def _recorder(name: str, m: RecorderStatus) -> f.Fact:
    return f.Recorder(name, m.pictures_on, m.pictures, m.dropped, m.minutes_left, m.problem)


def _autopilot_text(name: str, m: StatusText) -> f.Fact:
    return f.VehicleText(name, "autopilot", m.text, m.severity)


def _guardian_text(name: str, m: StatusText) -> f.Fact:
    return f.VehicleText(name, "guardian", m.text, m.severity)


def _answered(name: str, m: CommandAck) -> f.Fact:
    outcome = "" if m.result == CommandAck.DONE else m.reason or "refused without a reason"
    return f.Answered(name, m.sender, m.number, outcome)


#: topic under the vehicle's name -> type, conversion
OF_VEHICLE: Dict[str, Tuple[Any, Convert]] = {
    "mavros/state": (State, _state),
    "mavros/battery": (BatteryState, _battery),
    "mavros/statustext/recv": (StatusText, _autopilot_text),
    "guardian/state": (GuardianState, _guardian),
    "guardian/said": (StatusText, _guardian_text),
    "agent/alive": (Heartbeat, lambda name, m: f.Agent(name, m.sender, m.problem)),
    "odometry/state": (Odometry, _odometry),
    "odometry/epoch": (Epoch, lambda name, m: f.EpochReport(name, m.epoch)),
    "camera_pose": (PoseWithCovarianceStamped, _camera),
    "camera/color/image_raw/compressed": (CompressedImage, _picture),
    "capture/picture": (
        CapturedPicture,
        lambda name, m: f.PictureCaptured(name, m.header.stamp.to_sec()),
    ),
    "tags/detections": (TagDetections, _tags),
    "recorder/status": (RecorderStatus, _recorder),
    "diagnostics/worst": (DiagnosticArray, _diagnosed),
    "clock/offset": (ClockOffset, lambda name, m: f.ClockReport(name, m.offset_s, m.uncertainty_s)),
    "command_ack": (CommandAck, _answered),
}


def _recorded_picture(name: str, m: Image) -> f.Fact:
    done, data = cv2.imencode(".jpg", conversions.image_to_array(m, "bgr8"))
    if not done:
        raise GeometryError(f"a picture of {m.width} x {m.height} cannot be compressed")
    return f.PreviewReport(name, m.header.stamp.to_sec(), data.tobytes())


#: the same of what only a bag holds
RECORDED: Dict[str, Tuple[Any, Convert]] = {"camera/color/image_raw": (Image, _recorded_picture)}


def _mission(_name: str, m: MissionState) -> f.Fact:
    where = (m.configuration, m.configurations)
    return f.MissionReport(m.phase_name, m.detail, m.waits_for, *where, tuple(m.problems), m.stage)


def _stop(_name: str, m: StopReport) -> f.Fact:
    fields = {
        name: getattr(m, name)
        for name in ("asked", "reason", "done", "by_hand", "under_way", "unheard", "problems")
    }
    return f.StopReport(m.asked, Report(**fields).in_words() if m.asked else "")


def _check(_name: str, m: FlightCheck) -> f.Fact:
    return f.FlightCheckReport(tuple(check_messages.lines_of(m)), check_messages.patience_s(m))


def _calibrated(_name: str, m: Epochs) -> f.Fact:
    return f.Calibrated(tuple(zip(m.vehicles, m.epochs)), _age_s(m))


def _links(_name: str, m: Calibration) -> f.Fact:
    stds = (math.sqrt(max(0.0, li.covariance[15])) for li in m.links)
    return f.CalibrationReport(
        tuple(
            f.CalibratedLink(
                li.child, li.parent, li.used, li.rejected, li.position_spread_m, std_rad
            )
            for li, std_rad in zip(m.links, stds)
        )
    )


#: topic on the control PC -> type, conversion
OF_CONTROL: Dict[str, Tuple[Any, Convert]] = {
    "/mission/state": (MissionState, _mission),
    "/mission/file": (String, lambda _name, m: f.MissionFlown(m.data)),
    "/mission/alive": (Heartbeat, lambda _name, m: f.MissionHeartbeat(m.instance)),
    "/flight_check": (FlightCheck, _check),
    "/stop_all/report": (StopReport, _stop),
    "/map/state": (
        MapState,
        lambda _name, m: f.MapReport(m.state, m.detail, m.coverage, tuple(m.problems)),
    ),
    "/map/reference": (Image, _reference),
    "/map/depth": (Image, _depth),
    "/calibration_epochs": (Epochs, _calibrated),
    "/calibration": (Calibration, _links),
    "/home": (Home, lambda _name, m: f.HomeSet(m.reference, _age_s(m))),
    "/control/recorder/status": (RecorderStatus, lambda _name, m: _recorder("control", m)),
}


def radios(m: DiagnosticArray) -> List[f.RadioReport]:
    """Gives the radios of what the relay tells of its links."""
    found = []
    for status in m.status:
        values = {v.key: v.value for v in status.values}
        if status.name.startswith("link control-"):
            wrong = "" if status.level == DiagnosticStatus.OK else status.message
            number = (_number(values.get(key, "-")) for key in ("round_trip_s", "in_loss"))
            found.append(f.RadioReport(status.name[len("link control-") :], *number, wrong))
    return found


def _number(value: str) -> float:
    return math.nan if value == "-" else float(value)


def _age_s(message: Any) -> float:
    """Gives the age of what this machine stamped by its own clock: a latched one may be old."""
    return max(0.0, rospy.get_time() - message.header.stamp.to_sec())

# SPDX-License-Identifier: Apache-2.0
"""Topics of a vehicle, and of the calibration, as the dataclasses of fcsv_geometry.telemetry."""

from typing import Any, Callable, Dict, Optional, Sequence, Tuple, Type

import numpy as np
import rospy
from geometry_msgs.msg import Pose, PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState

from fcsv_control.agent.messages import Ack, Instruction
from fcsv_control.control_messages import CommandAnswered, MissionPhase
from fcsv_control.guardian.messages import in_words
from fcsv_geometry import home_messages
from fcsv_geometry import telemetry as tm
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.ros.relay_ages import publisher_of
from fcsv_msgs.msg import (
    Calibration,
    Command,
    CommandAck,
    Epoch,
    Epochs,
    GuardianState,
    Home,
    MissionState,
    RecorderStatus,
    RelayAges,
    TagDetections,
)  # fmt: skip
from mavros_msgs.msg import State


def _odometry(name: str, by: str, m: Odometry) -> tm.VehicleOdometry:
    v = m.twist.twist.linear
    T_odom_body = conversions.pose_to_transform(m.pose.pose)
    return tm.VehicleOdometry(name, by, m.header.stamp.to_sec(), T_odom_body, (v.x, v.y, v.z))


def _epoch(name: str, by: str, m: Epoch) -> tm.OdometryEpoch:
    return tm.OdometryEpoch(name, by, m.epoch, m.reason)


def _height(name: str, by: str, m: PoseStamped) -> tm.VehicleHeight:
    return tm.VehicleHeight(name, by, m.pose.position.z)


def _state(name: str, by: str, m: State) -> tm.VehicleState:
    return tm.VehicleState(name, by, m.mode, m.armed, m.connected)


def _guardian(name: str, by: str, m: GuardianState) -> tm.GuardianStatus:
    return tm.GuardianStatus(name, by, in_words(m.action, m.reasons), m.lost, m.lost_s)


def _battery(name: str, by: str, m: BatteryState) -> tm.BatteryCharge:
    return tm.BatteryCharge(name, by, conversions.battery_share(m))


def _recorder(name: str, by: str, m: RecorderStatus) -> tm.RecorderState:
    return tm.RecorderState(name, by, m.problem, m.pictures)


def _tags(name: str, by: str, m: TagDetections) -> tm.SeenTags:
    tags = [
        tm.SeenTag(t.id, t.size_m, np.array(t.corners_normalized).reshape(4, 2), _position(t.tag_in_camera))
        for t in m.detections
    ]
    stamp_s = m.header.stamp.to_sec()
    return tm.SeenTags(name, by, stamp_s, _transform(m.camera_in_odom), m.focal_px, tags)


def _transform(pose: Pose) -> Optional[np.ndarray]:
    """(4, 4), or None where the pose is none."""
    try:
        return conversions.pose_to_transform(pose)
    except FcsvError:
        return None


def _position(pose: Pose) -> Optional[np.ndarray]:
    T = _transform(pose)
    return None if T is None else T[:3, 3]


def _answer(name: str, _by: str, m: CommandAck) -> CommandAnswered:
    return CommandAnswered(name, Ack(m.sender, m.number, m.result, m.reason))


Take = Callable[[str, str, Any], object]
#: Topics below a vehicle's name, by what they are heard as.
_TOPICS: Dict[type, Tuple[str, Type, Take]] = {
    tm.VehicleOdometry: (tm.VehicleOdometry.topic, Odometry, _odometry),
    tm.OdometryEpoch: (tm.OdometryEpoch.topic, Epoch, _epoch),
    tm.VehicleHeight: (tm.VehicleHeight.topic, PoseStamped, _height),
    tm.VehicleState: (tm.VehicleState.topic, State, _state),
    tm.GuardianStatus: (tm.GuardianStatus.topic, GuardianState, _guardian),
    tm.BatteryCharge: (tm.BatteryCharge.topic, BatteryState, _battery),
    tm.RecorderState: (tm.RecorderState.topic, RecorderStatus, _recorder),
    tm.SeenTags: (tm.SeenTags.topic, TagDetections, _tags),
    CommandAnswered: ("command_ack", CommandAck, _answer),
}


def hear(vehicle: str, kinds: Sequence[type], receive: Callable[[object], None], health: Health) -> None:
    """Subscribe to what a vehicle tells; ``receive`` each as data. What holds no pose is dropped, and counted."""
    for kind in kinds:
        topic, message_type, take = _TOPICS[kind]

        def came(message, topic=topic, take=take) -> None:
            try:
                data = take(vehicle, publisher_of(message), message)
            except FcsvError as error:
                health.drop(topic, f"{vehicle}: {error}")
                return
            if isinstance(data, tm.SeenTags) and data.lacks_a_pose:
                health.drop(topic, f"{vehicle}: a pose of the camera or of a tag is none")
            receive(data)

        rospy.Subscriber(f"/{vehicle}/{topic}", message_type, came, queue_size=20, tcp_nodelay=True)


def hear_relay(receive: Callable[[object], None], prefix: str = "") -> None:
    """What the relay under ``prefix`` (a vehicle's namespace; empty on the control PC) measures."""
    take = lambda m: receive(tm.RelayAges(m.topics, m.sent_s))  # noqa: E731
    rospy.Subscriber(f"{prefix}/relay/ages", RelayAges, take, queue_size=5, tcp_nodelay=True)


def hear_epochs(receive: Callable[[object], None]) -> None:
    """For which epochs calibration and home hold."""
    for of in (tm.CALIBRATION, tm.HOME):
        take = lambda m, of=of: receive(tm.EpochsFound(of, m.header.stamp.to_sec(), conversions.epochs_of(m)))  # noqa: E731
        rospy.Subscriber(f"/{of}_epochs", Epochs, take, queue_size=1)


def calibration_of(m: Calibration) -> tm.CalibrationFound:
    """Raises GeometryError where a pose is none."""
    return tm.CalibrationFound(m.header.stamp.to_sec(), home_messages.links_from_message(m))


def home_of(m: Home) -> tm.HomeFound:
    """Raises GeometryError where the pose is none."""
    return tm.HomeFound(m.header.stamp.to_sec(), m.reference, conversions.pose_to_transform(m.home_in_odom))


def command_of(i: Instruction) -> Command:
    """An instruction as it is sent."""
    now_s = rospy.get_time()
    command = Command(
        header=conversions.header(now_s, ""), vehicle=i.vehicle, sender=i.sender, number=i.number, kind=i.kind.value,
        mode=i.mode, flag=i.flag, altitude_m=i.altitude_m, ordered_s=i.ordered_s, sent_s=i.sent_s,
        lifetime_s=i.lifetime_s,
    )  # fmt: skip
    if i.target is not None:
        command.target = conversions.pose_stamped(i.target, now_s, i.frame)
    return command


def phase_of(m: MissionState) -> MissionPhase:
    """In which phase the mission says that it is."""
    return MissionPhase(m.phase_name)

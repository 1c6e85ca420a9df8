# SPDX-License-Identifier: Apache-2.0
"""What the control PC hears of vehicles and tells them, as data."""

from typing import Dict

import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import BatteryState

from fcsv_control.agent.messages import Ack, Instruction
from fcsv_control.control_messages import CommandAnswered
from fcsv_control.guardian.messages import in_words
from fcsv_geometry.ros import conversions, telemetry_messages
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import Command, CommandAck, GuardianState, RecorderStatus
from mavros_msgs.msg import State


def _height(name: str, by: str, m: PoseStamped) -> tm.VehicleHeight:
    return tm.VehicleHeight(name, by, m.pose.position.z)


def _state(name: str, by: str, m: State) -> tm.VehicleState:
    return tm.VehicleState(name, by, Mode(m.mode), m.armed, m.connected)


def _guardian(name: str, by: str, m: GuardianState) -> tm.GuardianStatus:
    return tm.GuardianStatus(name, by, in_words(m.action, m.reasons), m.lost, m.lost_s)


def _battery(name: str, by: str, m: BatteryState) -> tm.BatteryCharge:
    return tm.BatteryCharge(name, by, conversions.battery_share(m))


def _recorder(name: str, by: str, m: RecorderStatus) -> tm.RecorderState:
    return tm.RecorderState(name, by, m.problem, m.pictures)


def _answer(name: str, _by: str, m: CommandAck) -> CommandAnswered:
    return CommandAnswered(name, Ack(m.sender, m.number, m.result, m.reason))


#: Topics below a vehicle's name, by what they are heard as.
TOPICS: Dict[type, telemetry_messages.Topic] = {
    **telemetry_messages.TOPICS,
    tm.VehicleHeight: (tm.VehicleHeight.topic, PoseStamped, _height),
    tm.VehicleState: (tm.VehicleState.topic, State, _state),
    tm.GuardianStatus: (tm.GuardianStatus.topic, GuardianState, _guardian),
    tm.BatteryCharge: (tm.BatteryCharge.topic, BatteryState, _battery),
    tm.RecorderState: (tm.RecorderState.topic, RecorderStatus, _recorder),
    CommandAnswered: ("command_ack", CommandAck, _answer),
}


def command_of(i: Instruction) -> Command:
    """An instruction as it is sent."""
    now_s = rospy.get_time()
    command = Command(
        header=conversions.header(now_s, ""),
        vehicle=i.vehicle,
        sender=i.sender,
        number=i.number,
        kind=i.kind.value,
        mode=i.mode,
        flag=i.flag,
        altitude_m=i.altitude_m,
        ordered_s=i.ordered_s,
        sent_s=i.sent_s,
        lifetime_s=i.lifetime_s,
    )
    if i.target is not None:
        command.target = conversions.pose_stamped(i.target, now_s, i.frame)
    return command

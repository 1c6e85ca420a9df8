# SPDX-License-Identifier: Apache-2.0
"""What processes on board hear of each other and of the mission, as the dataclasses of their
ports."""

from typing import Any, Callable

import numpy as np
import rospy
from geometry_msgs.msg import PointStamped, PoseStamped, Vector3Stamped
from nav_msgs.msg import Odometry

from fcsv_control.agent.messages import Ack, AgentAlive, Instruction, Kind
from fcsv_control.conditions import confidence_level
from fcsv_control.control_messages import MissionAlive
from fcsv_control.errors import ControlError
from fcsv_control.flight.messages import (
    AutopilotLimits,
    EstimateMoved,
    HomeReceived,
    LinkLives,
    ParametersChecked,
    PoseEstimated,
    PoseFed,
)
from fcsv_control.guardian.messages import Cause, Forbidden, GuardianVerdict
from fcsv_control.guardian.port import MissionFence
from fcsv_control.recorder_port import RecorderReport
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros import conversions, fences
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.modes import Mode
from fcsv_msgs.msg import (
    Command,
    CommandAck,
    GuardianState,
    Heartbeat,
    LinkHealth,
    ParameterReport,
    RecorderStatus,
)
from fcsv_msgs.msg import Fence as FenceMessage

_PREARM = {LinkHealth.PREARM_READY: True, LinkHealth.PREARM_NOT_READY: False}


def taking(
    topic: str, take: Callable[[Any], object], receive: Callable[[object], None], health: Health
) -> Callable[[Any], None]:
    """A callback that receives each message as the port's: what holds no pose is dropped and
    counted, what ``take`` gives as None is passed over."""

    def came(message) -> None:
        try:
            data = take(message)
        except FcsvError as error:
            health.drop(topic, str(error))
            return
        if data is not None:
            receive(data)

    return came


def instruction_of(m: Command) -> Instruction:
    """Raises FcsvError on a kind that is not known or a target that is no pose."""
    try:
        kind = Kind(m.kind)
    except ValueError as error:
        raise ControlError(f"command kind {m.kind} is not known") from error
    target = conversions.pose_to_transform(m.target.pose) if kind is Kind.GOTO else None
    return Instruction(
        m.vehicle,
        m.sender,
        m.number,
        kind,
        m.sent_s,
        m.ordered_s,
        m.lifetime_s,
        Mode(m.mode),
        bool(m.flag),
        m.altitude_m,
        target,
        m.target.header.frame_id,
    )


def ack_of(m: CommandAck) -> Ack:
    """The agent's answer to a command."""
    return Ack(m.sender, m.number, m.result, m.reason)


def agent_alive_of(m: Heartbeat) -> AgentAlive:
    """A sign of life of an agent."""
    return AgentAlive(m.instance, m.started_s, m.sent_s, m.sender, m.problem)


def mission_alive_of(m: Heartbeat) -> MissionAlive:
    """A sign of life of the mission."""
    return MissionAlive(m.instance, m.sent_s)


def fed_of(m: PoseStamped) -> PoseFed:
    """Raises FcsvError where it is no pose."""
    return PoseFed(conversions.pose_to_transform(m.pose), m.header.stamp.to_sec())


def estimated_of(m: PoseStamped) -> PoseEstimated:
    """Raises FcsvError where it is no pose."""
    return PoseEstimated(conversions.pose_to_transform(m.pose))


def moved_of(m: Vector3Stamped) -> EstimateMoved:
    """Says by what the autopilot's estimate moved."""
    return EstimateMoved(np.array([m.vector.x, m.vector.y, m.vector.z]))


def home_above_of(m: PointStamped) -> HomeReceived:
    """Where the autopilot's home is."""
    return HomeReceived(m.point.z)


def link_lives_of(m: LinkHealth) -> LinkLives:
    """What the flight link tells of itself."""
    return LinkLives(
        m.doubt,
        m.ekf_variance,
        m.throttle,
        m.throttle_age_s,
        m.system_status,
        m.origin_set,
        m.parameters_ok,
        m.parameter,
        None if m.in_the_air < 0 else bool(m.in_the_air),
        m.connected,
        m.pid,
        m.ekf_flags,
        m.ekf_age_s,
        m.feed_rate_hz,
        m.feed_age_s,
        m.estimate_apart_m,
        _PREARM.get(m.prearm),
    )


def limits_of(m: ParameterReport) -> AutopilotLimits:
    """What limits how the autopilot flies."""
    return AutopilotLimits(dict(zip(m.limits, m.limit_values)))


def parameters_of(m: ParameterReport) -> ParametersChecked:
    """The autopilot's parameters against the profile."""
    return ParametersChecked(
        m.profile, m.firmware, m.complete, m.blocks, m.advises, m.unknown, limits_of(m)
    )


def recorder_report_of(m: RecorderStatus) -> RecorderReport:
    """What a recorder tells of itself."""
    return RecorderReport(
        m.path, m.pictures_on, m.pictures, m.bytes, m.dropped, m.minutes_left, m.problem
    )


def fence_of(m: FenceMessage) -> MissionFence:
    """Raises GeometryError where it is no fence."""
    fence = fences.from_message(m)
    rospy.loginfo("the mission's fence is %s", fence)
    return MissionFence(fence)


def confidence_of(m: Odometry) -> float:
    """Gives the confidence of the tracking camera, 0 to 3; NaN where not known."""
    return confidence_level(m.pose.covariance[0])


def verdict_of(m: GuardianState) -> GuardianVerdict:
    """What a guardian tells."""
    going_to_m = (m.going_to.x, m.going_to.y, m.going_to.z) if m.sent else None
    return GuardianVerdict(
        m.action,
        m.holds,
        m.uncontrolled,
        tuple(m.reasons),
        tuple(Forbidden(text, Cause(cause)) for text, cause in zip(m.forbids, m.causes)),
        m.lost,
        m.taken,
        going_to_m,
        m.lost_s,
    )

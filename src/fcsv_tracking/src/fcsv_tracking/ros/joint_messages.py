# SPDX-License-Identifier: Apache-2.0
"""A gimbal's angles as sensor_msgs/JointState, joints "pan" and "tilt" (rad)."""

from sensor_msgs.msg import JointState

from fcsv_geometry.ros import conversions
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.geometry import Angles

_JOINTS = ["pan", "tilt"]


def to_message(stamp_s: float, frame_id: str, angles: Angles) -> JointState:
    return JointState(header=conversions.header(stamp_s, frame_id), name=_JOINTS, position=list(angles))


def from_message(message: JointState, frame_id: str) -> Angles:
    """Raises SampleRejected where it is of another gimbal, or does not hold both joints."""
    if message.header.frame_id != frame_id:
        raise SampleRejected("wrong frame", f"joints are of frame '{message.header.frame_id}', expected '{frame_id}'")
    values = dict(zip(message.name, message.position))
    if any(joint not in values for joint in _JOINTS):
        raise SampleRejected("not angles", f"joints are {list(message.name)}, expected {_JOINTS} with a position each")
    return Angles(*(float(values[joint]) for joint in _JOINTS))

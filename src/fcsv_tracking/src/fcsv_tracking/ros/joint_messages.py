# SPDX-License-Identifier: Apache-2.0
"""Angles as sensor_msgs/JointState (rad): a gimbal's joints "pan" and "tilt", or those of a rig by
their names."""

from typing import List, Sequence

from sensor_msgs.msg import JointState

from fcsv_geometry.ros import conversions
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.geometry import Angles

_JOINTS = ("pan", "tilt")


def to_message(
    stamp_s: float, frame_id: str, angles: Sequence[float], joints: Sequence[str] = _JOINTS
) -> JointState:
    return JointState(
        header=conversions.header(stamp_s, frame_id), name=list(joints), position=list(angles)
    )


def from_message(message: JointState, frame_id: str) -> Angles:
    """A gimbal's. Raises SampleRejected where it is of another gimbal, or does not hold both
    joints."""
    return Angles(*values_of(message, frame_id, _JOINTS))


def values_of(message: JointState, frame_id: str, joints: Sequence[str]) -> List[float]:
    """Takes the values of the named joints, in order. Raises SampleRejected where the frame is
    another, or one is missing."""
    if message.header.frame_id != frame_id:
        raise SampleRejected(
            "wrong frame", f"joints are of frame '{message.header.frame_id}', expected '{frame_id}'"
        )
    values = dict(zip(message.name, message.position))
    if any(joint not in values for joint in joints):
        expected = f"{list(joints)} with a position each"
        raise SampleRejected("not angles", f"joints are {list(message.name)}, expected {expected}")
    return [float(values[joint]) for joint in joints]

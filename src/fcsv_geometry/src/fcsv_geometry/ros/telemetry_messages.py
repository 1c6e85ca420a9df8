# SPDX-License-Identifier: Apache-2.0
"""Topics as the dataclasses of fcsv_geometry.vehicles.telemetry, and back."""

from typing import Any, Callable, Dict, Mapping, Optional, Sequence, Tuple, Type

import numpy as np
import rospy
from geometry_msgs.msg import Pose
from nav_msgs.msg import Odometry

from fcsv_geometry import frames
from fcsv_geometry.errors import FcsvError, GeometryError
from fcsv_geometry.ros import conversions
from fcsv_geometry.ros.health import Health
from fcsv_geometry.ros.relay_ages import publisher_of
from fcsv_geometry.vehicles import home_messages
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_msgs.msg import Calibration, Epoch, Epochs, Home, MissionState, RelayAges, TagDetections

Take = Callable[[str, str, Any], object]  # of the vehicle's name, the publisher's, and a message
Topic = Tuple[str, Type, Take]


def _odometry(name: str, by: str, m: Odometry) -> tm.VehicleOdometry:
    if m.header.frame_id != frames.odom(name):
        raise GeometryError(f"its frame is '{m.header.frame_id}'")
    v = m.twist.twist.linear
    T_odom_body = conversions.pose_to_transform(m.pose.pose)
    return tm.VehicleOdometry(name, by, m.header.stamp.to_sec(), T_odom_body, (v.x, v.y, v.z))


def _epoch(name: str, by: str, m: Epoch) -> tm.OdometryEpoch:
    return tm.OdometryEpoch(name, by, m.epoch, m.reason)


def _tags(name: str, by: str, m: TagDetections) -> tm.SeenTags:
    if m.vehicle != name:
        raise GeometryError(f"it is of '{m.vehicle}'")
    tags = [
        tm.SeenTag(
            t.id, t.size_m, np.array(t.corners_normalized).reshape(4, 2), _position(t.tag_in_camera)
        )
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


#: Topics below a vehicle's name, by what they are heard as.
TOPICS: Dict[type, Topic] = {
    tm.VehicleOdometry: (tm.VehicleOdometry.topic, Odometry, _odometry),
    tm.OdometryEpoch: (tm.OdometryEpoch.topic, Epoch, _epoch),
    tm.SeenTags: (tm.SeenTags.topic, TagDetections, _tags),
}


def subscribe(
    vehicle: str,
    kinds: Sequence[type],
    receive: Callable[[object], None],
    health: Health,
    topics: Mapping[type, Topic] = TOPICS,
) -> None:
    """Subscribe to what a vehicle tells; ``receive`` each as data. What holds no pose is dropped,
    and counted."""
    for kind in kinds:
        topic, message_type, take = topics[kind]

        def came(message, topic=topic, take=take) -> None:
            try:
                data = take(vehicle, publisher_of(message), message)
            except FcsvError as error:
                health.drop(topic, f"{vehicle}: {error}")
                return
            if isinstance(data, tm.SeenTags) and data.lacks_a_pose:
                health.drop(topic, f"{vehicle}: a pose of the camera or of a tag is none")
            receive(data)

        rospy.Subscriber(f"/{vehicle}/{topic}", message_type, came, queue_size=30, tcp_nodelay=True)


def subscribe_relay(receive: Callable[[object], None], prefix: str = "") -> None:
    """What the relay under ``prefix`` (a vehicle's namespace; empty on the control PC) measures."""
    take = lambda m: receive(tm.RelayAges(m.topics, m.sent_s))  # noqa: E731
    rospy.Subscriber(f"{prefix}/relay/ages", RelayAges, take, queue_size=5, tcp_nodelay=True)


def subscribe_epochs(receive: Callable[[object], None]) -> None:
    """Reads for which epochs calibration and home hold."""
    for of in (tm.CALIBRATION, tm.HOME):
        take = lambda m, of=of: receive(  # noqa: E731
            tm.EpochsFound(of, m.header.stamp.to_sec(), conversions.epochs_of(m))
        )
        rospy.Subscriber(f"/{of}_epochs", Epochs, take, queue_size=1)


def calibration_of(m: Calibration) -> tm.CalibrationFound:
    """Raises GeometryError where a pose is none."""
    return tm.CalibrationFound(m.header.stamp.to_sec(), home_messages.links_from_message(m))


def home_of(m: Home) -> tm.HomeFound:
    """Raises GeometryError where the pose is none."""
    return tm.HomeFound(
        m.header.stamp.to_sec(), m.reference, conversions.pose_to_transform(m.home_in_odom)
    )


def epochs_message(m: tm.EpochsFound) -> Epochs:
    """Makes the message as it is told."""
    message = Epochs(vehicles=list(m.epochs), epochs=list(m.epochs.values()))
    message.header.stamp = rospy.Time.from_sec(m.stamp_s)
    return message


def home_message(m: tm.HomeFound) -> Home:
    """Makes the message as it is told."""
    header = conversions.header(m.stamp_s, frames.odom(m.reference))
    return Home(header, m.reference, conversions.transform_to_pose(m.T_odom_home))


def phase_of(m: MissionState) -> tm.MissionPhase:
    """Says in which phase the mission says that it is."""
    return tm.MissionPhase(m.phase_name)

# SPDX-License-Identifier: Apache-2.0
"""Recorded flights with something wrong with one vehicle's camera, as it happens to people."""

import shutil
from pathlib import Path
from typing import Any, Callable, Dict, Optional

import cv2
import numpy as np
import rosbag
import rospy

from fcsv_geometry import frames, transforms
from fcsv_geometry.messages import transform_from_msg
from fcsv_geometry.ros import conversions

_IMAGE, _INFO, _POSE = "camera/color/image_raw", "camera/color/camera_info", "camera_pose"
#: of a message of the vehicle under its topic's name: what is recorded in its place
Spoil = Callable[[str, str, Any], Any]


def _of_picture(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    def spoil(_vehicle: str, topic: str, message: Any) -> Any:
        if topic == _IMAGE:
            shape = (message.height, message.width, -1)
            pixels = np.frombuffer(message.data, np.uint8).reshape(shape)
            message.data = np.ascontiguousarray(change(pixels)).tobytes()
        return message

    return spoil


def _lens(factor: float) -> Spoil:
    def spoil(_vehicle: str, topic: str, message: Any) -> Any:
        if topic == _INFO:
            K = list(message.K)
            K[0], K[4] = factor * K[0], factor * K[4]
            message.K = K
        return message

    return spoil


def _late(seconds: float) -> Spoil:
    def spoil(_vehicle: str, topic: str, message: Any) -> Any:
        if topic in (_IMAGE, _INFO):
            message.header.stamp += rospy.Duration(seconds)
        return message

    return spoil


def _frozen() -> Spoil:
    first: Dict[str, bytes] = {}

    def spoil(vehicle: str, topic: str, message: Any) -> Any:
        if topic == _IMAGE:
            message.data = first.setdefault(vehicle, message.data)
        return message

    return spoil


def _bent(yaw_deg: float) -> Spoil:
    """The mount was bent after it was measured: the trackers' poses of the camera are off by it."""
    T_cam_said = transforms.from_xyz_rpy([0.0] * 3, [0.0, np.radians(yaw_deg), 0.0])

    def spoil(vehicle: str, topic: str, message: Any) -> Any:
        if topic == _POSE:
            T = conversions.pose_to_transform(message.pose.pose) @ T_cam_said
            message.pose.pose = conversions.transform_to_pose(T)
        for t in message.transforms if topic == "tf_static" else ():
            if t.child_frame_id == frames.camera_optical(vehicle):
                T = transform_from_msg(t.transform) @ T_cam_said
                t.transform = conversions.transform_stamped(T, 0.0, "", "").transform
        return message

    return spoil


#: by what is wrong, in words; each call makes a new one
SPOILS: Dict[str, Callable[[], Spoil]] = {
    "nothing": lambda: lambda _vehicle, _topic, message: message,
    "focal length 3 % off": lambda: _lens(1.03),
    "focal length 15 % off": lambda: _lens(1.15),
    "mount bent by 1 degree": lambda: _bent(1.0),
    "mount bent by 5 degrees": lambda: _bent(5.0),
    "stamps half a second late": lambda: _late(0.5),
    "one picture again and again": _frozen,
    "out of focus": lambda: _of_picture(lambda p: cv2.GaussianBlur(p, (0, 0), 8.0)),
    "lens cap on": lambda: _of_picture(lambda p: (0.02 * p).astype(np.uint8)),
    "mirrored": lambda: _of_picture(lambda p: p[:, ::-1]),
}


def spoilt(session: Path, vehicle: str, what: str, out: Path) -> Path:
    """Writes a session in which something is wrong with the camera of one vehicle; gives its
    folder. Raises KeyError where SPOILS has no such thing."""
    spoil = SPOILS[what]()
    out.mkdir(parents=True)
    for file in sorted(p for p in session.iterdir() if p.is_file()):
        if file.suffix != ".bag":
            shutil.copy(file, out)
            continue
        with rosbag.Bag(str(file)) as bag, rosbag.Bag(str(out / file.name), "w") as copy:
            for topic, message, t in bag.read_messages():
                name = _name(topic, vehicle, file.stem)
                copy.write(topic, spoil(vehicle, name, message) if name else message, t)
    return out


def _name(topic: str, vehicle: str, machine: str) -> Optional[str]:
    """Gives the topic's name under the vehicle; None of what is not its own."""
    if topic == "/tf_static":
        return "tf_static" if machine == vehicle else None
    own = f"/{vehicle}/"
    return topic[len(own) :] if topic.startswith(own) else None

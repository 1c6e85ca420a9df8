# SPDX-License-Identifier: Apache-2.0
"""What the bags of a session hold but for pictures, in one pass, without single wrong messages."""

import operator
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Mapping, Set, Tuple

import numpy as np

from fcsv_geometry import frames
from fcsv_geometry.bags import reading
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import BagError, GeometryError
from fcsv_geometry.messages import camera_from_info, pose_to_transform, seconds, transform_from_msg
from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.errors import InputError
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.pose_covariance import KnownCovariances, turned
from fcsv_stereo.sessions.broadcasts import TYPES, BroadcastRecords
from fcsv_stereo.sessions.cameras import CameraTimeline, timeline
from fcsv_stereo.sessions.depth import DEPTH_INFO
from fcsv_stereo.sessions.fixes import FIXES, fix_of
from fcsv_stereo.sessions.left_out import LeftOut
from fcsv_stereo.sessions.messages import camera_covariance
from fcsv_stereo.sessions.stamped import Stamped
from fcsv_stereo.sessions.tracks import track_of

INFO, ODOMETRY, _CAMERA_POSE = "camera/color/camera_info", "odometry/body", "camera_pose"
TF_STATIC = "/tf_static"
#: topics that are read and their types: of the control PC, then of a vehicle
_TYPES = {**TYPES, TF_STATIC: "tf2_msgs/TFMessage"}
_VEHICLE_TYPES = {
    INFO: "sensor_msgs/CameraInfo",
    ODOMETRY: "nav_msgs/Odometry",
    _CAMERA_POSE: "geometry_msgs/PoseWithCovarianceStamped",
    DEPTH_INFO: "sensor_msgs/CameraInfo",
    FIXES: "sensor_msgs/NavSatFix",
}
_SAME_MOUNT = 1e-6


@dataclass
class Recorded:
    """Holds, by vehicle its cameras, trajectory, T_body_cam and covariances; what the control PC
    broadcast."""

    bags: List[Path]
    broadcasts: BroadcastRecords = field(default_factory=BroadcastRecords)
    captures: List = field(default_factory=list)
    T_body_cam: Dict[str, np.ndarray] = field(default_factory=dict)
    cameras: Dict[str, CameraTimeline] = field(default_factory=dict)
    depth_cameras: Dict[str, CameraTimeline] = field(default_factory=dict)
    tracks: Dict[str, Trajectory] = field(default_factory=dict)
    covariances: Dict[str, KnownCovariances] = field(
        default_factory=lambda: defaultdict(KnownCovariances)
    )
    fixes: Dict[str, List[Tuple[float, Gps]]] = field(default_factory=dict)
    topics: Set[str] = field(default_factory=set)
    left_out: LeftOut = field(default_factory=LeftOut)


def read_recorded(bags: List[Path], warnings: List[str]) -> Recorded:
    """All but pictures. Raises InputError where a topic is of another type than its name says."""
    pass_ = _Pass(Recorded(bags), warnings)
    for bag in bags:
        pass_.read(bag)
    pass_.finish()
    return pass_.recorded


@dataclass
class _Pass:
    """``samples`` are by vehicle and name below it, ``cameras`` of camera_info that was read
    before.

    ``no_covariance`` are topic, stamp and why.
    """

    recorded: Recorded
    warnings: List[str]
    samples: Dict[Tuple[str, str], Stamped] = field(default_factory=dict)
    cameras: Dict[tuple, PinholeCamera] = field(default_factory=dict)
    no_covariance: List[Tuple[str, float, str]] = field(default_factory=list)

    def read(self, path: Path) -> None:
        """Reads, of a bag that cannot be read on, what came before."""
        try:
            for topic, message in reading.messages(
                path, lambda t, kind: self._wanted(path, t, kind), self._broken
            ):
                self._add(path, topic, message)
        except BagError as error:
            self.warnings.append(f"{error}; what follows there is left out")

    def finish(self) -> None:
        """Turns what was read from single messages to trajectories, cameras and covariances."""
        recorded, left_out = self.recorded, self.recorded.left_out
        serving = {samples.topic for samples in self.samples.values()}
        for said in self.no_covariance:
            if said[0] in serving:  # where none serves, unknown_warning says so
                left_out.add(*said)
        for (vehicle, name), samples in self.samples.items():
            if name == ODOMETRY:
                recorded.tracks.update(
                    (vehicle, t) for t in track_of(samples, left_out, self.warnings)
                )
            elif name == _CAMERA_POSE:
                for stamp_s, covariance in samples.in_order(
                    np.array_equal, left_out, self.warnings
                ):
                    recorded.covariances[vehicle].add(stamp_s, covariance)
            elif name == FIXES:
                recorded.fixes[vehicle] = samples.in_order(operator.eq, left_out, self.warnings)
            else:
                cameras = recorded.cameras if name == INFO else recorded.depth_cameras
                cameras.update((vehicle, c) for c in timeline(samples, left_out, self.warnings))

    def _wanted(self, path: Path, topic: str, kind: str) -> bool:
        """Whether a topic is read. Raises InputError where its name holds another type."""
        self.recorded.topics.add(topic)
        vehicle, _, name = topic.strip("/").partition("/")
        expected = _TYPES.get(topic) or (_VEHICLE_TYPES.get(name) if vehicle else None)
        if expected not in (None, kind):
            raise InputError(f"{path}, topic {topic}: is of type {kind}, not {expected}")
        return expected is not None

    def _broken(self, topic: str, recorded_s: float, why: str) -> None:
        self.recorded.left_out.add(
            topic, recorded_s, f"its bytes are no message of its type ({why})"
        )

    def _add(self, path: Path, topic: str, message) -> None:
        vehicle, _, name = topic.strip("/").partition("/")
        try:
            if topic in TYPES:
                self.recorded.broadcasts.add(path, topic, message)
            elif topic == TF_STATIC:
                self._add_extrinsics(message)
            else:
                self._add_sample(path, topic, vehicle, name, message)
        except GeometryError as error:
            self.recorded.left_out.add(topic, _stamp_s(message), f"{path.name}: {error}")
        except AttributeError as error:
            what = f"was recorded with another version of its message ({error})"
            raise InputError(f"{path}, topic {topic}: {what}") from error

    def _add_sample(self, path: Path, topic: str, vehicle: str, name: str, message) -> None:
        stamp_s = seconds(message.header.stamp)
        if name == ODOMETRY:
            value = pose_to_transform(message.pose.pose)
        elif name == _CAMERA_POSE:
            value = self._covariance(message, vehicle)
        elif name == FIXES:
            value = fix_of(message)
        else:
            value = self._camera(message)
        if value is not None:
            self.samples.setdefault((vehicle, name), Stamped(topic)).add(path, stamp_s, value)

    def _camera(self, message) -> PinholeCamera:
        lower = [
            getattr(message, n) if hasattr(message, n) else getattr(message, n.lower())
            for n in "KD"
        ]
        key = (message.width, message.height, message.distortion_model, *(tuple(v) for v in lower))
        if key not in self.cameras:
            self.cameras[key] = camera_from_info(message)
        return self.cameras[key]

    def _covariance(self, message, vehicle: str):
        """About the camera's axes: a pair ahead of a tracker flies in another home."""
        try:
            _, covariance = camera_covariance(message, vehicle)
        except InputError as error:  # the map can do without, and says so
            self.recorded.covariances[vehicle].refused = str(error)
            said = (f"/{vehicle}/{_CAMERA_POSE}", seconds(message.header.stamp), str(error))
            self.no_covariance.append(said)
            return None
        return turned(covariance, pose_to_transform(message.pose.pose)[:3, :3].T)

    def _add_extrinsics(self, message) -> None:
        for t in message.transforms:
            vehicle = t.header.frame_id.split("/")[0]
            if (t.header.frame_id, t.child_frame_id) != (
                frames.base_link(vehicle),
                frames.camera_optical(vehicle),
            ):
                continue
            T_body_cam = transform_from_msg(t.transform)
            before = self.recorded.T_body_cam.setdefault(vehicle, T_body_cam)
            if not np.allclose(before, T_body_cam, rtol=0.0, atol=_SAME_MOUNT):
                named = f"{t.header.frame_id} to {t.child_frame_id}"
                said = f"{TF_STATIC} has several transforms from {named}"
                self.warnings += [
                    w for w in [f"{said}: the last one is used"] if w not in self.warnings
                ]
                self.recorded.T_body_cam[vehicle] = T_body_cam


def _stamp_s(message) -> float:
    """Gives the stamp of a message, or of the first transform in it."""
    return seconds(
        message.header.stamp if hasattr(message, "header") else message.transforms[0].header.stamp
    )


def lacks(vehicle: str, recorded: Recorded) -> str:
    """What of a vehicle no picture can do without and the bags do not hold; empty: nothing."""
    extrinsics = f"{TF_STATIC} ({frames.base_link(vehicle)} to {frames.camera_optical(vehicle)})"
    needed: Tuple[Tuple[str, str, Mapping], ...] = (
        (f"/{vehicle}/{ODOMETRY}", "", recorded.tracks),
        (f"/{vehicle}/{INFO}", "", recorded.cameras),
        (TF_STATIC, extrinsics, recorded.T_body_cam),
    )
    for topic, words, found in needed:
        if vehicle not in found:
            why = recorded.left_out.only_reason(topic)
            missing = f"is missing: is the bag of {vehicle} in the session, and whole?"
            return f"topic {words or topic}{': ' + why if why else ' ' + missing}"
    return ""

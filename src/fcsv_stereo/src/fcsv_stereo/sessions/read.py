# SPDX-License-Identifier: Apache-2.0
"""A session folder, or one bag that holds everything, as input of a map (docs/architecture.md, "Session")."""

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Optional

import numpy as np

from fcsv_geometry import frames, home_messages
from fcsv_geometry.bags import reading
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import BagError, GeometryError, PoseUnavailable
from fcsv_geometry.home import HomeFrames, camera_in_home
from fcsv_geometry.messages import camera_from_info, pose_to_transform, seconds, transform_from_msg
from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import FLOWN, ConfigurationInput, InputKind, MapInput, Picture
from fcsv_stereo.pose_covariance import KnownCovariances, turned, unknown_warning
from fcsv_stereo.sessions.depth import DEPTH_INFO, RecordedDepth
from fcsv_stereo.sessions.files import bags_of
from fcsv_stereo.sessions.messages import camera_covariance, window_of
from fcsv_stereo.sessions.pictures import read_pictures
from fcsv_stereo.sessions.told import CALIBRATION, CAPTURE, HOME, TYPES, Told
from fcsv_stereo.sweeps import on_time, spread

#: what is read but for pictures: topics of the control PC, then those of a vehicle, with their types
_TYPES = {
    **TYPES, "/tf_static": "tf2_msgs/TFMessage",
}  # fmt: skip
_VEHICLE_TYPES = {
    "camera/color/camera_info": "sensor_msgs/CameraInfo", "odometry/body": "nav_msgs/Odometry",
    "camera_pose": "geometry_msgs/PoseWithCovarianceStamped", DEPTH_INFO: "sensor_msgs/CameraInfo",
}  # fmt: skip
#: Silence of poses that is bridged (least and most, s): some lost ones, at the rate at which they come. A tracker on
#: the ground gives 8 to 10 a second; over 0.4 s a straight line is 1 to 2 cm off where the vehicle brakes by 1 m/s2.
_GAP_S, _GAP_POSES = (0.1, 0.4), 4.0


@dataclass
class _Recorded:
    """What the bags of a session hold, but for the pictures."""

    bags: List[Path]
    told: Told = field(default_factory=Told)
    captures: List = field(default_factory=list)
    T_body_cam: Dict[str, np.ndarray] = field(default_factory=dict)
    cameras: Dict[str, PinholeCamera] = field(default_factory=dict)
    depth_cameras: Dict[str, PinholeCamera] = field(default_factory=dict)
    tracks: Dict[str, Trajectory] = field(default_factory=dict)
    covariances: Dict[str, KnownCovariances] = field(default_factory=lambda: defaultdict(KnownCovariances))


def read_session(path: Path) -> MapInput:
    """Pictures of every recording window with their poses in home. Raises InputError naming file, topic and remedy."""
    warnings: List[str] = []
    recorded = _Recorded(bags_of(path, warnings))
    for bag in recorded.bags:
        _read_bag(bag, recorded, warnings)
    for vehicle, track in recorded.tracks.items():
        recorded.tracks[vehicle] = track.bridging(float(np.clip(_GAP_POSES * track.spacing_s, *_GAP_S)))
    _require(path, recorded, warnings)
    T_home_odom = _odoms_in_home(path, recorded)
    configurations, clocks = _pictures(path, recorded, T_home_odom, warnings)
    warnings += unknown_warning(configurations, FLOWN, (k.refused for k in recorded.covariances.values()))
    truth = path / "truth" if path.is_dir() and (path / "truth").is_dir() else None
    near = _near(recorded, T_home_odom)
    return MapInput(InputKind.SESSION, spread(configurations), truth, warnings, FLOWN, clocks, near)


def _near(recorded: _Recorded, T_home_odom) -> Optional[RecordedDepth]:
    """Where the depth frames are; None where no vehicle recorded any."""
    if not recorded.depth_cameras:
        return None
    return RecordedDepth(
        recorded.bags, recorded.depth_cameras, recorded.tracks, T_home_odom, recorded.T_body_cam, recorded.covariances,
        FLOWN,
    )  # fmt: skip


def _read_bag(path: Path, recorded: _Recorded, warnings: List[str]) -> None:
    """Everything but pictures, in one pass; of a bag that cannot be read on, what came before."""
    try:
        for topic, message in reading.messages(path, lambda topic, kind: _wanted(path, topic, kind)):
            _take(path, topic, message, recorded)
    except BagError as error:
        warnings.append(f"{error}; what follows there is left out")


def _wanted(path: Path, topic: str, kind: str) -> bool:
    """Whether a topic is read. Raises InputError where something else was recorded under its name."""
    vehicle, _, name = topic.strip("/").partition("/")
    expected = _TYPES.get(topic) or (_VEHICLE_TYPES.get(name) if vehicle else None)
    if expected not in (None, kind):
        raise InputError(f"{path}, topic {topic}: is of type {kind}, not {expected}")
    return expected is not None


def _take(path: Path, topic: str, message, recorded: _Recorded) -> None:
    vehicle, _, name = topic.strip("/").partition("/")
    try:
        if topic in TYPES:
            recorded.told.take(path, topic, message)
        elif topic == "/tf_static":
            _take_extrinsics(message, recorded)
        elif name == "camera/color/camera_info":
            recorded.cameras.setdefault(vehicle, camera_from_info(message))
        elif name == DEPTH_INFO:
            recorded.depth_cameras.setdefault(vehicle, camera_from_info(message))
        elif name == "odometry/body":
            track = recorded.tracks.setdefault(vehicle, Trajectory())
            track.add(seconds(message.header.stamp), pose_to_transform(message.pose.pose))
        elif name == "camera_pose":
            _take_covariance(message, vehicle, recorded.covariances[vehicle])
    except GeometryError as error:
        raise InputError(f"{path}, topic {topic}: {error}") from error
    except AttributeError as error:
        what = f"was recorded with another version of its message ({error})"
        raise InputError(f"{path}, topic {topic}: {what}") from error


def _take_covariance(message, vehicle: str, known: KnownCovariances) -> None:
    """About the camera's axes: a pair before a tracker flies in another home than its session's."""
    try:
        stamp_s, covariance = camera_covariance(message, vehicle)
        R_home_cam = pose_to_transform(message.pose.pose)[:3, :3]
        known.add(stamp_s, turned(covariance, R_home_cam.T))
    except InputError as error:  # the map can do without, and says so
        known.refused = str(error)


def _take_extrinsics(message, recorded: _Recorded) -> None:
    for t in message.transforms:
        vehicle = t.header.frame_id.split("/")[0]
        if (t.header.frame_id, t.child_frame_id) == (frames.base_link(vehicle), frames.camera_optical(vehicle)):
            recorded.T_body_cam[vehicle] = transform_from_msg(t.transform)


def _require(path: Path, recorded: _Recorded, warnings: List[str]) -> None:
    """Name what is missing, and where it should have come from; a recording without its vehicles is left out."""
    because = "".join(f"; {w}" for w in warnings)
    flown = {*recorded.tracks, *recorded.T_body_cam}
    captures = recorded.told.captures(flown)
    needed = {
        CAPTURE: (captures, "no configuration was recorded"),
        CALIBRATION: (recorded.told.newest(CALIBRATION), "the vehicles were never calibrated"),
        HOME: (recorded.told.newest(HOME), "home was never set"),
    }
    for topic, (value, meaning) in needed.items():
        if not value:
            meaning = f"{meaning}, or control.bag is not in the session and no vehicle heard it by radio"
            raise InputError(f"{path}: topic {topic} is missing: {meaning}{because}")
    warnings += filter(None, [recorded.told.from_vehicles(flown)])
    vehicles = {v for c in captures for v in (c.reference, c.vehicle)}
    lacking = {v: text for v in sorted(vehicles) for text in [_lacks(v, recorded)] if text}
    kept = [c for c in captures if not {c.reference, c.vehicle} & set(lacking)]
    if not kept:
        raise InputError(f"{path}: {next(iter(lacking.values()))}{because}")
    warnings += [f"{text}: configurations with {v} are left out" for v, text in lacking.items()]
    recorded.captures = kept


def _lacks(vehicle: str, recorded: _Recorded) -> str:
    """What of a vehicle no picture can do without and the bags do not hold; empty: nothing."""
    for topic, found in (
        (f"/{vehicle}/odometry/body", recorded.tracks),
        (f"/{vehicle}/camera/color/camera_info", recorded.cameras),
        (f"/tf_static ({frames.base_link(vehicle)} to {frames.camera_optical(vehicle)})", recorded.T_body_cam),
    ):
        if vehicle not in found:
            return f"topic {topic} is missing: is the bag of {vehicle} in the session, and whole?"
    return ""


def _odoms_in_home(path: Path, recorded: _Recorded) -> Dict[str, np.ndarray]:
    in_home = HomeFrames()
    try:
        home_messages.take_calibration(in_home, recorded.told.newest(CALIBRATION))
        home_messages.take_home(in_home, recorded.told.newest(HOME))
        return in_home.T_home_odom
    except GeometryError as error:
        raise InputError(f"{path}: /calibration or /home: {error}") from error


def _pictures(path, recorded: _Recorded, T_home_odom, warnings: List[str]):
    """Configurations, and of those who sweep the time offset between camera and tracker, which then is in the poses."""
    stock = {v: _vehicle_pictures(v, recorded, T_home_odom, warnings) for v in recorded.tracks if v in recorded.cameras}
    T_body_cam = recorded.T_body_cam

    def posed(vehicle: str, stamp_s: float) -> np.ndarray:
        return camera_in_home(T_home_odom[vehicle], recorded.tracks[vehicle].at(stamp_s), T_body_cam[vehicle])

    configurations = _windows(path, recorded, T_home_odom, stock, warnings)
    R_body_cam = {v: T[:3, :3] for v, T in T_body_cam.items()}
    configurations, clocks, words = on_time(configurations, recorded.tracks, R_body_cam, posed)
    warnings += words
    return configurations, clocks


def _windows(path, recorded: _Recorded, T_home_odom, stock, warnings: List[str]) -> List[ConfigurationInput]:
    configurations = []
    for window in map(window_of, recorded.captures):
        inside = {}
        for vehicle in (window.reference, window.vehicle):
            if vehicle not in T_home_odom:
                raise InputError(f"{path}: /calibration does not say where {vehicle} is")
            inside[vehicle] = [p for p in stock[vehicle] if window.holds(p.stamp_s)]
        if not all(inside.values()):
            empty = ", ".join(v for v, pictures in inside.items() if not pictures)
            name = window.configuration.name
            warnings.append(f"configuration '{name}' is left out: no usable picture of {empty} in its window")
            continue
        pictures = inside[window.reference], inside[window.vehicle]
        configurations.append(ConfigurationInput(window.configuration, *pictures))
    if not configurations:
        raise InputError(
            f"{path}: no configuration has pictures of both vehicles in its window: do image_raw, odometry and "
            f"/mission/capture overlap in time, and did the clocks agree? {'; '.join(warnings)}"
        )
    return configurations


def _vehicle_pictures(vehicle: str, recorded: _Recorded, T_home_odom, warnings: List[str]) -> List[Picture]:
    """Undistorted pictures of one vehicle inside any window, with their poses; without a pose they are left out."""
    if vehicle not in T_home_odom:
        return []
    windows = [window_of(c) for c in recorded.captures]
    camera, pictures, lost = recorded.cameras[vehicle], [], 0
    topic = f"/{vehicle}/camera/color/image_raw"
    wanted = lambda t: any(w.holds(t) for w in windows)  # noqa: E731
    for stamp_s, image in read_pictures(recorded.bags, topic, camera, wanted, warnings):
        try:
            T_odom_body = recorded.tracks[vehicle].at(stamp_s)
        except PoseUnavailable:
            lost += 1
            continue
        T_home_cam = camera_in_home(T_home_odom[vehicle], T_odom_body, recorded.T_body_cam[vehicle])
        name = f"{vehicle}/{stamp_s:.3f}"
        covariance = recorded.covariances[vehicle].at(stamp_s)
        if covariance is not None:
            covariance = turned(covariance, T_home_cam[:3, :3])
        pictures.append(Picture.undistorted(name, vehicle, stamp_s, image, camera, T_home_cam, covariance))
    if lost:
        warnings.append(f"{lost} pictures of {vehicle} have no odometry at their stamp and are left out")
    return sorted(pictures, key=lambda p: p.stamp_s)

# SPDX-License-Identifier: Apache-2.0
"""A session folder, or one bag that holds everything, as input of a map
(docs/design/architecture.md, "Session")."""

from pathlib import Path
from typing import List, Optional

import numpy as np

from fcsv_geometry.errors import GeometryError, PoseUnavailable
from fcsv_geometry.home import HomeFrames, camera_in_home
from fcsv_geometry.vehicles import home_messages
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import FLOWN, ConfigurationInput, InputKind, MapInput, Picture
from fcsv_stereo.pose_covariance import turned, unknown_warning
from fcsv_stereo.sessions.broadcasts import CALIBRATION, CAPTURE, HOME, TYPES
from fcsv_stereo.sessions.depth import RecordedDepth
from fcsv_stereo.sessions.files import bags_of
from fcsv_stereo.sessions.fixes import session_gps
from fcsv_stereo.sessions.messages import window_of
from fcsv_stereo.sessions.pictures import PictureSource, PicturesSeen, read_pictures
from fcsv_stereo.sessions.reasons import why_no_pictures
from fcsv_stereo.sessions.recorded import ODOMETRY, Recorded, lacks, read_recorded
from fcsv_stereo.sessions.views import of_view
from fcsv_stereo.sweeps import on_time, spread


def read_session(path: Path, view: str = "") -> MapInput:
    """Pictures of every recording window with their poses in home; of a session with several views
    those of ``view``. Raises InputError naming file, topic and remedy."""
    warnings: List[str] = []
    recorded = read_recorded(bags_of(path, warnings), warnings)
    _require_own(path, recorded)
    _require(path, recorded, warnings)
    recorded.captures = of_view(path, recorded.captures, view)
    in_home = _frames_in_home(path, recorded)
    configurations, clocks = _pictures(path, recorded, in_home, warnings)
    warnings += unknown_warning(
        configurations, FLOWN, (k.refused for k in recorded.covariances.values())
    )
    warnings += recorded.left_out.warnings()
    truth = path / "truth" if path.is_dir() and (path / "truth").is_dir() else None
    near = _near(recorded, in_home)
    gps = session_gps(recorded.fixes, recorded.tracks, in_home)
    return MapInput(
        InputKind.SESSION, spread(configurations), truth, warnings, FLOWN, clocks, near, gps=gps
    )


def _near(recorded: Recorded, in_home: HomeFrames) -> Optional[RecordedDepth]:
    """Where the depth frames are; None where no vehicle recorded any."""
    if not recorded.depth_cameras:
        return None
    return RecordedDepth(
        recorded.bags,
        recorded.depth_cameras,
        recorded.tracks,
        in_home,
        recorded.T_body_cam,
        recorded.covariances,
        FLOWN,
    )


def _require_own(path: Path, recorded: Recorded) -> None:
    """Raises InputError that names the import where nothing in the bags is of a session, but
    pictures are there."""
    flown = any(t.endswith(f"/{ODOMETRY}") for t in recorded.topics)
    if flown or recorded.topics & set(TYPES):
        return
    from fcsv_stereo.bag_import import contents  # which reads bags by this package

    words = contents.foreign(contents.topics_of(recorded.bags), path)
    if words:
        raise InputError(words)


def _require(path: Path, recorded: Recorded, warnings: List[str]) -> None:
    """Name what is missing, and where it should have come from; a recording without its vehicles is
    left out."""
    because = "".join(f"; {w}" for w in (*warnings, *recorded.left_out.warnings()))
    flown = {*recorded.tracks, *recorded.T_body_cam}
    captures = recorded.broadcasts.captures(flown)
    needed = {
        CAPTURE: (captures, "no configuration was recorded"),
        CALIBRATION: (
            recorded.broadcasts.newest(CALIBRATION),
            "the vehicles were never calibrated",
        ),
        HOME: (recorded.broadcasts.newest(HOME), "home was never set"),
    }
    for topic, (value, meaning) in needed.items():
        if topic != CAPTURE and recorded.broadcasts.newest_is_refused(topic):
            raise InputError(
                f"{path}: topic {topic}: the newest message is none; an earlier one is of other frames{because}"
            )
        if not value:
            meaning = (
                f"{meaning}, or control.bag is not in the session and no vehicle heard it by radio"
            )
            raise InputError(f"{path}: topic {topic} is missing: {meaning}{because}")
    warnings += filter(None, [recorded.broadcasts.from_vehicles(flown)])
    vehicles = {v for c in captures for v in (c.reference, c.vehicle)}
    lacking = {v: text for v in sorted(vehicles) for text in [lacks(v, recorded)] if text}
    kept = [c for c in captures if not {c.reference, c.vehicle} & set(lacking)]
    if not kept:
        text = next(iter(lacking.values()))
        others = [
            w
            for w in (*warnings, *recorded.left_out.warnings())
            if w.split(":")[0] != text.split(":")[0]
        ]
        raise InputError("; ".join([f"{path}: {text}", *others]))
    warnings += [f"{text}: configurations with {v} are left out" for v, text in lacking.items()]
    recorded.captures = kept


def _frames_in_home(path: Path, recorded: Recorded) -> HomeFrames:
    """Frames that held at each moment: a picture keeps the calibration by which it was flown."""
    in_home = HomeFrames()
    first, *in_flight = recorded.broadcasts.calibrations()
    try:
        home_messages.apply_calibration(in_home, first)
        home_messages.apply_home(in_home, recorded.broadcasts.newest(HOME))
        for message in in_flight:
            home_messages.apply_calibration(in_home, message)
        return in_home
    except GeometryError as error:
        raise InputError(f"{path}: /calibration or /home: {error}") from error


def _pictures(path, recorded: Recorded, in_home: HomeFrames, warnings: List[str]):
    """Configurations, and of those who sweep the time offset between camera and tracker, which then
    is in the poses."""
    T_body_cam = recorded.T_body_cam
    taking = (
        v
        for v in recorded.tracks
        if v in recorded.cameras and v in in_home.places and v in T_body_cam
    )
    stock = {v: _Stock(v, recorded, in_home, warnings) for v in taking}

    def posed(vehicle: str, stamp_s: float) -> np.ndarray:
        return camera_in_home(
            in_home.at(stamp_s)[vehicle], recorded.tracks[vehicle].at(stamp_s), T_body_cam[vehicle]
        )

    configurations = _windows(path, recorded, in_home, stock, warnings)
    R_body_cam = {v: T[:3, :3] for v, T in T_body_cam.items()}
    configurations, clocks, words = on_time(configurations, recorded.tracks, R_body_cam, posed)
    warnings += words
    return configurations, clocks


def _windows(
    path, recorded: Recorded, in_home: HomeFrames, stock, warnings: List[str]
) -> List[ConfigurationInput]:
    configurations, left = [], []
    for window in map(window_of, recorded.captures):
        inside = {}
        for vehicle in (window.reference, window.vehicle):
            if vehicle not in in_home.places:
                raise InputError(f"{path}: /calibration does not say where {vehicle} is")
            inside[vehicle] = [p for p in stock[vehicle].pictures if window.holds(p.stamp_s)]
        if not all(inside.values()):
            empty = ", ".join(v for v, pictures in inside.items() if not pictures)
            name = window.configuration.name
            left.append(
                f"configuration '{name}' is left out: no usable picture of {empty} in its window"
            )
            continue
        pictures = inside[window.reference], inside[window.vehicle]
        configurations.append(ConfigurationInput(window.configuration, *pictures))
    if left:
        left += filter(None, [stock[v].reason for v in sorted(stock)])
    if not configurations:
        because = "; ".join([*left, *warnings, *recorded.left_out.warnings()])
        raise InputError(
            f"{path}: no configuration has pictures of both vehicles in its window: {because}"
        )
    warnings += left
    return configurations


class _Stock:
    """Undistorted pictures of one vehicle inside any window, with their poses; without a pose they
    are left out.

    ``reason``: why there is none; empty where there is one.
    """

    def __init__(self, vehicle: str, recorded: Recorded, in_home: HomeFrames, warnings: List[str]):
        windows = [window_of(c) for c in recorded.captures]
        topic, track = f"/{vehicle}/camera/color/image_raw", recorded.tracks[vehicle]
        wanted = lambda t: any(w.holds(t) for w in windows)  # noqa: E731
        source = PictureSource(
            recorded.bags, topic, recorded.cameras[vehicle], wanted, track.span_s
        )
        self.pictures: List[Picture] = []
        seen = PicturesSeen()
        for stamp_s, image, camera in read_pictures(source, recorded.left_out, warnings, seen):
            try:
                T_odom_body = track.at(stamp_s)
            except PoseUnavailable:
                seen.unposed += 1
                continue
            T_home_cam = camera_in_home(
                in_home.at(stamp_s)[vehicle], T_odom_body, recorded.T_body_cam[vehicle]
            )
            name = f"{vehicle}/{stamp_s:.3f}"
            covariance = recorded.covariances[vehicle].at(stamp_s)
            if covariance is not None:
                covariance = turned(covariance, T_home_cam[:3, :3])
            picture = Picture.undistorted(
                name, vehicle, stamp_s, image, camera, T_home_cam, covariance
            )
            self.pictures.append(picture)
        if seen.unposed:
            warnings.append(
                f"{seen.unposed} pictures of {vehicle} have no odometry at their stamp and are left out"
            )
        self.reason = (
            ""
            if self.pictures
            else why_no_pictures(
                vehicle, topic, seen, windows, track.span_s, recorded.topics, recorded.left_out
            )
        )

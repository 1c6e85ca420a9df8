# SPDX-License-Identifier: Apache-2.0
"""``images.txt`` of COLMAP's text model, with the poses that ``rigs.txt`` and ``frames.txt`` give
(COLMAP 3.12 on)."""

import logging
import unicodedata
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Collection, Dict, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import GeometryError
from fcsv_stereo.errors import InputError
from fcsv_stereo.posed.text import text_of

# words of a pose (QW QX QY QZ TX TY TZ), of a datum (SENSOR_TYPE SENSOR_ID DATA_ID)
_POSE, _DATA = 7, 3
_STALE_RAD, _STALE_SHARE = 1e-3, 1e-3  # of the cameras' distances: more is no rounding
# of the distance between cameras may their places be unknown by rounded quaternions
_MOST_ROUNDED_SHARE = 0.02


@dataclass(frozen=True)
class PosedImage:
    """A line of images.txt; T_home_cam with home the model's world. ``frame``: the line of
    frames.txt that it is of, where there is one: pictures of one frame were taken at once by the
    cameras of one rig."""

    name: str
    camera_id: int
    T_home_cam: np.ndarray
    frame: str = ""


@dataclass(frozen=True)
class _Line:
    """A pose line; ``rounding`` by how much its quaternion is off, as far as its digits and its
    length tell."""

    number: int
    image_id: str
    name: str
    camera_id: int
    T_cam_home: np.ndarray
    rounding: float
    frame: str = ""


def read_images(
    path: Path, cameras: Collection[int], warnings: Optional[List[str]] = None
) -> List[PosedImage]:
    """Posed pictures in the order of images.txt, whose second lines (points) may be there, empty or
    missing.

    ``cameras``: known numbers. Poses are those of rigs.txt and frames.txt where these stand beside
    it, as COLMAP reads them; where images.txt says others, ``warnings`` (without it, the log)
    tells. Raises InputError naming the line.
    """
    lines = [_pose_line(path, number, line, cameras) for number, line in _pose_lines(path)]
    if not lines:
        raise InputError(f"{path}: holds no picture")
    _require_once(path, lines)
    lines, said = _with_frames(path, lines)
    if said and warnings is not None:
        warnings.append(said)
    elif said:
        logging.getLogger(__name__).warning("%s", said)
    _require_digits(path, lines)
    return [
        PosedImage(i.name, i.camera_id, transforms.invert(i.T_cam_home), i.frame) for i in lines
    ]


def data_lines(path: Path) -> Iterator[Tuple[int, str]]:
    """Number and text of lines that are no comments; empty ones are kept. Raises InputError."""
    for number, line in enumerate(text_of(path).split("\n"), 1):
        if not line.lstrip().startswith("#"):
            yield number, line.rstrip("\r")


def same_name(name: str) -> str:
    """What is one name to people and to file systems: macOS decomposes letters, Windows writes
    backslashes.

    >>> same_name("cam1\\\\Gro\\u0308\\u00dfe.png") == same_name("./cam1/Gr\\u00f6\\u00dfe.png")
    True
    """
    name = unicodedata.normalize("NFC", name.strip().replace("\\", "/"))
    return name[2:] if name.startswith("./") else name


def _pose_lines(path: Path) -> List[Tuple[int, str]]:
    """The first line of every picture, told by what it holds: a line of points is numbers only, in
    threes.

    Such a line after an empty one is of points where every line end is doubled, else a pose that is
    cut.
    """
    if not path.is_file():
        binary = path.with_suffix(".bin").is_file()
        how = "colmap model_converter --output_type TXT" if binary else "export them as COLMAP text"
        raise InputError(f"{path} is missing: photographs without poses cannot be mapped; {how}")
    poses: List[Tuple[int, str]] = []
    after_gap, gap = [], True
    for number, line in data_lines(path):
        words = line.split()
        if not words:
            gap = True
        elif not (poses and len(words) % 3 == 0 and _are_numbers(words)):
            poses.append((number, line))
            gap = False
        elif gap:
            after_gap.append((number, line))
    return poses if 2 * len(after_gap) >= len(poses) else sorted(poses + after_gap)


def _are_numbers(words: Sequence[str]) -> bool:
    try:
        for word in words:
            float(word)
    except ValueError:
        return False
    return True


def _pose_line(path: Path, number: int, line: str, cameras: Collection[int]) -> _Line:
    where, words = f"{path}, line {number}", line.split(None, _POSE + 2)
    try:
        T_cam_home, rounding = _pose(words[1:])
        camera_id, name = int(words[_POSE + 1]), words[_POSE + 2].strip()
    except (ValueError, IndexError) as error:
        raise InputError(
            f"{where}: not a posed picture (IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME; {error})"
        ) from error
    except GeometryError as error:
        raise InputError(f"{where}: pose of {words[-1].strip()}: {error}") from error
    if camera_id not in cameras:
        raise InputError(f"{where}: camera {camera_id} of {name} is not in cameras.txt")
    return _Line(number, words[0], name, camera_id, T_cam_home, rounding)


def _pose(words: Sequence[str]) -> Tuple[np.ndarray, float]:
    """T_a_b of QW QX QY QZ TX TY TZ, and how much rounding its quaternion shows. Raises ValueError,
    IndexError, GeometryError."""
    qw, qx, qy, qz, *t = (float(w) for w in [words[i] for i in range(_POSE)])
    digits = max(len(w.lower().partition("e")[0].partition(".")[2]) for w in words[:4])
    off = abs(float(np.linalg.norm([qw, qx, qy, qz])) - 1.0)
    return transforms.from_xyz_quaternion(t, [qx, qy, qz, qw]), min(
        10.0**-digits, off
    ) if digits else 0.0


def _require_once(path: Path, lines: Sequence[_Line]) -> None:
    found: Dict[str, _Line] = {}
    for line in lines:
        before = found.setdefault(same_name(line.name), line)
        if before is not line:
            raise InputError(
                f"{path}, line {line.number}: {line.name} stands there already, in line {before.number}; take one out"
            )


def _require_digits(path: Path, lines: Sequence[_Line]) -> None:
    """Far from the origin a rounded quaternion moves the camera. Raises InputError where nothing is
    left of a baseline."""
    far_m = max(float(np.linalg.norm(i.T_cam_home[:3, 3])) for i in lines)
    places = np.array([transforms.invert(i.T_cam_home)[:3, 3] for i in lines])
    apart = np.linalg.norm(places[1:] - places[0], axis=1)
    unknown = 2.0 * far_m * max(i.rounding for i in lines)
    if len(apart) and unknown > _MOST_ROUNDED_SHARE * apart.max():
        raise InputError(
            f"{path}: its quaternions have so few digits that cameras {far_m:.6g} from the origin are known to "
            f"{unknown:.2g} only, and they stand {apart.max():.3g} apart: export it with more digits, or shifted"
        )


def _with_frames(path: Path, lines: List[_Line]) -> Tuple[List[_Line], str]:
    """Reads the images' lines with the poses of frames.txt and rigs.txt where there are any; what
    is to be said of it."""
    frames, rigs = path.with_name("frames.txt"), path.with_name("rigs.txt")
    if not frames.is_file() or not any(line.strip() for _, line in data_lines(frames)):
        return lines, ""
    if not rigs.is_file():
        raise InputError(
            f"{rigs} is missing: frames.txt is of its rigs; copy it, too, or take frames.txt away"
        )
    poses = _frame_poses(frames, _rigs(rigs))
    lacking = next((i for i in lines if i.image_id not in poses), None)
    if lacking is not None:
        raise InputError(
            f"{path}, line {lacking.number}: image {lacking.image_id} ({lacking.name}) is in no frame of frames.txt; "
            "one of the two files is old: export the model again"
        )
    composed = []
    for i in lines:
        camera_id, T_cam_home, rounding, where = poses[i.image_id]
        if camera_id != i.camera_id:
            raise InputError(
                f"{where}: image {i.image_id} ({i.name}) is of camera {camera_id}, in images.txt of "
                f"{i.camera_id}; one of the two files is old: export the model again"
            )
        composed.append(replace(i, T_cam_home=T_cam_home, rounding=rounding, frame=where))
    return composed, _contradiction(path, lines, composed)


def _contradiction(path: Path, lines: Sequence[_Line], composed: Sequence[_Line]) -> str:
    was, now = ([transforms.invert(i.T_cam_home) for i in some] for some in (lines, composed))
    places = np.array([T[:3, 3] for T in now])
    spread = float(np.linalg.norm(places - places[0], axis=1).max()) or 1.0
    rounded = 2.0 * max(i.rounding * float(np.linalg.norm(i.T_cam_home[:3, 3])) for i in lines)
    turned = [transforms.rotation_angle(a, b) for a, b in zip(was, now)]
    moved = [float(np.linalg.norm(a[:3, 3] - b[:3, 3])) for a, b in zip(was, now)]
    other = [
        n
        for n in range(len(now))
        if turned[n] > _STALE_RAD or moved[n] > _STALE_SHARE * spread + rounded
    ]
    if not other:
        return ""
    worst = max(other, key=lambda n: (turned[n], moved[n]))
    by = f"{np.degrees(turned[worst]):.1f} degrees, {moved[worst] / spread:.1%} of the cameras' distance"
    return (
        f"{path.name} contradicts rigs.txt and frames.txt about {len(other)} of {len(now)} pictures "
        f"({lines[worst].name}: {by}): their poses are those of rigs.txt and frames.txt, as COLMAP reads them"
    )


_Sensor = Tuple[str, str]


def _rigs(path: Path) -> Dict[str, Dict[_Sensor, Optional[Tuple[np.ndarray, float]]]]:
    """Reads, by rig and sensor, T_sensor_rig and its rounding; None where the rig has no pose of
    it.

    A line is RIG_ID NUM_SENSORS, type and number of the reference, and of every other sensor type,
    number, whether it has a pose, and that.
    """
    rigs: Dict[str, Dict[_Sensor, Optional[Tuple[np.ndarray, float]]]] = {}
    for number, line in data_lines(path):
        words = line.split()
        if not words:
            continue
        try:
            rig_id, count, rest = words[0], int(words[1]), words[2:]
            sensors: Dict[_Sensor, Optional[Tuple[np.ndarray, float]]] = {}
            if count:
                sensors[rest[0], rest[1]], rest = (np.eye(4), 0.0), rest[2:]
            while rest:
                has_pose = bool(int(rest[2]))
                sensors[rest[0], rest[1]] = _pose(rest[3:]) if has_pose else None
                rest = rest[3 + _POSE * has_pose :]
            if len(sensors) != count:
                raise ValueError(f"{len(sensors)} sensors, not {count}")
        except (ValueError, IndexError, GeometryError) as error:
            raise InputError(f"{path}, line {number}: not a rig ({error})") from error
        if rig_id in rigs:
            raise InputError(
                f"{path}, line {number}: rig {rig_id} stands there already; take one out"
            )
        rigs[rig_id] = sensors
    return rigs


def _frame_poses(path: Path, rigs) -> Dict[str, Tuple[int, np.ndarray, float, str]]:
    """Reads, by image: its camera, T_cam_home = T_cam_rig @ T_rig_home, rounding, and the line that
    it is from."""
    poses: Dict[str, Tuple[int, np.ndarray, float, str]] = {}
    for number, line in data_lines(path):
        where, words = f"{path}, line {number}", line.split()
        if not words:
            continue
        try:
            rig_id, (T_rig_home, rounding), count = (
                words[1],
                _pose(words[2:]),
                int(words[2 + _POSE]),
            )
            data = words[3 + _POSE :]
            if len(data) != _DATA * count:
                raise ValueError(f"{len(data)} words of data, not {_DATA * count}")
        except (ValueError, IndexError, GeometryError) as error:
            raise InputError(f"{where}: not a frame ({error})") from error
        for kind, sensor_id, image_id in zip(data[::3], data[1::3], data[2::3]):
            if kind != "CAMERA":
                continue
            known = rigs.get(rig_id, {}).get((kind, sensor_id))
            if known is None:
                raise InputError(
                    f"{where}: camera {sensor_id} has no pose in rig {rig_id} of rigs.txt"
                )
            if image_id in poses:
                raise InputError(f"{where}: image {image_id} is in a frame already; take one out")
            T_cam_rig, off = known
            poses[image_id] = int(sensor_id), T_cam_rig @ T_rig_home, max(rounding, off), where
    return poses

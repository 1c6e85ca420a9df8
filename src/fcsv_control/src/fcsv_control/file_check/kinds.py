# SPDX-License-Identifier: Apache-2.0
"""Every kind of configuration file: its folder, the class whose fields are its keys, and the
function that reads it.

Classes and functions are named as "module:name" and imported where a file of the kind is met: some
stand in packages above this one, and a check of one file loads nothing that only another needs.
"""

import importlib
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

from fcsv_geometry import config
from fcsv_geometry.camera_file import KEYS as CAMERA_KEYS
from fcsv_geometry.vehicles.vehicle import load_vehicles

PARAMETER_SUFFIXES = (".param", ".params", ".parm")
_MISTYPED = 0.8  # alike: the kind of a file is not to be guessed
_RULE = "#:"  # begins a rule of an autopilot's profile (flight/profile.py)


@dataclass(frozen=True)
class FileKind:
    """``folder``: below config/; ``schema``: the class of the whole file; ``reader``: called with
    the path, by default ``config.load`` of the schema; ``keys``: at the top of a file without a
    schema; ``foreign``: the program of others that reads the file, which then is checked as YAML
    only."""

    name: str
    folder: str
    schema: str = ""
    reader: str = ""
    keys: Tuple[str, ...] = ()
    foreign: str = ""

    def read(self, path: Path) -> Any:
        """What the file says. Raises FcsvError naming file and field."""
        if self.foreign:
            return config.read_yaml(path)
        return (
            imported(self.reader)(path) if self.reader else config.load(path, imported(self.schema))
        )

    def known_keys(self) -> Tuple[str, ...]:
        """Gives the keys at the top of a file."""
        return self.keys or tuple(f.name for f in fields(imported(self.schema)) if f.init)

    def required_keys(self) -> Tuple[str, ...]:
        """Those of them without which a file is not of this kind."""
        if self.keys:
            return self.keys if self.name == CAMERA else ()
        given = (f for f in fields(imported(self.schema)) if f.init)
        return tuple(f.name for f in given if f.default is MISSING and f.default_factory is MISSING)


CAMERA, MISSION, PROFILE, PARAMETERS = (
    "camera",
    "mission",
    "autopilot profile",
    "autopilot parameters",
)
_HERE = "fcsv_control.file_check.kinds"
_LINK_KEYS = ("classes", "to_control", "to_vehicle", "to_all_vehicles", "between_vehicles")

YAML_KINDS: Tuple[FileKind, ...] = (
    FileKind(
        MISSION,
        "missions",
        "fcsv_geometry.missions.mission:Mission",
        "fcsv_geometry.missions.mission:load_mission",
    ),
    FileKind(
        "vehicle",
        "vehicles",
        "fcsv_geometry.vehicles.vehicle:VehicleGeometry",
        f"{_HERE}:load_vehicle",
    ),
    FileKind("robot", "robots", "fcsv_guidance.robot:Robot"),
    FileKind("tracker", "trackers", "fcsv_geometry.vehicles.tracker:TrackerProfile"),
    FileKind("links", "links", reader="fcsv_multimaster.links:load_links", keys=_LINK_KEYS),
    FileKind("guardian", "guardian", "fcsv_control.guardian.rules:GuardianRules"),
    FileKind("flight check", "tello", "fcsv_control.flight_check.rules:VehicleCheckRules"),
    FileKind("Tello controller", "tello", "fcsv_control.tello.pid:PidConfig"),
    FileKind("gimbals", "gimbal", "fcsv_tracking.gimbal.config:GroundRobot"),
    FileKind("tilting rig", "tilting", "fcsv_tracking.tilting.rig:TiltingRig"),
    FileKind("points of interest", "poi", "fcsv_stereo.evaluating.poi:PointsOfInterest"),
    FileKind(CAMERA, "cameras", reader="fcsv_geometry.camera_file:read_camera", keys=CAMERA_KEYS),
    FileKind(
        "MAVROS plugins", "mavros", keys=("plugin_blacklist", "plugin_whitelist"), foreign="MAVROS"
    ),
    FileKind(
        "MAVROS",
        "mavros",
        foreign="MAVROS",
        keys=(
            "startup_px4_usb_quirk",
            "conn",
            "time",
            "sys",
            "cmd",
            "local_position",
            "global_position",
            "setpoint_position",
        ),
    ),
    FileKind("mocap_optitrack", "config", keys=("rigid_bodies",), foreign="mocap_optitrack"),
)
PARAMETER_KINDS: Tuple[FileKind, ...] = (
    FileKind(PROFILE, "autopilot", reader="fcsv_control.flight.settings.profile:load_profile"),
    FileKind(PARAMETERS, "autopilot", reader="fcsv_control.flight.settings.parameter_files:read"),
)
KINDS: Dict[str, FileKind] = {kind.name: kind for kind in (*YAML_KINDS, *PARAMETER_KINDS)}


def imported(name: str) -> Any:
    """What "module:name" names."""
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


def load_vehicle(path: Path) -> Any:
    """A vehicle's geometry as nodes read it: the file's name is the vehicle's."""
    path = Path(path)
    if path.suffix != ".yaml":
        raise config.ConfigError(
            f"{path}: nodes look for NAME.yaml; rename the file to {path.stem}.yaml"
        )
    return load_vehicles(path.parent, [path.stem])[path.stem]


def recognised(path: Path) -> FileKind:
    """The kind of a file, by its content; by its folder where several kinds have such keys.

    Raises ConfigError where it cannot be read, or is of no kind that is known.
    """
    if path.suffix in PARAMETER_SUFFIXES:
        return KINDS[PROFILE if _has_rules(path) else PARAMETERS]
    document = config.read_yaml(path)
    if not isinstance(document, dict) or not document:
        what = "nothing" if not document else type(document).__name__
        raise config.ConfigError(f"{path}: holds {what}, not keys with values; {_KNOWN}")
    return of_keys([str(key) for key in document], path)


def of_keys(keys: List[str], path: Path) -> FileKind:
    """The kind with the most of these top-level keys, mistyped ones counted half. Raises
    ConfigError.

    Of several, the one whose required keys are all there, then the one of the file's folder.
    """
    points = {kind: _points(keys, kind) for kind in YAML_KINDS}
    most = max(points.values())
    if most > 0:
        best = [kind for kind, found in points.items() if found == most]
        for better in (_in_folder(path), lambda kind: set(kind.required_keys()) <= set(keys)):
            best = [kind for kind in best if better(kind)] or best
        if len(best) == 1:
            return best[0]
        names = " or ".join(kind.name for kind in best)
        raise config.ConfigError(f"{path}: may be {names} by its keys; say which with --kind")
    shown = ", ".join(keys[:4]) + (", ..." if len(keys) > 4 else "")
    raise config.ConfigError(
        f"{path}: no kind of configuration file has the keys {shown}; {_KNOWN}"
    )


_KNOWN = f"known kinds: {', '.join(KINDS)} (docs/reference/files.md); force one with --kind"


def _points(keys: List[str], kind: FileKind) -> float:
    known = kind.known_keys()
    return sum(
        1.0 if key in known else 0.5 if config.nearest(key, known, _MISTYPED) else 0.0
        for key in keys
    )


def _in_folder(path: Path) -> Callable[[FileKind], bool]:
    folder = path.resolve().parent.name
    return lambda kind: kind.folder == folder


def _has_rules(path: Path) -> bool:
    """Whether a parameter file is a profile. Raises ConfigError where it cannot be read."""
    try:
        return any(
            line.lstrip().startswith(_RULE)
            for line in path.read_text(encoding="utf-8-sig").splitlines()
        )
    except (OSError, UnicodeDecodeError) as error:
        raise config.ConfigError(
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})"
        ) from error

# SPDX-License-Identifier: Apache-2.0
"""Parameter files of ground stations: Mission Planner's NAME,VALUE, MAVProxy's NAME VALUE,
QGroundControl's table."""

import math
import re
from pathlib import Path
from typing import Dict, Mapping, Tuple

from fcsv_control.errors import ProfileError

REAL32 = 9  # MAV_PARAM_TYPE
_NAME = re.compile(r"[A-Z0-9][A-Z0-9_]{0,15}\Z")

Typed = Mapping[str, Tuple[float, int]]  # value and MAV_PARAM_TYPE by name


def read(path) -> Dict[str, float]:
    """Values by name. Raises ProfileError naming file and line."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ProfileError(
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})"
        ) from error
    return values_of(text, str(path))


def values_of(text: str, source: str) -> Dict[str, float]:
    """Reads the values, as ``read``. Of a table of several components the autopilot's (1) count; of
    several vehicles none does.

    >>> values_of("# note\\nWPNAV_SPEED,200\\nFS_THR_ENABLE 3\\n1\\t1\\tVISO_TYPE\\t2\\t2", "file")
    {'WPNAV_SPEED': 200.0, 'FS_THR_ENABLE': 3.0, 'VISO_TYPE': 2.0}
    """
    values: Dict[str, float] = {}
    vehicles = set()
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        where = source if "\n" not in text else f"{source}, line {number}"
        fields = line.split("\t") if line.count("\t") >= 3 else re.split(r"[,\s]+", line)
        if len(fields) == 5:
            vehicle, component, *fields = fields[:4]
            if not (vehicle.isdigit() and component.isdigit()):
                raise ProfileError(f"{where}: '{line}' does not begin with vehicle and component")
            if component != "1":
                continue
            vehicles.add(vehicle)
        name, value = _pair(fields, line, where)
        if values.get(name, value) != value:
            raise ProfileError(
                f"{where}: {name} stands there twice, as {values[name]:g} and {value:g}"
            )
        values[name] = value
    if len(vehicles) > 1:
        ids = ", ".join(sorted(vehicles))
        raise ProfileError(f"{source}: holds several vehicles ({ids}); save each in its own file")
    if not values:
        raise ProfileError(f"{source}: holds no parameters")
    return values


def _pair(fields, line: str, where: str) -> Tuple[str, float]:
    try:
        name, value = fields[0], float(fields[1])
        if len(fields) == 2 and _NAME.match(name) and math.isfinite(value):
            return name, value
    except (IndexError, ValueError):
        pass
    raise ProfileError(f"{where}: '{line[:60]}' is not NAME,VALUE")


def mission_planner(parameters: Typed) -> str:
    """The text of a .param file."""
    return "".join(f"{name},{_number(*parameters[name])}\n" for name in sorted(parameters))


def qgroundcontrol(parameters: Typed, system: int) -> str:
    """The text of a .params file."""
    head = (
        f"# Onboard parameters for Vehicle {system}\n#\n# Vehicle-Id Component-Id Name Value Type\n"
    )
    rows = (
        f"{system}\t1\t{n}\t{_number(*parameters[n])}\t{parameters[n][1]}\n"
        for n in sorted(parameters)
    )
    return head + "".join(rows)


def _number(value: float, kind: int) -> str:
    """Enough digits for a float32 to come back as it was."""
    return f"{value:.9g}" if kind == REAL32 else f"{value:.0f}"

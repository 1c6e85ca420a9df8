# SPDX-License-Identifier: Apache-2.0
"""A plan as a mission file that ``fcsv_control`` flies (config/missions/*.yaml).

This package stands below ``fcsv_control`` and cannot ask its loader; the rules that a planned list can break are
held here too, and a test lets the real loader judge the same lists.
"""

import os
from pathlib import Path
from typing import List

import numpy as np
import yaml

from fcsv_stereo.errors import OutputError, PlanError
from fcsv_stereo.planning.plan import Plan, PlannedBaseline

MIN_SEPARATION_M = 1.5  # the mission's default
_COLUMN_M = (1.0, 8.0)  # where the one behind sees the tag: a larger separation cannot be lined up
_MOST_TILT_DEG = 30.0
_RECORD_S = (0.5, 600.0)


def mission_document(plan: Plan, name: str, record_s: float = 5.0, min_separation_m: float = MIN_SEPARATION_M) -> dict:
    """The mission's mapping. Raises PlanError naming what could not be flown and what to do."""
    if not name.strip():
        raise PlanError("--name is empty")
    if not _RECORD_S[0] <= record_s <= _RECORD_S[1]:
        raise PlanError(f"--record-s {record_s:g} is not in {_RECORD_S[0]:g}..{_RECORD_S[1]:g} s")
    if not 0 < min_separation_m <= _COLUMN_M[1]:
        raise PlanError(f"--min-separation-m {min_separation_m:g} is not in 0..{_COLUMN_M[1]:g} m")
    document = {"name": name}
    if min_separation_m != MIN_SEPARATION_M:
        document["min_separation_m"] = float(min_separation_m)
        document["column_spacing_m"] = float(max(3.5, min_separation_m))
        document["home_height_m"] = float(max(8.0, 1.0 + min_separation_m))
    document["configurations"] = [_configuration(b, record_s, min_separation_m) for b in plan.baselines]
    return document


def write_mission(document: dict, path: Path) -> None:
    """The file, whole or not at all. Raises OutputError."""
    head = "# Planned: rosrun fcsv_stereo plan. Trim points are for rosrun fcsv_stereo map.\n"
    lines = [yaml.safe_dump({k: v}, sort_keys=False) for k, v in document.items() if k != "configurations"]
    rows = [yaml.safe_dump(c, default_flow_style=True, sort_keys=False, width=200) for c in document["configurations"]]
    text = head + "".join(lines) + "configurations:\n" + "".join(f"  - {r}" for r in rows)
    partial = path.with_name(path.name + ".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(text)
        os.replace(partial, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error


def map_arguments(plan: Plan) -> List[str]:
    """What ``map`` is told so that it trims as planned."""
    words = []
    for axis in plan.request.axes:
        words.append(f"--trim-{axis}")
        words += [f"{b.range_m[1]:.4g}" for b in plan.baselines if b.axis == axis]
    return words


def _configuration(b: PlannedBaseline, record_s: float, min_separation_m: float) -> dict:
    baseline_m, tilt_deg = round(float(b.baseline_m), 3), round(float(np.degrees(b.tilt_rad)), 3)
    if baseline_m < min_separation_m:
        raise PlanError(
            f"{b.axis} {baseline_m:g} m is under the vehicles' minimum separation of {min_separation_m:g} m and would "
            f"not be flown: give fewer baselines (--number), a larger --nearest-m, or lengths by hand (--baselines)"
        )
    if tilt_deg > _MOST_TILT_DEG:
        raise PlanError(f"{b.axis} {baseline_m:g} m would be tilted by {tilt_deg:g} degrees; a mission allows 30")
    if tilt_deg and b.axis == "vertical":
        raise PlanError(
            "a hovering multirotor cannot pitch a fixed camera: fly vertical baselines with --tilt-per-m-deg 0"
        )
    found = {"axis": b.axis, "baseline_m": baseline_m}
    if tilt_deg:
        found["tilt_deg"] = tilt_deg
    return {**found, "record_s": float(record_s)}

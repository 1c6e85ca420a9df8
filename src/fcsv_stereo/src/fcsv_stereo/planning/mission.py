# SPDX-License-Identifier: Apache-2.0
"""A plan as a mission file (config/missions/*.yaml), judged by the schema that the mission itself
reads it with."""

from pathlib import Path
from typing import List

import numpy as np
import yaml

from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.mission import Mission, StereoConfiguration, spaced
from fcsv_geometry.programs.writing import in_words, write_whole
from fcsv_stereo.errors import OutputError, PlanError
from fcsv_stereo.planning.plan import Plan, PlannedBaseline

# the schema's defaults
MIN_SEPARATION_M, RECORD_S = Mission.min_separation_m, StereoConfiguration.record_s
#: What to do about a field of the mission that the schema refuses.
_REMEDIES = {
    "record_s": "give another --record-s",
    "min_separation_m": "give another --min-separation-m",
    "column_spacing_m": "vehicles that far apart cannot be lined up: give a smaller --min-separation-m",
    "baseline_m": "give fewer baselines (--number), a larger --nearest-m, or lengths by hand (--baselines)",
    "tilt_deg": "views are tilted by --tilt-per-m-deg; vertical ones are flown with 0",
}


def mission_document(
    plan: Plan, name: str, record_s: float = RECORD_S, min_separation_m: float = MIN_SEPARATION_M
) -> dict:
    """The mission's mapping. Raises PlanError naming what could not be flown and what to do."""
    if not name.strip():
        raise PlanError("--name is empty")
    document = {"name": name}
    if min_separation_m != MIN_SEPARATION_M:
        document.update(spaced(min_separation_m))
    document["configurations"] = [_configuration(b, record_s) for b in plan.baselines]
    try:
        config.from_mapping(document, Mission, "mission")
    except ConfigError as error:
        wrong = error.field.rpartition(".")[2]
        remedy = f": {_REMEDIES[wrong]}" if wrong in _REMEDIES else ""
        raise PlanError(
            f"the mission could not be flown: {error.field}: {error.problem}{remedy}"
        ) from error
    return document


def write_mission(document: dict, path: Path) -> None:
    """The file, whole or not at all. Raises OutputError."""
    head = "# Planned: rosrun fcsv_stereo plan.\n"
    lines = [
        yaml.safe_dump({k: v}, sort_keys=False)
        for k, v in document.items()
        if k != "configurations"
    ]
    text = head + "".join(lines) + "".join(configuration_lines(document))
    try:
        write_whole(path, text)
    except OSError as error:
        # not the partial one
        raise OutputError(in_words(OSError(error.errno, error.strerror, str(path)))) from error


def configuration_lines(document: dict) -> List[str]:
    """The list as it stands in a file, one configuration a line."""
    rows = [
        yaml.safe_dump(c, default_flow_style=True, sort_keys=False, width=200)
        for c in document["configurations"]
    ]
    return ["configurations:\n", *(f"  - {r}" for r in rows)]


def map_arguments(plan: Plan) -> List[str]:
    """What ``map`` is told so that it trims as planned."""
    words = []
    for axis in plan.request.axes:
        words.append(f"--trim-{axis}")
        words += [f"{b.range_m[1]:.4g}" for b in plan.baselines if b.axis == axis]
    return words


def _configuration(b: PlannedBaseline, record_s: float) -> dict:
    baseline_m, tilt_deg = round(float(b.baseline_m), 3), round(float(np.degrees(b.tilt_rad)), 3)
    tilt = {"tilt_deg": tilt_deg} if tilt_deg else {}
    return {"axis": b.axis, "baseline_m": baseline_m, **tilt, "record_s": float(record_s)}

# SPDX-License-Identifier: Apache-2.0
"""What ``survey`` needs to join a flight from a place that look_from found with the maps of which
it was found: a ``station.yaml`` for each, in the maps' home."""

from pathlib import Path
from typing import List, Sequence

import numpy as np

from fcsv_geometry.programs.writing import write_whole
from fcsv_guidance.ground.views import DepthView
from fcsv_guidance.route.look_from import LookFrom
from fcsv_stereo.survey.views.station import FILE, heading_rad

# m and degrees: of a reference that is brought there, and of maps in one home
_BROUGHT, _MAPPED = (2.0, 5.0), (0.05, 0.2)


def write_stations(found: LookFrom, mission: Path, maps: Sequence[DepthView]) -> List[Path]:
    """MISSION_station.yaml of the flight, and after it MISSION_station_N.yaml of each map. Raises
    OSError where the disk does not take them."""
    flight = _station(found.p_home_cam, found.yaw_rad, _BROUGHT, "where home of the flight is set")
    texts = [flight] + [
        _station(m.T_home_cam[:3, 3], heading_rad(m.T_home_cam), _MAPPED, f"of {m.name}")
        for m in maps
    ]
    paths = [mission.with_name(f"{mission.stem}_station.yaml")]
    paths += [mission.with_name(f"{mission.stem}_station_{n}.yaml") for n in range(1, len(texts))]
    for path, text in zip(paths, texts):
        write_whole(path, text)
    return paths


def joining_commands(stations: Sequence[Path], maps: Sequence[str]) -> List[str]:
    """What joins the flight with the maps once it is flown, as commands to paste; SESSION is the
    flight's folder."""
    inputs = [*maps, "SESSION"]
    return [
        "then, for one map of both in this home:",
        *(f"  cp {s} {into}/{FILE}" for s, into in zip((*stations[1:], stations[0]), inputs)),
        f"  rosrun fcsv_stereo survey {' '.join(inputs)} -o out/site",
        "  rosrun fcsv_guidance ground out/site --robot ... --route ... -o ...",
    ]


def _station(p_home: np.ndarray, yaw_rad: float, sigmas: Sequence[float], of: str) -> str:
    place = ", ".join(f"{x:.2f}" for x in p_home)
    return (
        f"# {of}; survey reads it as {FILE} (docs/user/survey.md)\n"
        f"place_m: [{place}]\nheading_deg: {np.degrees(yaw_rad):.2f}\n"
        f"place_sigma_m: {sigmas[0]}\nheading_sigma_deg: {sigmas[1]}\n"
    )

# SPDX-License-Identifier: Apache-2.0
"""What ``survey`` needs to join a flight from a place that look_from found with the maps of which
it was found: a ``station.yaml`` for each, in the maps' home."""

from pathlib import Path
from typing import List, Sequence

import numpy as np

from fcsv_geometry.programs.writing import require_file, write_whole
from fcsv_guidance.errors import GroundError
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
    paths = station_files(mission, len(maps))
    for path, text in zip(paths, texts):
        write_whole(path, text)
    return paths


def station_files(mission: Path, maps: int) -> List[Path]:
    """Paths that write_stations writes for so many maps; none for none."""
    names = ["", *(f"_{n}" for n in range(1, maps + 1))] if maps else []
    return [mission.with_name(f"{mission.stem}_station{name}.yaml") for name in names]


def require_new_files(mission: Path, maps: int, out: Path) -> None:
    """Checks that a mission with stations of so many ``maps`` overwrites nothing, and lies beside
    the folder ``out``. Raises GroundError, and OutputPlaceError where no file can be written."""
    if mission.is_dir():
        raise GroundError(
            f"--look-from {mission}: is a folder; name a new file in it, as look.yaml"
        )
    for path in (mission, *station_files(mission, maps)):
        if path.exists() or path.is_symlink():
            raise GroundError(
                f"--look-from {mission}: would overwrite {path}; name another file, or move it away"
            )
    file, folder = mission.resolve(), out.resolve()
    if file == folder or folder in file.parents or file in folder.parents:
        raise GroundError(
            f"--look-from {mission}: lies in the folder of -o, {out}; name a file beside it"
        )
    require_file(mission)


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

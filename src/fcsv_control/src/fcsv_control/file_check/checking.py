# SPDX-License-Identifier: Apache-2.0
"""One file to one finding: which kind it is, and what is wrong with it, in which line."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Iterator, List, Sequence

from fcsv_control.file_check.kinds import KINDS, MISSION, PARAMETER_SUFFIXES, FileKind, recognised
from fcsv_control.mission.plans.plan_check import require_flyable
from fcsv_control.mission.plans.plan_words import stations_in_words
from fcsv_geometry import config
from fcsv_geometry.errors import ConfigError, FcsvError
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.programs.workspace import find_bringup
from fcsv_geometry.vehicles.vehicle import load_vehicles

_VEHICLES = "vehicles"


@dataclass(frozen=True)
class FileFinding:
    """``kind``: "" where it was not recognised; ``problem``: "" where the file is good; ``line``: 0
    where no line is known; ``note``: what was not checked, or when stations are flown."""

    path: Path
    kind: str = ""
    problem: str = ""
    line: int = 0
    note: str = ""

    @property
    def words(self) -> str:
        """One line for a person.

        >>> FileFinding(Path("a.yaml"), "mission", "'name' is missing", 3).words
        "a.yaml: mission: error in line 3: 'name' is missing"
        """
        kind = f"{self.kind}: " if self.kind else ""
        if not self.problem:
            return f"{self.path}: {kind}ok{f' ({self.note})' if self.note else ''}"
        where = f" in line {self.line}" if self.line else ""
        return f"{self.path}: {kind}error{where}: {self.problem}"


def files_of(paths: Sequence[Path]) -> List[Path]:
    """The files named, and of folders every YAML and parameter file below, in order."""
    return [file for path in paths for file in (_below(path) if path.is_dir() else (path,))]


def _below(folder: Path) -> Iterator[Path]:
    return (
        p
        for p in sorted(folder.rglob("*"))
        if p.suffix in (".yaml", ".yml", *PARAMETER_SUFFIXES) and p.is_file()
    )


def check(
    path: Path, kind: str = "", vehicles: Sequence[str] = (), vehicles_dir: str = ""
) -> FileFinding:
    """The finding on a file. ``kind``: one of KINDS, "" finds it out.

    ``vehicles``: the column that is to fly a mission, front first; their files stand in
    ``vehicles_dir``, by default the folder vehicles/ beside the mission's own, else the
    workspace's.
    """
    name, problem, times = kind, None, ""
    try:
        found = KINDS[kind] if kind else recognised(path)
        name = found.name
        read = found.read(path)
        if name == MISSION and vehicles:
            folder = Path(vehicles_dir) if vehicles_dir else _vehicles_folder(path)
            _require_fleet(read, vehicles, folder)
            times = stations_in_words(read, vehicles)
    except FcsvError as error:
        problem = error
    if problem is None:
        return FileFinding(path, name, note=times or _not_checked(found))
    return FileFinding(path, name, _without(path, str(problem)), _line(path, problem))


def _vehicles_folder(mission: Path) -> Path:
    """The folder of vehicle files that belongs to a mission file. Raises ConfigError where there is
    none."""
    beside = mission.resolve().parent.parent / _VEHICLES
    if beside.is_dir():
        return beside
    workspace = find_bringup()
    if workspace is None:
        raise ConfigError(
            f"{mission}: no vehicle files are in {beside}: name their folder with --vehicles-dir"
        )
    return workspace / "config" / _VEHICLES


def _require_fleet(mission: Mission, vehicles: Sequence[str], folder: Path) -> None:
    """Raises FcsvError where these vehicles cannot fly the mission: as the mission node finds out
    at its start."""
    geometries = load_vehicles(folder, vehicles)
    mission.check_vehicles(list(vehicles))
    require_flyable(mission, list(vehicles), {name: v.radius_m for name, v in geometries.items()})


def _not_checked(kind: FileKind) -> str:
    return f"as YAML; its keys are {kind.foreign}'s, which checks them" if kind.foreign else ""


def _without(path: Path, words: str) -> str:
    """An error's words without the file's name at their beginning: the finding has it."""
    head = str(path)
    return words[len(head) :].lstrip(":, ") if words.startswith(head) else words


def _line(path: Path, error: FcsvError) -> int:
    if not (isinstance(error, ConfigError) and error.field):
        return 0
    return _quietly(lambda: config.line_of(path.read_text(), error.field), 0)


def _quietly(read: Callable[[], Any], otherwise: Any) -> Any:
    try:
        return read()
    except (OSError, UnicodeDecodeError):
        return otherwise

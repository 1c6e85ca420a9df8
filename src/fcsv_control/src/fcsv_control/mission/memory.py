# SPDX-License-Identifier: Apache-2.0
"""What a mission remembers over a restart of its node or its computer, as a small JSON document."""

import dataclasses
import hashlib
import json
from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Sequence

from fcsv_control.errors import SessionError
from fcsv_control.mission.activities.activity import CaptureWindow
from fcsv_control.mission.activities.looking_round import Turned
from fcsv_control.mission.plans.task_list import Task
from fcsv_geometry import config
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.stations import HOME_VIEW

FILE = "mission_memory.json"
_VERSION = 2
_MOST_AGE_S = 600.0  # it is written at least once a minute: older is of another flight
_POSE_NUMBERS = 16


@dataclass(frozen=True)
class RememberedList:
    """A FlightList: tasks that are left, configurations behind, T_home_cam (16 numbers, row-major)
    in the column."""

    left: List[Task]
    flown: List[int]
    parked: Dict[str, List[float]]
    notes: List[str] = field(default_factory=list)
    going_back: str = ""
    away: List[str] = field(default_factory=list)  # out of the column
    turned: List[Turned] = field(default_factory=list)  # who has looked round where
    at: Optional[int] = 0  # of the mission's viewpoints, where the column is; none: under way
    calibrated: str = HOME_VIEW.station  # at which station last; empty: the column has left it
    follows: bool = False  # vehicles follow, away from their places

    def __post_init__(self):
        bad = [n for n, T in self.parked.items() if len(T) != _POSE_NUMBERS]
        if bad:
            raise ValueError(f"parked.{bad[0]}: must have {_POSE_NUMBERS} numbers")
        if any(len(t.p_home_m) != 3 for t in self.turned):
            raise ValueError("turned: a place has 3 numbers")


@dataclass(frozen=True)
class Memory:
    """``calibration`` and ``home`` are messages as mappings, kept as they came; ``saved_s`` is
    wall-clock time."""

    mission: str
    digest: str
    vehicles: List[str]
    phase: str
    detail: str = ""
    aborted: bool = False
    captures: List[CaptureWindow] = field(default_factory=list)
    taken: Dict[str, str] = field(default_factory=dict)
    flight_list: Optional[RememberedList] = None
    # configurations of stations that were not flown whole, here and in flights before it
    unfinished: List[int] = field(default_factory=list)
    calibration: Any = None
    home: Any = None
    saved_s: float = 0.0
    version: int = _VERSION

    def __post_init__(self):
        if self.version != _VERSION:
            raise ValueError(
                f"version: {self.version} is not known here; this reads version {_VERSION}"
            )


def digest(mission: Mission) -> str:
    """Tells a mission from one that was changed."""
    return hashlib.sha256(
        json.dumps(dataclasses.asdict(mission), sort_keys=True).encode()
    ).hexdigest()[:16]


def to_text(memory: Memory) -> str:
    """The file's text."""
    return json.dumps(dataclasses.asdict(memory), indent=1)


def from_text(
    text: str, source: str, mission: Mission, vehicles: Sequence[str], wall_s: float
) -> Memory:
    """The memory of this mission's last run at the time of day ``wall_s``. Raises SessionError
    naming the ``source`` and what is wrong with a text that is damaged, of another mission or
    fleet, or too old."""
    try:
        memory = config.from_mapping(json.loads(text), Memory, source)
    except ValueError as error:
        raise SessionError(f"{source}: is damaged ({error})") from error
    except config.ConfigError as error:
        raise SessionError(f"{error}; the file is damaged or of another program") from error
    _require_fitting(source, memory, mission, vehicles, wall_s)
    return memory


def unfinished_stations(mission: Mission, wanted: Sequence[int], flown: Sequence[int]) -> List[int]:
    """The configurations of those stations of ``wanted`` ones that were not flown whole, each from
    its beginning: another flight has another home, and a map is of one. None without stations."""
    if not mission.stations:
        return []
    station_of = lambda i: mission.viewpoint(i).station  # noqa: E731
    left = {station_of(i) for i in wanted if i not in flown}
    return [i for i in sorted(wanted) if station_of(i) in left]


def unfinished_of(text: str, source: str, mission: Mission, vehicles: Sequence[str]) -> List[int]:
    """What an earlier flight of this mission left, however old; empty where the text is of
    another."""
    try:
        memory = config.from_mapping(json.loads(text), Memory, source)
        _require_fitting(source, memory, mission, vehicles, memory.saved_s)
    except (ValueError, config.ConfigError, SessionError):
        return []
    return memory.unfinished


def _require_fitting(
    source: str, memory: Memory, mission: Mission, vehicles: Sequence[str], wall_s: float
) -> None:
    if memory.digest != digest(mission):
        was = f"of mission '{memory.mission}' as it was then"
        raise SessionError(f"{source}: is {was}, not of '{mission.name}' as it is")
    if memory.vehicles != list(vehicles):
        raise SessionError(
            f"{source}: is of the fleet {', '.join(memory.vehicles)}, this is {', '.join(vehicles)}"
        )
    age_s = wall_s - memory.saved_s
    if age_s > _MOST_AGE_S:
        raise SessionError(f"{source}: is {age_s / 60.0:.0f} min old, of an earlier flight")
    if any(not 0 <= i < len(mission.configurations) for i in memory.unfinished):
        raise SessionError(f"{source}: names configurations that this mission lacks")
    known = memory.flight_list
    if known is None:
        return
    indices = [*known.flown, *(t.index for t in known.left if t.index is not None)]
    names = [*(t.vehicle for t in known.left), *known.parked, *known.away]
    views = [known.at or 0, *(t.view for t in known.left)]
    if (
        any(not 0 <= i < len(mission.configurations) for i in indices)
        or any(not 0 <= v < len(mission.viewpoints) for v in views)
        or set(known.parked) != set(vehicles)
    ):
        raise SessionError(f"{source}: names configurations or places that this mission lacks")
    if not set(names) <= set(vehicles):
        raise SessionError(f"{source}: names vehicles that this mission lacks")

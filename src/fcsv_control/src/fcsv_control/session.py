# SPDX-License-Identifier: Apache-2.0
"""session.yaml: what belongs together (docs/design/architecture.md, "Session")."""

import dataclasses
import os
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, Dict, List, Optional

import yaml

from fcsv_control.errors import SessionError
from fcsv_geometry import config
from fcsv_geometry.bags.parts import part_number
from fcsv_geometry.missions.mission import Mission

FILE = "session.yaml"
VERSION = 1


@dataclass(frozen=True)
class Simulation:
    """Present only where a session was simulated."""

    seed: int


@dataclass(frozen=True)
class Session:
    """A session folder's description; ``bags`` maps a machine's name to its bag's file name in the
    folder."""

    created: str  # UTC, ISO 8601
    reference: str
    vehicles: List[str]
    bags: Dict[str, str]
    mission: Mission
    simulation: Optional[Simulation] = None
    # of a machine's recording, after its first bag
    parts: Dict[str, List[str]] = field(default_factory=dict)
    version: int = VERSION

    def __post_init__(self):
        if self.version != VERSION:
            raise ValueError(
                f"version: {self.version} is not known here; this reads version {VERSION}"
            )
        if self.reference not in self.vehicles:
            raise ValueError(
                f"reference: '{self.reference}' is not among the vehicles {', '.join(self.vehicles)}"
            )
        missing = [n for n in [*self.vehicles, "control"] if n not in self.bags]
        if missing:
            raise ValueError(f"bags: there is none for {', '.join(missing)}")
        unknown = [n for n in self.parts if n not in self.bags]
        if unknown:
            raise ValueError(f"parts: there is no bag of {unknown[0]} for them to follow")
        outside = [
            b
            for bags in (self.bags.values(), *self.parts.values())
            for b in bags
            if Path(b).name != b
        ]
        if outside:
            raise ValueError(
                f"bags: '{outside[0]}' is not a plain file name in the session's folder"
            )


def new_session(
    mission: Mission, vehicles: List[str], created: str, seed: Optional[int] = None
) -> Session:
    """The description of a flight that begins: each machine writes NAME.bag. Raises
    MissionError."""
    mission.check_vehicles(vehicles)
    bags = {name: f"{name}.bag" for name in [*vehicles, "control"]}
    simulation = None if seed is None else Simulation(seed)
    return Session(created, mission.reference, list(vehicles), bags, mission, simulation)


def with_part(session: Session, machine: str, bag: str) -> Session:
    """The session with this bag of a machine listed; itself where it is."""
    first = session.bags.get(machine)
    listed = session.parts.get(machine, [])
    if first is None or part_number(bag, first) <= 0 or bag in listed:
        return session
    listed = sorted([*listed, bag], key=lambda name: part_number(name, first))
    return dataclasses.replace(session, parts={**session.parts, machine: listed})


def utc_now() -> str:
    """What ``created`` says of a flight that begins now."""
    return datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")


def save_session(folder, session: Session) -> Path:
    """Write session.yaml, whole or not at all. Raises SessionError where the disk refuses."""
    document: Dict[str, Any] = {
        "version": session.version,
        **_without_none(dataclasses.asdict(session)),
    }
    if not session.parts:
        del document["parts"]
    path = Path(folder) / FILE
    partial = path.with_name(FILE + ".partial")
    try:
        partial.write_text(yaml.safe_dump(document, sort_keys=False))
        os.replace(partial, path)
    except OSError as error:
        raise SessionError(f"{path}: cannot be written ({error.strerror})") from error
    return path


def load_session(folder) -> Session:
    """A session folder's description, with all its bags there. Raises ConfigError or
    SessionError."""
    folder = Path(folder)
    session = config.load(folder / FILE, Session)
    for name, bag in [
        *session.bags.items(),
        *((n, bag) for n, parts in session.parts.items() for bag in parts),
    ]:
        if (folder / f"{bag}.active").exists():
            raise SessionError(
                f"{folder / bag}.active: was not closed; run: rosrun fcsv_control repair_bag {folder}"
            )
        if not (folder / bag).is_file():
            raise SessionError(
                f"{folder / bag}: missing; copy the bag of {name} into the session's folder"
            )
    return session


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return [_without_none(v) for v in value] if isinstance(value, (list, tuple)) else value

# SPDX-License-Identifier: Apache-2.0
"""The mission's memory as a file."""

import os
from pathlib import Path
from typing import List, Optional, Sequence

from fcsv_control.errors import SessionError
from fcsv_control.mission import memory as memories
from fcsv_control.mission.memory import Memory
from fcsv_geometry.missions.mission import Mission


def write(path: Path, memory: Memory) -> None:
    """The file, whole or not at all. Raises SessionError where the disk refuses."""
    partial = path.with_name(path.name + ".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("w") as file:
            file.write(memories.to_text(memory))
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError as error:
        raise SessionError(
            f"{path}: cannot be written ({error.strerror}); a restart would not go on"
        ) from error


def read(path: Path, mission: Mission, vehicles: Sequence[str], wall_s: float) -> Optional[Memory]:
    """The memory of this mission's last run, None where there is none. Raises SessionError as
    memory.from_text, and where the file cannot be read."""
    try:
        text = path.read_text()
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise SessionError(f"{path}: cannot be read ({error})") from error
    return memories.from_text(text, str(path), mission, vehicles, wall_s)


def unfinished(path: Path, mission: Mission, vehicles: Sequence[str]) -> List[int]:
    """Reads memory.unfinished_of; empty where there is no file that can be read."""
    try:
        return memories.unfinished_of(path.read_text(), str(path), mission, vehicles)
    except (OSError, UnicodeDecodeError):
        return []


def set_aside(path: Path) -> Path:
    """Move a file that was refused out of the way; its new name. Raises SessionError where that
    fails."""
    aside, number = path.with_name(path.name + ".refused"), 1
    while aside.exists():
        number += 1
        aside = path.with_name(f"{path.name}.refused-{number}")
    try:
        path.rename(aside)
    except OSError as error:
        raise SessionError(
            f"{path}: cannot be set aside ({error.strerror}); move it away by hand"
        ) from error
    return aside

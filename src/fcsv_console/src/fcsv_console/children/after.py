# SPDX-License-Identifier: Apache-2.0
"""The commands of after the flight as child processes: gather_session and map."""

import math
import shlex
import time
from pathlib import Path
from typing import Callable, Dict, Iterable, Iterator, List, Mapping, Sequence

from fcsv_console.children.child import Child
from fcsv_console.model import after
from fcsv_console.model import facts as f
from fcsv_geometry.bags.repair import ACTIVE
from fcsv_geometry.programs.writing import in_words

COMMANDS = {
    after.GATHER: ("rosrun", "fcsv_control", "gather_session"),
    after.MAP: ("rosrun", "fcsv_stereo", "map"),
}


_LEFT_OVER_S = 3600.0  # what stands there for so long was left by a command that was killed


class AfterRunner:
    """``put`` is told of progress and end, by other threads."""

    def __init__(
        self, put: Callable[[f.Fact], None], commands: Mapping[str, Sequence[str]] = COMMANDS
    ):
        self._put, self._commands = put, commands
        self._children: Dict[str, Child] = {}

    def look(self, places: after.Places) -> None:
        """What is on the disk."""
        folder = Path(places.session).expanduser()
        session = bool(places.session) and (
            (folder / "session.yaml").is_file() or any(folder.glob("*.bag"))
        )
        recording = session and any(folder.glob(f"*{ACTIVE}"))
        report = bool(places.out) and report_of(places).is_file()
        self._put(
            f.PlacesFound(session, report, recording, bool(places.out) and self._is_made(places))
        )

    def _is_made(self, places: after.Places) -> bool:
        """Whether a command that this window did not start makes a map there: it has a hidden
        folder or file beside."""
        child = self._children.get(after.MAP)
        if child is not None and child.runs:
            return False
        out = Path(places.out).expanduser().absolute()
        return any(
            time.time() - made_s < _LEFT_OVER_S
            for made_s in _changed_s(out.parent.glob(f".{out.name}.*"))
        )

    def start(self, job: str, places: after.Places) -> None:
        """Returns at once."""
        told: List[str] = [""]

        def line(share: float, words: str) -> None:
            told[0] = words if math.isnan(share) else told[0]
            self._put(f.JobProgress(job, after.RUNS, share, words if math.isnan(share) else ""))

        def ended(status: int, last: str) -> None:
            child = self._children.get(job)
            stopped = child is not None and child.cancelled
            self._put(
                f.JobProgress(job, after.STOPPED)
                if stopped
                else after.judged(job, status, told[0] or last)
            )
            self.look(places)

        self._put(f.JobProgress(job, after.RUNS))
        try:
            self._children[job] = Child(
                [*self._commands[job], *_arguments(job, places)], line, ended
            )
        except (OSError, ValueError) as error:
            words = in_words(error) if isinstance(error, OSError) else str(error)
            self._put(f.JobProgress(job, after.FAILED, words=words))

    def cancel(self, job: str) -> None:
        """End it with all that it started."""
        if job in self._children and self._children[job].runs:
            self._children[job].cancel()

    def close(self) -> None:
        """End all, and wait for that."""
        for job in self._children:
            self.cancel(job)
        for child in self._children.values():
            child.wait()


def _changed_s(folders: Iterable[Path]) -> Iterator[float]:
    """When each changed last (s since 1970); what vanishes meanwhile is left out."""
    for folder in folders:
        try:
            yield folder.stat().st_mtime
        except OSError:
            continue


def report_of(places: after.Places) -> Path:
    """The page that ``map`` writes."""
    return Path(places.out).expanduser() / "report.html"


def _arguments(job: str, places: after.Places) -> List[str]:
    """Raises ValueError where quotes are not closed."""
    session, out = (str(Path(p).expanduser()) for p in (places.session, places.out))
    return [session, *shlex.split(places.sources)] if job == after.GATHER else [session, "-o", out]

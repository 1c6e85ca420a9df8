# SPDX-License-Identifier: Apache-2.0
"""A mission's list flown by ``rosrun fcsv_sim rehearse`` in a child process: one flight without
faults."""

import json
import shutil
import tempfile
from pathlib import Path
from typing import Callable, Optional, Sequence

from fcsv_console.children.child import Child
from fcsv_console.model.facts import RehearsalProgress
from fcsv_console.model.rehearsal import IMPOSSIBLE, RUNS, STOPPED, judged
from fcsv_geometry.programs.writing import in_words

COMMAND = ("rosrun", "fcsv_sim", "rehearse")


class Rehearser:
    """``put`` is told what becomes of it, by another thread. One at a time: another ends the one
    before."""

    def __init__(
        self,
        put: Callable[[RehearsalProgress], None],
        vehicles: Sequence[str],
        command: Sequence[str] = COMMAND,
    ):
        self._put, self._vehicles, self._command = put, list(vehicles), list(command)
        self._child: Optional[Child] = None

    def start(self, text: str) -> None:
        """Fly the file's text; returns at once."""
        self.cancel()
        wanted = [f"uav{k + 1}" for k in range(len(self._vehicles))]
        if self._vehicles != wanted:
            words = f"it flies {', '.join(wanted)} only, these are {', '.join(self._vehicles)}"
            self._put(RehearsalProgress(text, IMPOSSIBLE, words=words))
            return
        try:
            self._start(text)
        except OSError as error:
            self._put(RehearsalProgress(text, IMPOSSIBLE, words=in_words(error, self._command[0])))

    def _start(self, text: str) -> None:
        if shutil.which(self._command[0]) is None:
            raise FileNotFoundError(2, "is not installed here", self._command[0])
        folder = Path(tempfile.mkdtemp(prefix="fcsv_rehearsal_"))
        mission, result = folder / "mission.yaml", folder / "flown.json"
        argv = [
            *self._command,
            str(mission),
            "--flights",
            "1",
            "--faults",
            "none",
            "--jobs",
            "1",
            "--vehicles",
            str(len(self._vehicles)),
            "--json",
            str(result),
        ]

        def ended(status: int, last: str) -> None:
            if child is not None and child.cancelled:
                self._put(RehearsalProgress(text, STOPPED))
            else:
                self._put(judged(text, status, last, _read(result)))
            shutil.rmtree(folder, ignore_errors=True)

        child: Optional[Child] = None
        try:
            mission.write_text(text)
            self._put(RehearsalProgress(text, RUNS))
            child = Child(
                argv, lambda share, _line: self._put(RehearsalProgress(text, RUNS, share)), ended
            )
        except OSError:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        self._child = child

    def cancel(self) -> None:
        """End the one that runs."""
        if self._child is not None and self._child.runs:
            self._child.cancel()

    def close(self) -> None:
        """End it, and wait for that."""
        self.cancel()
        if self._child is not None:
            self._child.wait()


def _read(path: Path) -> Optional[list]:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None

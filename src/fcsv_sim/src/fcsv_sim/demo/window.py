# SPDX-License-Identifier: Apache-2.0
"""The operator's window of a demo: a process beside the machines, so that it stays open when they
are stopped."""

from pathlib import Path
from typing import List, Optional, Sequence

from fcsv_sim.machines.machines import Machine, Process

COMMAND = ("rosrun", "fcsv_console", "console")
_LOOK_S = 0.5


def arguments(vehicles: Sequence[str], mission: Path, session: Path) -> List[str]:
    """Gives the arguments of a window on a simulated fleet, whose machines all record into
    ``session``."""
    return ["--vehicles", ",".join(vehicles), "--mission", str(mission), "--session", str(session)]


class OperatorWindow:
    """Opened once; it ends when the operator closes it, by ``close``, or with this process."""

    def __init__(self, command: Sequence[str] = COMMAND):
        self._command = list(command)
        self._process: Optional[Process] = None

    def open(self, control: Machine, told: Sequence[str]) -> None:
        """Opens the window on the control PC's master, with the flight's clock; ``told``: its
        arguments."""
        self._process = Process(
            [*self._command, *told], control.folder / "console.log", control.env
        )

    @property
    def is_open(self) -> bool:
        return self._process is not None and self._process.returncode is None

    def wait(self) -> None:
        """Waits until it is closed."""
        while self.is_open:
            self._process.wait(_LOOK_S)

    def close(self) -> None:
        """Closes it with what it maps. Safe to call again."""
        if self._process is not None:
            self._process.stop()

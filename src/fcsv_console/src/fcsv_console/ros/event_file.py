# SPDX-License-Identifier: Apache-2.0
"""Events kept with the session: a table in its folder, one for each start of the window, written
beside it."""

import threading
from datetime import datetime, timezone
from pathlib import Path
from typing import Callable

from fcsv_console.model import facts as f
from fcsv_console.model.events import EventLog
from fcsv_geometry.programs.writing import in_words, write_whole

_EVERY_S = 2.0


class EventFile:
    """``keep`` as often as one likes; whole or not at all. ``put`` is told once why events cannot
    be kept."""

    def __init__(self, folder: Path, put: Callable[[f.Fact], None], started_s: float):
        stamp = datetime.fromtimestamp(started_s, timezone.utc).strftime("%Y%m%dT%H%M%SZ")
        self.path = folder / f"console_events_{stamp}.csv"
        self._put, self._problem = put, ""
        self._at_s, self._changes = float("-inf"), 0
        self._writer = threading.Thread(target=lambda: None)

    def keep(self, now_s: float, log: EventLog) -> None:
        """Writes where something changed, at most every 2 s, by a thread of its own."""
        if log.changes == self._changes or now_s - self._at_s < _EVERY_S or self._writer.is_alive():
            return
        self._at_s, self._changes = now_s, log.changes
        self._writer = threading.Thread(target=self._write, args=(log.as_csv(),), daemon=True)
        self._writer.start()

    def close(self, log: EventLog) -> None:
        """What is not written yet."""
        if self._writer.is_alive():
            self._writer.join()
        if log.changes != self._changes:
            self._write(log.as_csv())

    def _write(self, text: str) -> None:
        try:
            write_whole(self.path, text)
            self._problem = ""
        except OSError as error:
            words = in_words(error, self.path)
            if words != self._problem:
                self._problem = words
                self._put(f.Unusable("", "events", f"not kept: {words}"))

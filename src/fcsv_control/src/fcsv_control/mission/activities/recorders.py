# SPDX-License-Identifier: Apache-2.0
"""Switches the recorders of several vehicles on and off; who refuses is asked again, but not for
ever."""

from typing import Dict, List, Optional, Sequence

from fcsv_control.mission.outbox import Order, Outbox
from fcsv_control.mission.snapshot import Snapshot

# from the recorders' acknowledgement to the first picture that surely is written whole
FIRST_PICTURE_S = 0.2
LAST_PICTURE_S = 0.5  # a picture reaches the recorder this much later than its stamp, at most


class Recorders:
    """Switches the recorders of one attempt. ``patience_s``: how long one that refuses is asked."""

    def __init__(self, outbox: Outbox, names: Sequence[str], patience_s: float):
        self._outbox, self._names, self._patience_s = outbox, list(names), patience_s
        self._orders: List[Order] = []
        self._asked_s: Optional[float] = None  # the first time
        self._before: Dict[str, Optional[int]] = {}  # pictures
        self.refused = ""  # why they do not start
        self.given_up = False

    @property
    def on(self) -> bool:
        """Whether they were told to record, and not to stop since."""
        return bool(self._orders)

    def start(self, snapshot: Snapshot) -> None:
        """Pictures on."""
        self._orders = self._record(snapshot, True)

    def stop(self, snapshot: Snapshot) -> None:
        """Pictures off, where they are on."""
        if self._orders:
            self._record(snapshot, False)
            self._orders = []

    def started(self, snapshot: Snapshot) -> bool:
        """Whether every recorder is known to be on; where none will be, ``given_up``."""
        self._asked_s = snapshot.now_s if self._asked_s is None else self._asked_s
        if all(o.done for o in self._orders):
            self._before = {n: snapshot.vehicles[n].pictures for n in self._names}
            return True
        if all(o.outcome is not None for o in self._orders):
            self.refused = "; ".join(o.outcome for o in self._orders if o.failed)
            if snapshot.now_s - self._asked_s > self._patience_s:
                self.stop(snapshot)
                self.given_up = True
            else:
                self._orders = self._record(snapshot, True)
        return False

    def enough(self, snapshot: Snapshot, least: int) -> bool:
        """Whether every vehicle whose pictures are counted has taken so many since they started."""
        counted = [(snapshot.vehicles[n].pictures, before) for n, before in self._before.items()]
        taken = [now - before for now, before in counted if now is not None and before is not None]
        return all(n >= least for n in taken)

    def _record(self, snapshot: Snapshot, on: bool) -> List[Order]:
        return [self._outbox.order(snapshot.now_s, n, "RECORD", flag=on) for n in self._names]

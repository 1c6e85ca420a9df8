# SPDX-License-Identifier: Apache-2.0
"""When a relay joins its peers anew, or opens one link anew, and when it had better be started
again."""

from typing import Optional

# what closes and opens is told by both sides within milliseconds, on a busy machine within a second
_HALF_OPEN_S = 1.5
_TRIES = 2  # of a process that slept; each waits 3 s for its old sessions to close


class Joining:
    """Told what happened and how each try ended.

    A process that slept has sessions that its peers closed, and now and then one of them never
    closes: it keeps the port for as long as the process lives. An address that is not there,
    however, comes back.

    >>> joining = Joining()
    >>> joining.due(slept=True, moved=False), joining.ended(could=False), joining.hopeless
    (True, None, False)
    >>> joining.due(slept=False, moved=False), joining.ended(could=False), joining.hopeless
    (True, None, True)
    """

    def __init__(self) -> None:
        self._lost = self._woke = False
        self._failed = 0

    def due(self, slept: bool, moved: bool) -> bool:
        """Whether to join now: it slept, its addresses are others, or the last try failed."""
        self._woke = self._woke or slept
        return slept or moved or self._lost

    def ended(self, could: bool) -> None:
        """How the try ended."""
        self._lost = not could
        self._woke = self._woke and not could
        self._failed = 0 if could else self._failed + 1

    @property
    def hopeless(self) -> bool:
        """Whether another process is needed."""
        return self._woke and self._failed >= _TRIES


class HalfOpen:
    """Told how many peers listen on a link, and with how many machines its session has contact.

    Where a cut ends while a large message still waits for the old connection, Zenoh closes what it
    takes for the old one and means the new one, too: its peer counts as there and listening, the
    connection lives, and nothing that is sent goes by it, for as long as the radio is well (9 of
    110 cuts, Zenoh 1.10.2). Then the link is to be opened anew.

    >>> link = HalfOpen()
    >>> [link.due(listening=1, there=there, now_s=s) for there, s in ((0, 0.0), (1, 1.4), (0, 2.0), (0, 3.4), (0, 3.6))]
    [False, False, False, False, True]
    >>> link.due(listening=0, there=0, now_s=9.0), link.due(listening=2, there=3, now_s=20.0)
    (False, False)
    """

    def __init__(self) -> None:
        self._since_s: Optional[float] = None
        self._closed = False

    def due(self, listening: int, there: int, now_s: float) -> bool:
        """Whether to open it anew now."""
        if there >= listening and not self._closed:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        if now_s - self._since_s < _HALF_OPEN_S:
            return False
        self._since_s, self._closed = None, False
        return True

    def failed(self) -> None:
        """It could not be opened, and is closed: it is due again."""
        self._closed = True

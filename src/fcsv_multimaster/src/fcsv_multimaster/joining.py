# SPDX-License-Identifier: Apache-2.0
"""When a relay joins its peers anew, and when it had better be started again."""

_TRIES = 2  # of a process that slept; each waits 3 s for its old sessions to close


class Joining:
    """Told what happened and how each try ended.

    A process that slept has sessions that its peers closed, and now and then one of them never closes: it keeps the
    port for as long as the process lives. An address that is not there, however, comes back.

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

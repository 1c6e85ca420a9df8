# SPDX-License-Identifier: Apache-2.0
"""Which phase of the mission came before the one of now."""


class PhaseProgress:
    """Told every phase that is heard, in order.

    >>> phases = PhaseProgress()
    >>> for phase in ("CALIBRATE", "MOVE_HOME", "MOVE_HOME"): phases.tell(phase)
    >>> phases.before
    'CALIBRATE'
    """

    def __init__(self):
        self._now = self.before = ""

    def tell(self, phase: str) -> None:
        """The mission says that it is in it."""
        if phase != self._now:
            self.before, self._now = self._now, phase

# SPDX-License-Identifier: Apache-2.0
"""How often a report may cross the radio: what is worse takes more bytes, and then comes less
often."""


class Pace:
    """A report goes out at once where something changed, else as often as ``bytes_per_s`` carry,
    once a second at most.

    Over a long time no more than ``bytes_per_s``; ``burst_bytes`` more while much changes.

    >>> pace = Pace(bytes_per_s=250.0, burst_bytes=1000.0)
    >>> [pace.due(t_s, 500, changed=False) for t_s in (0.0, 1.0, 1.9, 2.1)]
    [True, False, False, True]
    >>> pace.due(2.7, 500, changed=True), pace.due(2.9, 500, changed=True)
    (True, False)
    """

    def __init__(
        self, bytes_per_s: float = 250.0, burst_bytes: float = 4000.0, least_s: float = 0.5
    ):
        self._bytes_per_s, self._burst_bytes, self._least_s = bytes_per_s, burst_bytes, least_s
        self._left_bytes, self._at_s = burst_bytes, float("-inf")
        self._sent_s = float("-inf")

    def period_s(self, size_bytes: int) -> float:
        """Gives the time from one report to the next where nothing changes."""
        return max(1.0, size_bytes / self._bytes_per_s)

    def due(self, now_s: float, size_bytes: int, changed: bool) -> bool:
        """Whether a report of this size goes out now; then it counts as sent."""
        if self._at_s > float("-inf"):
            self._left_bytes += (now_s - self._at_s) * self._bytes_per_s
        self._left_bytes, self._at_s = min(self._left_bytes, self._burst_bytes), now_s
        waited_s = now_s - self._sent_s
        by_itself = waited_s >= self.period_s(size_bytes) - 1e-3
        if not by_itself and not (
            changed and waited_s >= self._least_s and self._left_bytes >= size_bytes
        ):
            return False
        self._left_bytes, self._sent_s = self._left_bytes - size_bytes, now_s
        return True

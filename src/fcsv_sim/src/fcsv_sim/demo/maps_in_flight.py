# SPDX-License-Identifier: Apache-2.0
"""Lines of a demo about the map that grows in flight: how old its pictures are, how long after the
first set-point."""

from typing import Optional, Tuple

_SAID = ("partial", "ready", "failed")


class MapsInFlight:
    """Is told when configurations begin and every state of the map, each with the flight's time
    (s)."""

    def __init__(self):
        self._begun_s: Optional[float] = None
        self._said: Optional[Tuple] = None
        self._last: Optional[str] = None

    def begin(self, now_s: float) -> None:
        """The first set-point of the list is sent; said again it counts for nothing."""
        if self._begun_s is None:
            self._begun_s = now_s

    def on_map_state(self, message, now_s: float) -> Optional[str]:
        """A fcsv_msgs/MapState as one line; None where it says nothing new."""
        said = (message.state, message.detail, message.configurations)
        if said == self._said or message.state not in _SAID:
            return None
        self._said = said
        if message.state == "failed":
            return f"map in flight: {message.detail}"
        kind = "first look" if message.state == "partial" else "map"
        line = (
            f"{kind} in flight: {message.configurations} configurations, {message.points} points, "
        )
        line += f"{message.latency_s:.1f} s after the last picture"
        if self._begun_s is not None:
            after_s = now_s - self._begun_s
            line += f", {after_s:.1f} s after the first set-point"
            if message.state == "ready":
                self._last = (
                    f"first set-point to the last map in flight: {after_s:.1f} s by the flight's clock, "
                    f"{message.processing_s:.1f} s of them its making, {message.configurations} configurations"
                )
        return line

    def in_words(self) -> Optional[str]:
        """One line for the end of a flight; None where no map was finished."""
        return self._last

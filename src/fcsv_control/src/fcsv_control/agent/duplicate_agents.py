# SPDX-License-Identifier: Apache-2.0
"""A vehicle has one agent: of two that hear each other the younger one does nothing."""

from typing import Dict, Tuple

_LISTENS_S = 1.0  # heartbeats come at 5 Hz
_SAME_AGE_S = 0.3


class DuplicateAgentGuard:
    """``instance`` is this agent's own name, which no other start of an agent has."""

    def __init__(self, instance: str, now_s: float):
        self._instance, self._started_s = instance, now_s
        # (when it was heard, whether it goes first)
        self._others: Dict[str, Tuple[float, bool]] = {}

    def agent_lives(self, now_s: float, instance: str, age_s: float) -> None:
        """A heartbeat of an agent of this vehicle, which lives for ``age_s``."""
        if instance == self._instance:
            return
        older_s = age_s - (now_s - self._started_s)
        first = older_s > 0.0 if abs(older_s) > _SAME_AGE_S else instance < self._instance
        self._others[instance] = (now_s, first)

    def older(self, now_s: float) -> str:
        """The agent that goes first; empty: there is none."""
        for name, (heard_s, first) in self._others.items():
            if first and now_s - heard_s < _LISTENS_S:
                return name
        return ""

    def listening(self, now_s: float) -> bool:
        """Whether it was started a moment ago and cannot know yet."""
        return now_s - self._started_s < _LISTENS_S

# SPDX-License-Identifier: Apache-2.0
"""Which topics a playback does not have: nobody plays them while others of the same vehicle are
played."""

from typing import Callable, Dict, List, Tuple

from fcsv_console.model.facts import NotInBags

_LOOKS = 3  # in a row: a player's connections do not all stand at once


class Bags:
    """``follow`` each topic with what counts its publishers; ``facts``, once a second, gives what
    changed.

    >>> bags, plays = Bags(), {"mavros/state": 0, "diagnostics/worst": 0}
    >>> for topic in plays: bags.follow("uav1", topic, lambda topic=topic: plays[topic])
    >>> bags.facts()
    []
    >>> plays["mavros/state"] = 1
    >>> [len(bags.facts()) for _ in range(4)]
    [0, 0, 1, 0]
    >>> plays["diagnostics/worst"] = 1; bags.facts()
    [NotInBags(vehicle='uav1', topics=())]
    """

    def __init__(self):
        self._publishers: Dict[str, Dict[str, Callable[[], int]]] = {}
        self._played: Dict[str, set] = {}
        self._looks: Dict[str, int] = {}
        self._told: Dict[str, Tuple[str, ...]] = {}

    def follow(self, vehicle: str, topic: str, publishers: Callable[[], int]) -> None:
        """``topic`` below the vehicle's name."""
        self._publishers.setdefault(vehicle, {})[topic] = publishers

    def facts(self) -> List[NotInBags]:
        """A topic that was played once is in the bags, also after their end."""
        found = []
        for vehicle, topics in self._publishers.items():
            played = self._played.setdefault(vehicle, set())
            played.update(topic for topic, publishers in topics.items() if publishers() > 0)
            self._looks[vehicle] = self._looks.get(vehicle, 0) + 1 if played else 0
            missing = tuple(topic for topic in topics if topic not in played)
            if self._looks[vehicle] >= _LOOKS and missing != self._told.get(vehicle, ()):
                self._told[vehicle] = missing
                found.append(NotInBags(vehicle, missing))
        return found

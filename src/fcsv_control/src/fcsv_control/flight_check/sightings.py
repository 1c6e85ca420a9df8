# SPDX-License-Identifier: Apache-2.0
"""Whose tag is seen by whom, and since when."""

from typing import Dict, Iterable, List, Mapping, Optional, Tuple

_GAP_S = 2.5  # a camera on a slow computer takes a picture a second


class Sightings:
    """``tags``: vehicle -> id of the tag that it carries.

    >>> s = Sightings({"uav1": 1, "uav2": 2})
    >>> for t in (10.0, 11.0, 12.0):
    ...     s.saw(t, "uav2", [1, 77])
    >>> s.sees(12.5, "uav2", "uav1"), s.seen_by(12.5, "uav1"), s.sees(20.0, "uav2", "uav1")
    ((True, 2.5), ['uav2'], (False, 8.0))
    >>> s.sees(20.0, "uav1", "uav2")
    (False, None)
    """

    def __init__(self, tags: Mapping[str, int]):
        self._carrier: Dict[int, str] = {tag: name for name, tag in tags.items()}
        self._vehicles = list(tags)
        # observer, seen -> since, last (s)
        self._seen: Dict[Tuple[str, str], Tuple[float, float]] = {}

    def saw(self, now_s: float, observer: str, tag_ids: Iterable[int]) -> None:
        """What one picture of an observer held."""
        for name in {self._carrier[tag] for tag in tag_ids if tag in self._carrier} - {observer}:
            since_s, last_s = self._seen.get((observer, name), (now_s, now_s))
            self._seen[observer, name] = (now_s if now_s - last_s > _GAP_S else since_s), now_s

    def sees(self, now_s: float, observer: str, name: str) -> Tuple[bool, Optional[float]]:
        """Whether it sees the other's tag now, and for how long it has, or has not (s); None: it
        never has."""
        if (observer, name) not in self._seen:
            return False, None
        since_s, last_s = self._seen[observer, name]
        sees = now_s - last_s <= _GAP_S
        return sees, now_s - (since_s if sees else last_s)

    def seen_by(self, now_s: float, name: str) -> List[str]:
        """Who sees its tag now."""
        return [v for v in self._vehicles if self.sees(now_s, v, name)[0]]

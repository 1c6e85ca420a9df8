# SPDX-License-Identifier: Apache-2.0
"""Reading and writing an autopilot's parameters over a line that loses messages: values and time
in, questions out."""

import math
from typing import Dict, Generic, Iterable, List, Mapping, Optional, Tuple, TypeVar

_WINDOW = 10  # questions that are under way at once
_PATIENCE_S = 0.6
TRIES, _INDEX_TRIES = 8, 20  # one that is on the list exists: it comes in the end
_LIST_SILENT_S = 1.5  # of a list that is being sent; then what is missing is asked for one by one
_TOLERANCE = 1e-6

Key = TypeVar("Key", int, str)
Value = Tuple[float, int]  # and its MAV_PARAM_TYPE


class Asker(Generic[Key]):
    """Asks for each key until it is answered, some at a time, some times."""

    def __init__(self, keys: Iterable[Key], tries: int = TRIES):
        self._most = tries
        self._tries: Dict[Key, int] = dict.fromkeys(keys, 0)
        self._asked_s: Dict[Key, float] = {}

    def due(self, now_s: float) -> List[Key]:
        """What to ask now."""
        waiting = [k for k in self._tries if now_s - self._asked_s.get(k, -math.inf) < _PATIENCE_S]
        due = [k for k, tries in self._tries.items() if tries < self._most and k not in waiting]
        due = due[: max(0, _WINDOW - len(waiting))]
        for key in due:
            self._tries[key] += 1
            self._asked_s[key] = now_s
        return due

    def answered(self, key: Key) -> None:
        self._tries.pop(key, None)

    def over(self, now_s: float) -> bool:
        """All are answered or given up."""
        return all(
            n >= self._most and now_s - self._asked_s[k] >= _PATIENCE_S
            for k, n in self._tries.items()
        )

    @property
    def open(self) -> List[Key]:
        """What is not answered."""
        return list(self._tries)


class NamedRead:
    """Reads parameters by name; ``unknown`` are those that gave no answer."""

    def __init__(self, names: Iterable[str], tries: int = TRIES):
        self._asker: Asker[str] = Asker(names, tries)
        self.values: Dict[str, Value] = {}

    def receive(self, name: str, value: float, kind: int) -> None:
        """A PARAM_VALUE came."""
        self.values[name] = (value, kind)
        self._asker.answered(name)

    def due(self, now_s: float) -> List[str]:
        """Names to ask for now."""
        return self._asker.due(now_s)

    def over(self, now_s: float) -> bool:
        return self._asker.over(now_s)

    @property
    def unknown(self) -> List[str]:
        return self._asker.open


class WholeRead:
    """Reads the whole list: asks for it, and for what got lost by its index."""

    def __init__(self):
        self.values: Dict[str, Value] = {}
        self.count = 0
        self._seen: set = set()
        self._asker: Optional[Asker[int]] = None
        self._list_tries, self._heard_s = 0, -math.inf

    def receive(
        self, now_s: float, name: str, value: float, kind: int, count: int, index: int
    ) -> None:
        """A PARAM_VALUE came; one outside of the list has another count or index."""
        self.values[name] = (value, kind)
        self._heard_s = now_s
        if index < count:
            self.count = count
            self._seen.add(index)
            if self._asker is not None:
                self._asker.answered(index)

    def due(self, now_s: float) -> Tuple[bool, List[int]]:
        """Whether to ask for the list now, and indices to ask for."""
        if self._asker is not None:
            return False, self._asker.due(now_s)
        if self.complete or now_s - self._heard_s < _LIST_SILENT_S:
            return False, []
        if not self.count and self._list_tries < TRIES:
            self._list_tries, self._heard_s = self._list_tries + 1, now_s
            return True, []
        self._asker = Asker((i for i in range(self.count) if i not in self._seen), _INDEX_TRIES)
        return False, self._asker.due(now_s)

    @property
    def complete(self) -> bool:
        """Whether the whole list is there."""
        return self.count > 0 and len(self._seen) == self.count

    def over(self, now_s: float) -> bool:
        return self.complete or (self._asker is not None and self._asker.over(now_s))


class Write:
    """Sets values, and hears each back as it was set."""

    def __init__(self, values: Mapping[str, float]):
        self._wanted = dict(values)
        self._asker: Asker[str] = Asker(values)
        self.kept: Dict[str, float] = {}  # what the autopilot answered instead

    def receive(self, name: str, value: float) -> None:
        """A PARAM_VALUE came."""
        wanted = self._wanted.get(name)
        if wanted is None:
            return
        if abs(value - wanted) <= _TOLERANCE * max(1.0, abs(wanted)):
            self._asker.answered(name)
            self.kept.pop(name, None)
        else:
            self.kept[name] = value

    def due(self, now_s: float) -> List[Tuple[str, float]]:
        """Names and values to set now."""
        return [(name, self._wanted[name]) for name in self._asker.due(now_s)]

    def over(self, now_s: float) -> bool:
        return self._asker.over(now_s)

    @property
    def failed(self) -> List[str]:
        """A line for each that is not as it was set."""
        says = {
            n: f"it keeps {self.kept[n]:g}" if n in self.kept else "no answer"
            for n in self._asker.open
        }
        return [f"{n} {self._wanted[n]:g}: {says[n]}" for n in says]

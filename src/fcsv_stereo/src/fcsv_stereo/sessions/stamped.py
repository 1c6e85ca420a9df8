# SPDX-License-Identifier: Apache-2.0
"""What one topic of a session says over all bags, in order of stamp, without wrong stamps."""

from dataclasses import dataclass, field
from typing import Any, Callable, List, Optional, Tuple

from fcsv_geometry.streams.stamps import in_order, stuck
from fcsv_stereo.sessions.left_out import LeftOut

_ALONE_S = 10.0  # odometry comes all the time: a first or last stamp so far away is wrong


@dataclass
class Stamped:
    """``entries`` are (bag, stamp, value) as they were recorded."""

    topic: str
    entries: List[Tuple[Any, float, Any]] = field(default_factory=list)

    def add(self, bag: Any, stamp_s: float, value: Any = None) -> None:
        """The next of a bag."""
        self.entries.append((bag, stamp_s, value))

    def recorded(
        self, same: Callable[[Any, Any], bool], warnings: List[str]
    ) -> List[Tuple[float, Any]]:
        """(stamp, value) as recorded, bag after bag; what two bags hold alike counts once."""
        entries = self._bag_after_bag()
        first = {}
        kept, twice = [], set()
        for bag, stamp_s, value in entries:
            known_bag, known = first.setdefault(stamp_s, (bag, value))
            if known_bag != bag and same(known, value):
                twice.add((str(known_bag), str(bag)))
            else:
                kept.append((stamp_s, value))
        warnings += [
            f"{b} holds what {a} holds of {self.topic}: counted once" for a, b in sorted(twice)
        ]
        return kept

    def in_order(
        self,
        same: Callable[[Any, Any], bool],
        left_out: LeftOut,
        warnings: List[str],
        alone_s: Optional[float] = _ALONE_S,
    ) -> List[Tuple[float, Any]]:
        """(stamp, value) in order of time, without single wrong stamps; a jump back is a
        warning."""
        recorded = self.recorded(same, warnings)
        stamps = [s for s, _ in recorded]
        why = stuck(stamps)
        if why and not (len(stamps) == 1 and stamps[0] != 0.0):
            for s in stamps:
                left_out.add(self.topic, s, f"all stamps {why}")
            return []
        found = in_order(stamps, alone_s)
        for i in sorted(found.left_out):
            left_out.add(self.topic, stamps[i], f"its stamp {found.left_out[i]}")
        warnings += [
            f"topic {self.topic}: the clock jumps back by {before - after:.3f} s after {before:.3f}; "
            "the time that it counts twice is left out"
            for before, after in found.jumps
        ]
        return [recorded[i] for i in found.kept]

    def _bag_after_bag(self) -> List[Tuple[Any, float, Any]]:
        by_bag = {}
        for entry in self.entries:
            by_bag.setdefault(entry[0], []).append(entry)
        order = sorted(by_bag.values(), key=lambda of: sorted(s for _, s, _ in of)[len(of) // 2])
        return [entry for of in order for entry in of]

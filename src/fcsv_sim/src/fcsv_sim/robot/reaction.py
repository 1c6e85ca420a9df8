# SPDX-License-Identifier: Apache-2.0
"""How soon guidance answers a way that closes while the robot drives, by what its nodes publish.

A port: events with their time in, a WayClosed out.
"""

from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

_DEPTH_S = 0.3  # that depth of a picture takes at least: what is said earlier rests on older ones


@dataclass(frozen=True)
class WayClosed:
    """Times in s since the crate was there; None where it did not come to that. ``picture_s``: of
    the first picture that can show it, ``depth_s``: when its depth was there, ``held_s``: when the
    robot was told to stand, ``route_s``: when the first other route was there, ``none_s``: when
    guidance said that there is none, ``stood_s``: when the robot stood, ``opened_s``: when the
    crate went, ``drove_s``: when the robot was on its way again."""

    picture_s: Optional[float] = None
    depth_s: Optional[float] = None
    held_s: Optional[float] = None
    route_s: Optional[float] = None
    none_s: Optional[float] = None
    stood_s: Optional[float] = None
    opened_s: Optional[float] = None
    drove_s: Optional[float] = None

    @property
    def answer_s(self) -> Optional[float]:
        """Time from the picture to the new route, or to the word that there is none; None without."""
        answers = [s for s in (self.route_s, self.none_s) if s is not None]
        return None if self.picture_s is None or not answers else min(answers) - self.picture_s

    def in_words(self) -> str:
        """One line for a person.

        >>> WayClosed(0.1, 0.5, 0.6, 0.7, None, 1.0, 25.0, 3.2).in_words()
        'picture 0.10, its depth 0.50, held 0.60, new route 0.70, stood 1.00, drove on 3.20 s'
        """
        named = (
            ("picture", self.picture_s),
            ("its depth", self.depth_s),
            ("held", self.held_s),
            ("new route", self.route_s),
            ("no safe route", self.none_s),
            ("stood", self.stood_s),
            ("drove on", self.drove_s),
        )
        return ", ".join(f"{name} {s:.2f}" for name, s in named if s is not None) + " s"


class WayWatch:
    """Notes the first of each event after the way closed."""

    def __init__(self):
        self._closed_s: Optional[float] = None
        self._found: Dict[str, float] = {}
        self._unsorted: List[Tuple[str, float]] = []  # answers before a picture was heard of

    def on_way(self, words: str) -> None:
        """The crate came or went: "closed 12.345", "opened 37.345"."""
        change, at = words.split()
        if change == "closed":
            self._closed_s, self._found, self._unsorted = float(at), {}, []
        elif self._closed_s is not None:
            self._note("opened_s", float(at))

    def on_depth(self, now_s: float, stamp_s: float) -> None:
        """The depth of a watching picture came."""
        if self._closed_s is not None and stamp_s >= self._closed_s:
            self._note("picture_s", stamp_s)
            self._note("depth_s", now_s)
            for what, at_s in self._unsorted:  # a busy machine brings the depth late
                if at_s >= stamp_s + _DEPTH_S:
                    self._note(what, at_s)
            self._unsorted = []

    def on_route(self, now_s: float, is_route: bool) -> None:
        """A route came, or the word that there is none."""
        what = "route_s" if is_route else "none_s"
        if "picture_s" in self._found:
            self._note(what, now_s)
        elif self._closed_s is not None:
            self._unsorted.append((what, now_s))

    def on_hold(self, now_s: float, reason: str) -> None:
        """The robot is to stand, or may drive on where the reason is empty."""
        if reason and self._closed_s is not None:
            self._note("held_s", now_s)

    def on_command(self, now_s: float, drives: bool) -> None:
        """What the robot was told."""
        if self._closed_s is None:
            return
        if not drives:
            self._note("stood_s", now_s)
        elif "stood_s" in self._found:
            self._note("drove_s", now_s)

    @property
    def closed(self) -> Optional[WayClosed]:
        """None where no way closed."""
        return None if self._closed_s is None else WayClosed(**self._found)

    def _note(self, what: str, at_s: float) -> None:
        self._found.setdefault(what, round(at_s - self._closed_s, 3))

# SPDX-License-Identifier: Apache-2.0
"""What becomes an event: what differs from the last of its subject, and what could not be used."""

import math
from typing import Any, Dict, List, Optional, Tuple

from fcsv_console.model import facts as f
from fcsv_console.model.events import EventLog
from fcsv_console.model.goals import GoalsElsewhere
from fcsv_console.model.rehearsal import PASSED, RUNS, STOPPED
from fcsv_geometry.missions.phases import OVER

_PROBLEM_S = 5.0  # so long a message that could not be used is shown
_UNWELL_S = 60.0  # a diagnosis that comes and goes is an event again after so long without it
_LEVELS = {1: "WARN", 2: "ERROR", 3: "STALE"}  # of diagnostic_msgs/DiagnosticStatus
_HEALTH = ": health"
_LOUD = 4  # MAV_SEVERITY_WARNING


class Chronicle:
    """``wall_offset_s``: time of day minus the monotonic time that it is told; only events show
    it."""

    def __init__(self):
        self.log, self.wall_offset_s = EventLog(), 0.0
        self._bad: Dict[str, Tuple[float, int]] = {}  # what was wrong -> when last, how often
        # vehicle, name, level of a diagnosis -> when heard last
        self._unwell: Dict[Tuple[str, str, int], float] = {}
        self._phase = ""
        self._last_words: Dict[str, str] = {}  # what was logged last, by subject

    def event(
        self, now_s: float, who: str, what: str, answer: str = "", level: str = "info"
    ) -> int:
        """Its number; ``now_s`` is monotonic."""
        return self.log.add(now_s + self.wall_offset_s, who, what, answer, level)

    def _changed(
        self,
        now_s: float,
        subject: str,
        who: str,
        words: str,
        level: str = "info",
        state: Optional[str] = None,
    ) -> None:
        """An event where the words, or the ``state`` that they tell of, differ from the last about
        this subject."""
        state = words if state is None else state
        if self._last_words.get(subject, "") != state:
            self._last_words[subject] = state
            if words:
                self.event(now_s, who, words, level=level)

    def note_bad(self, now_s: float, words: str) -> None:
        """What could not be used: an event, and a problem for 5 s."""
        since_s, number = self._bad.get(words, (-math.inf, 0))
        if now_s - since_s > _PROBLEM_S:
            self.event(now_s, "console", words, level="warning")
        self._bad[words] = (now_s, number + 1)
        for old in [w for w, (at_s, _) in self._bad.items() if now_s - at_s > _PROBLEM_S]:
            del self._bad[old]

    def bad(self, now_s: float) -> List[str]:
        """What could not be used in the last 5 s, with how often."""
        bad = [(w, n) for w, (at_s, n) in self._bad.items() if now_s - at_s <= _PROBLEM_S]
        return [f"{words} ({number} times)" if number > 1 else words for words, number in bad]

    def _diagnosed(self, now_s: float, fact: f.Diagnosed) -> None:
        """An event, with what it is, where a diagnosis is none of the last minute's, and where all
        have ended."""
        for name, level, text in fact.wrong:
            if not name:
                continue  # it counts those that are not told
            key = (fact.vehicle, name, level)
            if now_s - self._unwell.get(key, -math.inf) > _UNWELL_S:
                node = node_of(fact.vehicle, name)
                words = f"{_LEVELS.get(level, 'WARN')} {node}: {text}"
                self.event(
                    now_s,
                    fact.vehicle,
                    words,
                    level="info" if self._phase == "WAIT_VEHICLES" else "warning",
                )
            self._unwell[key] = now_s
        of_it = [key for key in self._unwell if key[0] == fact.vehicle]
        if of_it and not fact.wrong and now_s - max(self._unwell[key] for key in of_it) > _UNWELL_S:
            self.event(now_s, fact.vehicle, "diagnostics: well again")
            self._unwell = {key: at_s for key, at_s in self._unwell.items() if key not in of_it}

    def remember(self, now_s: float, fact: Any) -> None:  # noqa: C901
        """A fact that was found sound: an event where it changes something."""
        if isinstance(fact, f.MissionReport):
            self._phase = fact.phase
            self._changed(now_s, "phase", "mission", f"{fact.phase}: {fact.detail}".rstrip(": "))
        elif isinstance(fact, f.GuardianReport):
            words = f"{fact.action}: {'; '.join(fact.reasons)}".rstrip(": ") if fact.action else ""
            self._changed(
                now_s, f"guardian {fact.vehicle}", f"{fact.vehicle} guardian", words, "warning"
            )
        elif isinstance(fact, f.AutopilotReport):
            armed = "armed" if fact.armed else "motors off"
            self._changed(now_s, f"mode {fact.vehicle}", fact.vehicle, f"{fact.mode}, {armed}")
        elif isinstance(fact, f.EpochReport):
            subject = f"epoch {fact.vehicle}"
            words = f"its odometry began{' anew' if subject in self._last_words else ''}"
            self._changed(now_s, subject, fact.vehicle, words, state=str(fact.epoch))
        elif isinstance(fact, f.VehicleText):
            level = "warning" if fact.severity <= _LOUD else "info"
            self._changed(
                now_s,
                f"said {fact.vehicle} {fact.who}",
                f"{fact.vehicle} {fact.who}",
                fact.text,
                level,
            )
        elif isinstance(fact, f.Diagnosed):
            self._diagnosed(now_s, fact)
        elif isinstance(fact, f.Answered) and fact.outcome:
            who = f"{fact.vehicle} agent"
            self.event(
                now_s, who, f"command {fact.number} of {fact.sender}", fact.outcome, "warning"
            )
        elif isinstance(fact, f.StopReport):
            self._changed(now_s, "stop", "stop-all", fact.words if fact.asked else "", "warning")
        elif isinstance(fact, f.RehearsalProgress) and fact.state != RUNS:
            level = "info" if fact.state in (PASSED, STOPPED) else "warning"
            self.event(now_s, "rehearsal", f"{fact.state}: {fact.words}".rstrip(": "), level=level)
        elif isinstance(fact, f.JobProgress):
            words = "runs" if fact.state == "runs" else f"{fact.state}: {fact.words}".rstrip(": ")
            self._changed(
                now_s,
                f"job {fact.job}",
                fact.job,
                words,
                "error" if fact.state == "failed" else "info",
            )
        elif isinstance(fact, GoalsElsewhere):
            self._changed(
                now_s, "goals", "console", fact.words, "warning" if fact.window else "info"
            )
        elif isinstance(fact, f.MasterReport) and (fact.problem or "master" in self._last_words):
            words, level = (
                (fact.problem, "error") if fact.problem else ("the ROS master answers", "info")
            )
            words, level = (
                ("the flight's machines are off", "info")
                if fact.problem and self._phase in OVER
                else (words, level)
            )
            self._changed(now_s, "master", "console", words, level)


def node_of(vehicle: str, name: str) -> str:
    """The node of a diagnosis, without its vehicle and without "health", which most are.

    >>> node_of("uav1", "uav1/tags: health"), node_of("uav1", "link uav1-control")
    ('tags', 'link uav1-control')
    """
    name = name[len(vehicle) + 1 :] if name.startswith(f"{vehicle}/") else name
    return name[: -len(_HEALTH)] if name.endswith(_HEALTH) else name

# SPDX-License-Identifier: Apache-2.0
"""The autopilot's parameters against a profile: read and reported, not changed silently."""

import math
from typing import Dict, List, Optional

from fcsv_control.flight.settings.profile import Profile, Rule

_TRIES = 5


class ParameterCheck:
    """Which parameters are still to be read, and what is wrong with those that were."""

    def __init__(self, profile: Profile):
        self.profile = profile
        self.begin()

    def begin(self) -> None:
        """Read all again: the autopilot may have been changed or restarted."""
        self._values: Dict[str, float] = {}
        self._complaints: Dict[str, str] = {}  # about what was answered, by name
        self._unread = {rule.name for rule in self.profile if rule.must}
        ordered = sorted(self.profile, key=lambda rule: not rule.must)  # those that block first
        self._asked: Dict[str, int] = {rule.name: 0 for rule in ordered}

    def next(self) -> Optional[str]:
        """The name to ask for now, one at a time; None when done. An unknown name gets no answer:
        asked some times."""
        waiting = [n for n in self._asked if n not in self._values and self._asked[n] < _TRIES]
        if not waiting:
            return None
        name = min(waiting, key=self._asked.get)
        self._asked[name] += 1
        return name

    def answer(self, name: str, value: float) -> Optional[Rule]:
        """Note a PARAM_VALUE; the rule of one that must be otherwise, else None."""
        rule = self.profile.rule(name)
        if rule is None:
            return None
        self._values[name] = value
        self._unread.discard(name)
        self._complaints.pop(name, None)
        complaint = rule.complaint(value)
        if complaint:
            self._complaints[name] = complaint
        return rule if rule.must and complaint else None

    def value(self, name: str) -> float:
        """What the autopilot answered; NaN where it has not, or where the profile has no such
        name."""
        return self._values.get(name, math.nan)

    @property
    def known(self) -> bool:
        """Whether all that must be so was answered."""
        return not self._unread

    @property
    def complete(self) -> bool:
        """Whether all were answered or given up."""
        return all(n in self._values or tries >= _TRIES for n, tries in self._asked.items())

    def wrong(self) -> List[str]:
        """One line for each parameter that must be otherwise."""
        return self._complaints_of(must=True)

    def unknown(self) -> List[str]:
        """Names that the autopilot did not answer."""
        return [n for n, tries in self._asked.items() if n not in self._values and tries >= _TRIES]

    def problems(self) -> List[str]:
        """One line for each parameter that must be otherwise, or that must be and that the
        autopilot does not have."""
        silent = [n for n in self.unknown() if self.profile.rule(n).must]
        return self.wrong() + [f"{n} was not answered: does this firmware have it?" for n in silent]

    def warnings(self) -> List[str]:
        """One line for each parameter that should be otherwise."""
        return self._complaints_of(must=False)

    def _complaints_of(self, must: bool) -> List[str]:
        told = self._complaints
        rules = self.profile if told else ()
        return [told[r.name] for r in rules if r.must == must and r.name in told]

# SPDX-License-Identifier: Apache-2.0
"""Whether other programs leave a simulated flight enough of the processors.

Slow motion (decision 9) gives way to other work down to its least rate. A flight that gets less than
it needs then is starved: poses come late, autopilots lose their position, and nothing that it shows
is true. It ends early instead, and says what takes the processors.
"""

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Dict, Optional, Tuple

import psutil

from fcsv_geometry.errors import FcsvError
from fcsv_sim.machines.slow_motion import both_clocks

_NAMED = 3
_LOWEST = 19  # priority, as of nice(1)
_LEAST_NAMED = 0.05  # share of the processors of a program that is worth its name


class MachineTooBusy(FcsvError):
    """Other programs leave a simulated flight too little; the message names them."""


@dataclass(frozen=True)
class Load:
    """Shares (0..1) of all processors over the time since the look before, at real ``now_s``:
    of all that is not the flight, and of its largest programs by name."""

    now_s: float
    others: float
    programs: Tuple[Tuple[str, float], ...] = ()


@dataclass(frozen=True)
class CrowdRules:
    """Others may take ``most_others`` of the processors; more for ``lasting_s`` is too much. At the
    least rate a flight of two vehicles needs half a core of two (measured), rviz as much again."""

    most_others: float = 0.65
    lasting_s: float = 8.0
    every_s: float = 2.0


class Crowd:
    """Judges how much of the processors others take."""

    def __init__(self, rules: CrowdRules = CrowdRules()):
        self._rules, self._since_s = rules, math.inf

    @property
    def crowded(self) -> bool:
        """Whether others took too much at the last look."""
        return self._since_s < math.inf

    def too_busy(self, load: Load) -> str:
        """Says, in words, why a flight cannot go on; empty where it can.

        >>> crowd = Crowd()
        >>> [crowd.too_busy(Load(s, 0.9, (("make", 0.8),))) for s in (0.0, 4.0)]
        ['', '']
        >>> crowd.too_busy(Load(8.0, 0.9, (("make", 0.8),))).partition(";")[0]
        'the machine is too busy to fly: other programs take 90 % of the processors (make 80 %)'
        """
        if not load.others > self._rules.most_others:
            self._since_s = math.inf
            return ""
        self._since_s = min(self._since_s, load.now_s)
        if load.now_s - self._since_s < self._rules.lasting_s:
            return ""
        named = ", ".join(f"{name} {share:.0%}".replace("%", " %") for name, share in load.programs)
        takes = f"{100.0 * load.others:.0f} % of the processors{f' ({named})' if named else ''}"
        return (
            f"the machine is too busy to fly: other programs take {takes}; end them, or try again "
            "later"
        )


class CrowdWatch:
    """Looks at this machine's processors. The flight is process ``root`` and all that it started;
    programs that give way to it are no crowd."""

    def __init__(self, root: Optional[int] = None, rules: CrowdRules = CrowdRules()):
        self._root, self._rules, self._crowd = psutil.Process(root), rules, Crowd(rules)
        self._before = self._sample()

    @property
    def crowded(self) -> bool:
        """Whether others took too much at the last look."""
        return self._crowd.crowded

    def look(self) -> None:
        """Looks where it is time to. Raises MachineTooBusy."""
        if both_clocks()[1] - self._before[0] < self._rules.every_s:
            return
        now = self._sample()
        words = self._crowd.too_busy(_load(self._before, now))
        self._before = now
        if words:
            raise MachineTooBusy(words)

    def look_before(
        self, say: Callable[[str], None], sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """Looks once before a flight begins, and as long as others take too much, which it says.
        Raises MachineTooBusy."""
        sleep(self._rules.every_s)
        self.look()
        if self.crowded:
            say(f"other programs use the processors: waiting for them, {self._rules.lasting_s:g} s")
        while self.crowded:
            sleep(self._rules.every_s)
            self.look()

    def _sample(self) -> "_Sample":
        ours = {self._root.pid, *(p.pid for p in self._root.children(recursive=True))}
        times = psutil.cpu_times()  # what a hypervisor takes away is no other program's
        busy_s, all_s = times.user + times.nice + times.system, sum(times[:8])
        used: Dict[int, Tuple[str, float, bool]] = {}
        for p in psutil.process_iter(["name", "cpu_times", "nice"]):
            own = p.info["cpu_times"]
            if own is not None:
                no_crowd = p.pid in ours or _gives_way(p.pid, p.info["nice"])
                used[p.pid] = (p.info["name"], own.user + own.system, no_crowd)
        return both_clocks()[1], busy_s, all_s, used


def _gives_way(pid: int, nice: int) -> bool:
    """Whether a process has the lowest priority, and its session, too, where Linux divides the
    processors between sessions first (autogroup, man 7 sched)."""
    if nice != _LOWEST:
        return False
    try:
        session = Path(f"/proc/{pid}/autogroup").read_text()
    except OSError:
        return True  # no such division, or it is over
    return not session.strip() or session.rsplit(None, 1)[1] == str(_LOWEST)


_Sample = Tuple[float, float, float, Dict[int, Tuple[str, float, bool]]]


def _load(before: _Sample, now: _Sample) -> Load:
    """Gives the load between two samples."""
    whole_s = max(now[2] - before[2], 1e-3)
    own_s, others_s = 0.0, {}
    for pid, (name, used_s, ours) in now[3].items():
        spent_s = used_s - before[3].get(pid, (name, 0.0, ours))[1]
        if ours:
            own_s += spent_s
        else:
            others_s[name] = others_s.get(name, 0.0) + spent_s
    worst = sorted(((s / whole_s, name) for name, s in others_s.items()), reverse=True)[:_NAMED]
    programs = tuple((name, share) for share, name in worst if share >= _LEAST_NAMED)
    return Load(now[0], max(now[1] - before[1] - own_s, 0.0) / whole_s, programs)

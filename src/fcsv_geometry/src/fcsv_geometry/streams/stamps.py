# SPDX-License-Identifier: Apache-2.0
"""Which stamps of a recorded topic can be believed: single wrong ones, clocks that jump or stand
still.

Stamps come in the order in which the messages were recorded.
"""

import bisect
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

_JUMP_S = 1.0  # a step forward that begins a new stretch
_FEW, _FEW_SHARE = (
    2,
    0.02,
)  # messages in a row, and their share, that are single wrong ones and no jump of a clock
_LATE_PLACES = 3  # so many messages may be recorded before one that was sent before them
_GAP = 0.5  # usual periods between stamps: one that was late fills the gap that it left
_END_GAP = 1.5  # the same, at most, of one that comes before the first or after the last
_STUCK = 0.9  # share of the messages with one stamp
_SINCE_START_S = 10.0  # simulated time begins at 0: such stamps are none of it
_MINOR = 0.1  # of two stretches of one time, the one with so few messages of the other's is wrong


@dataclass
class StampOrder:
    """``kept`` are indices in order of stamp, ``left_out`` says of each other one why.

    Messages that were only recorded late are kept at the place of their stamp.

    ``jumps`` are the stamps (before, after), s, where the clock went back.
    """

    kept: List[int]
    left_out: Dict[int, str] = field(default_factory=dict)
    jumps: List[Tuple[float, float]] = field(default_factory=list)


def stuck(stamps_s: Sequence[float]) -> str:
    """Why none of the stamps can be used; empty: they can.

    >>> stuck([0.0, 0.0, 0.0]), stuck([5.0, 5.0, 5.0])
    ('are 0: does the driver fill header.stamp?', 'stand still at 5.000')
    """
    values, counts = np.unique(np.asarray(stamps_s, float), return_counts=True)
    most = int(np.argmax(counts)) if len(values) else 0
    if not len(values) or counts[most] < _STUCK * len(stamps_s):
        return ""
    if values[most] == 0.0:
        return "are 0: does the driver fill header.stamp?"
    return f"stand still at {values[most]:.3f}" if counts[most] > 2 else ""


def in_order(stamps_s: Sequence[float], alone_s: Optional[float] = None) -> StampOrder:
    """The fewest are left out so that the others rise.

    Messages that changed places with their neighbours on the way are sorted. Where a clock went
    back, both stretches are kept but for the time that they share, which nobody can tell apart. A
    first or last stamp that is ``alone_s`` from its neighbour is wrong.

    >>> found = in_order([1.0, 1.1, 61.2, 1.3, 1.4])
    >>> found.kept, found.left_out
    ([0, 1, 3, 4], {2: 'is 59.9 s after its neighbours'})
    >>> in_order([1.0, 1.1, 1.3, 1.2, 1.4]).kept
    [0, 1, 3, 2, 4]
    """
    stamps = [float(s) for s in stamps_s]
    found = StampOrder([])
    _leave_out_empty(stamps, found)
    believed = [i for i in range(len(stamps)) if i not in found.left_out]
    rising = [believed[k] for k in _longest_rise([stamps[i] for i in believed])]
    runs = _runs(sorted(set(believed) - set(rising)))
    few = [i for r in runs if len(r) <= max(_FEW, _FEW_SHARE * len(stamps)) for i in r]
    order, late = _with_late(stamps, rising, few)
    found.left_out.update({i: _why(stamps, i, rising) for i in few if i not in late})
    left = [i for i in range(len(stamps)) if i not in found.left_out and i not in late]
    for k in reversed([k for k, i in enumerate(order) if i in late]):  # the next one stands there
        left.insert(left.index(order[k + 1]) if k + 1 < len(order) else len(left), order[k])
    for i, neighbour in ((0, 1), (-1, -2)):
        if alone_s and len(left) > 2 and abs(stamps[left[i]] - stamps[left[neighbour]]) > alone_s:
            alone = left.pop(i)
            found.left_out[alone] = _why(stamps, alone, left)
    stretches = _stretches(stamps, left)
    for a, b in zip(stretches, stretches[1:]):
        if stamps[b[0]] <= stamps[a[-1]]:
            found.jumps.append((stamps[a[-1]], stamps[b[0]]))
    found.kept = _without_shared(stamps, stretches, found) if found.jumps else left
    return found


def _leave_out_empty(stamps: Sequence[float], found: StampOrder) -> None:
    """Zeros, and those that repeat the one before."""
    wall_time = bool(stamps) and float(np.median(stamps)) > _SINCE_START_S
    for i, stamp_s in enumerate(stamps):
        if wall_time and stamp_s == 0.0:
            found.left_out[i] = "is 0"
        elif i and stamp_s == stamps[i - 1]:
            found.left_out[i] = "is that of the message before"


def _longest_rise(stamps: Sequence[float]) -> List[int]:
    """Indices of a longest rising subsequence (patience sorting); of several, a steady one."""
    tails: List[float] = []
    piles: List[List[int]] = []  # by place in the rise; stamps fall within a pile
    for i, s in enumerate(stamps):
        k = bisect.bisect_left(tails, s)
        if k == len(tails):
            tails.append(s)
            piles.append([])
        tails[k] = s
        piles[k].append(i)
    chain = piles[-1][-1:] if piles else []
    for pile in piles[-2::-1]:
        chain.append(next(i for i in pile if stamps[i] < stamps[chain[-1]]))
    return chain[::-1]


def _with_late(
    stamps: Sequence[float], rising: Sequence[int], few: Sequence[int]
) -> Tuple[List[int], List[int]]:
    """``rising`` with those of ``few`` that were only recorded late or early, and these.

    They stand at most three places from there, and fill the gap that they left: after a step of the
    clock, or where a stamp is wrong, there is no gap.
    """
    if len(rising) < _LATE_PLACES:
        return list(rising), []
    period_s = float(np.median(np.diff([stamps[i] for i in rising])))
    order: List[int] = list(rising)
    late: List[int] = []
    for i in few:
        k = bisect.bisect_left([stamps[j] for j in order], stamps[i])
        gaps_s = [abs(stamps[i] - stamps[j]) for j in order[max(k - 1, 0) : k + 1]]
        passed = [*(j for j in order[:k] if j > i), *(j for j in order[k:] if j < i)]
        alone = len(gaps_s) == 1 and gaps_s[0] > _END_GAP * period_s
        if len(passed) <= _LATE_PLACES and min(gaps_s) >= _GAP * period_s and not alone:
            late.append(i)
            order.insert(k, i)
    return order, late


def _runs(indices: Sequence[int]) -> List[List[int]]:
    """Neighbouring indices together."""
    runs: List[List[int]] = []
    for i in indices:
        if runs and i == runs[-1][-1] + 1:
            runs[-1].append(i)
        else:
            runs.append([i])
    return runs


def _why(stamps: Sequence[float], i: int, kept: Sequence[int]) -> str:
    k = bisect.bisect_left(kept, i)
    beside = [stamps[kept[j]] for j in (k - 1, k) if 0 <= j < len(kept)]
    off_s = min((stamps[i] - b for b in beside), key=abs) if beside else 0.0
    if off_s == 0.0:
        return "is that of the message before"
    by = f"{abs(off_s):.1f} s" if abs(off_s) >= 0.1 else f"{1e3 * abs(off_s):.0f} ms"
    return f"is {by} {'after' if off_s > 0.0 else 'before'} its neighbours"


def _stretches(stamps: Sequence[float], indices: Sequence[int]) -> List[List[int]]:
    """Cut where the clock goes back, or forward by more than a second."""
    stretches: List[List[int]] = []
    for i in indices:
        if stretches and 0.0 < stamps[i] - stamps[stretches[-1][-1]] <= _JUMP_S:
            stretches[-1].append(i)
        else:
            stretches.append([i])
    return stretches


def _without_shared(
    stamps: Sequence[float], stretches: List[List[int]], found: StampOrder
) -> List[int]:
    """Orders the stamps, in order of stamp, without the time of which two stretches claim to be."""
    spans = [(stamps[s[0]], stamps[s[-1]]) for s in stretches]
    kept: List[int] = []
    for k, stretch in enumerate(stretches):
        rivals = [
            spans[j]
            for j, other in enumerate(stretches)
            if j != k and len(other) >= _MINOR * len(stretch)
        ]
        for i in stretch:
            if any(first <= stamps[i] <= last for first, last in rivals):
                found.left_out[i] = "is of a time that the clock counts twice"
            else:
                kept.append(i)
    return sorted(kept, key=lambda i: stamps[i])

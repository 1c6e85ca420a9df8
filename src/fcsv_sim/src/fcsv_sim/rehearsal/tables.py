# SPDX-License-Identifier: Apache-2.0
"""Rehearsed flights as a table, one line per fault."""

import math
from statistics import median
from typing import Dict, List, Sequence, Tuple

from fcsv_sim.rehearsal.calm import DEADLINES_S
from fcsv_sim.rehearsal.flight import Result
from fcsv_sim.rehearsal.invariants import KINDS
from fcsv_sim.rehearsal.witness import FaultAnswer

_HEADS = (
    "fault",
    "flights",
    *KINDS,
    "nearest (m)",
    "as one lands past (m)",
    "reaction (s)",
    "drift until then (m)",
    "recorded whole",
)
_PAIRS = "pairs of faults"


def table(flown: Sequence[Tuple[str, Result]]) -> List[str]:
    """Lines of a table of flights and the names of their faults: flights with a violation of each
    kind, distances, and of faults that befell a vehicle in GUIDED the median and the worst time to
    the first command to hold, brake or land, and how far the vehicle moved meanwhile, where it had
    hovered."""
    by_fault: Dict[str, List[Result]] = {}
    for name, result in flown:
        by_fault.setdefault(_PAIRS if len(result.faults) > 1 else name, []).append(result)
    rows = [_row(fault, results) for fault, results in by_fault.items()]
    return ["| " + " | ".join(cells) + " |" for cells in (_HEADS, ["---"] * len(_HEADS), *rows)]


def feeds_lines(results: Sequence[Result]) -> List[str]:
    """Lines of a table of the longest silence of each feed, in flights in which nothing befell
    anybody; none where there is no such flight."""
    calm = [r.silences_s for r in results if r.silences_s is not None]
    if not calm:
        return []
    rows = [
        f"| {feed} | {max(s[feed] for s in calm):.2f} | {most_s:g} |"
        for feed, most_s in DEADLINES_S.items()
    ]
    return [
        "",
        f"| feed, in {len(calm)} calm flights | longest silence (s) | deadline (s) |",
        "| --- | --- | --- |",
        *rows,
    ]


def speed_line(results: Sequence[Result]) -> str:
    """How much faster than real time flights were rehearsed, by processor time."""
    rates = [r.flown_s / r.cpu_s for r in results if r.cpu_s > 0]
    if not rates:
        return "no flight"
    flown_s, cpu_s = sum(r.flown_s for r in results), sum(r.cpu_s for r in results)
    return (
        f"{len(results)} flights, {flown_s / 60.0:.0f} min in all; {flown_s / cpu_s:.0f} simulated seconds per second "
        f"of one processor (slowest flight {min(rates):.0f})"
    )


def verdict_line(flown: Sequence[Tuple[str, Result]]) -> str:
    """Flights and the names of their faults in one sentence: whether anything unsafe happened, and
    what was left."""
    count = len(flown)
    calm = not any(r.faults for _, r in flown)
    how = "calm flights" if calm else "flights with faults"
    broken = [(name, r) for name, r in flown if r.violations]
    if broken:
        kinds = ", ".join(kind for kind in KINDS if any(r.has(kind) for _, r in broken))
        name, first = broken[0]
        return (
            f"Verdict: do not fly it: {len(broken)} of {count} {how} were unsafe ({kinds}); see one: "
            f"--faults '{name}' --seed {first.seed} --trace"
        )
    short = [r for _, r in flown if r.captures < r.wanted]
    if calm and short:
        first = short[0]
        return (
            f"Verdict: safe, but not whole: {len(short)} of {count} {how} left configurations out, the first with "
            f"{first.captures} of {first.wanted} ({first.phase}: {first.detail}); see it: --seed {first.seed} --trace"
        )
    whole = f"; {count - len(short)} recorded every configuration"
    return f"Verdict: nothing unsafe in {count} {how}{whole}{'' if not calm else '; with faults: --faults all'}"


def _row(fault: str, results: List[Result]) -> List[str]:
    answers = [a for r in results for a in r.answers if a.flown] if fault != _PAIRS else []
    return [
        fault,
        str(len(results)),
        *(str(sum(r.has(kind) for r in results)) for kind in KINDS),
        _metres(min(r.nearest_m for r in results)),
        _metres(min(r.crossing_m for r in results)),
        *_reaction(answers),
        str(sum(r.captures == r.wanted for r in results)),
    ]


def _reaction(answers: List[FaultAnswer]) -> Tuple[str, str]:
    times_s = [a.after_s for a in answers if a.after_s is not None]
    silent = sum(a.after_s is None for a in answers)
    if not answers:
        return "–", "–"
    told = f"{median(times_s):.1f}, worst {max(times_s):.1f}" if times_s else ""
    never = f"{silent} without" if silent else ""
    moved_m = [a.moved_m for a in answers if a.hovered and a.after_s is not None]
    return "; ".join(t for t in (told, never) if t), f"worst {max(moved_m):.2f}" if moved_m else "–"


def _metres(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "–"

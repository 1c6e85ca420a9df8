# SPDX-License-Identifier: Apache-2.0
"""What the relays hold while the radio is cut again and again: memory, threads, open files and
sockets over time."""

import os
import time
from dataclasses import dataclass
from typing import Callable, Dict, List, Tuple

import numpy as np
import psutil

CUT_S, BETWEEN_S = 3.0, 25.0
SETTLE_S = 20.0
_SAMPLE_S = 60.0


@dataclass(frozen=True)
class Footprint:
    """Of one process at one time."""

    at_s: float
    memory_mb: float
    threads: int
    files: int
    sockets: int


FIGURES = (
    ("memory_mb", "memory", "MB"),
    ("threads", "threads", ""),
    ("files", "open files", ""),
    ("sockets", "sockets", ""),
)


def footprint(process: psutil.Process, at_s: float) -> Footprint:
    return Footprint(
        at_s,
        process.memory_info().rss / 1e6,
        process.num_threads(),
        process.num_fds(),
        _sockets(process),
    )


def endure(
    radio, relays: Dict[str, psutil.Process], minutes: float, say: Callable[[str], None]
) -> Tuple[Dict[str, List[Footprint]], int]:
    """Every relay's footprints, one before each cut, and how many cuts there were. Says one line a
    minute and relay."""
    series: Dict[str, List[Footprint]] = {m: [] for m in relays}
    begin_s, said_s, cuts = time.monotonic(), float("-inf"), 0
    while time.monotonic() - begin_s < 60 * minutes:
        time.sleep(BETWEEN_S)  # what a cut leaves behind for ten seconds is gone then
        at_s = time.monotonic() - begin_s
        for machine, process in relays.items():
            series[machine].append(footprint(process, at_s))
        if at_s - said_s >= _SAMPLE_S - 1.0:
            said_s = at_s
            for machine, prints in series.items():
                say(f"{at_s / 60:5.1f} min, relay of {machine}: {spell(prints[-1])}")
        radio.cut()
        time.sleep(CUT_S)
        radio.mend()
        cuts += 1
    return series, cuts


def spell(f: Footprint) -> str:
    return ", ".join(f"{name} {getattr(f, key):.0f} {unit}".rstrip() for key, name, unit in FIGURES)


def growth(series: List[Footprint]) -> str:
    """First and last of every figure, and how fast it grows in the second half: slope and its
    standard error."""
    half = [f for f in series if f.at_s >= series[-1].at_s / 2]
    parts = []
    for key, name, unit in FIGURES:
        first, last = getattr(series[0], key), getattr(series[-1], key)
        slope, error = per_hour([f.at_s for f in half], [getattr(f, key) for f in half])
        slope = round(slope, 1) + 0.0  # no "-0.0"
        parts.append(
            f"{name} {first:.0f} → {last:.0f}{' ' + unit if unit else ''} ({slope:+.1f} ± {error:.1f} an hour)"
        )
    return ", ".join(parts)


def per_hour(at_s: List[float], values: List[float]) -> Tuple[float, float]:
    """A straight line's slope and its standard error, per hour; three samples at least."""
    if len(at_s) < 3:
        return float("nan"), float("nan")
    (slope, _), covariance = np.polyfit(np.asarray(at_s) / 3600.0, values, 1, cov=True)
    return float(slope), float(np.sqrt(max(covariance[0, 0], 0.0)))


def _sockets(process: psutil.Process) -> int:
    count, folder = 0, f"/proc/{process.pid}/fd"
    for fd in os.listdir(folder):
        try:
            count += os.readlink(f"{folder}/{fd}").startswith("socket:")
        except OSError:
            continue  # closed meanwhile
    return count

# SPDX-License-Identifier: Apache-2.0
"""A search for flights in which vehicles come near to each other: kinds, moments and sizes of one or
two faults are varied by differential evolution (Storn and Price 1997), with one seed for all
else."""

import json
from pathlib import Path
from typing import Callable, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from scipy.optimize import differential_evolution

from fcsv_sim.errors import SimulationError
from fcsv_sim.rehearsal import draws
from fcsv_sim.rehearsal.draws import Draws

_DRAWS = 8  # of a fault: phase, moment, vehicle, and sizes
_POPULATION, _LEAST = 24, 5  # flights of a generation
_DIGITS = 3
_APART_M = 99.0  # of vehicles of which never two flew


class Varied(NamedTuple):
    """One or two faults (A+B), and their draws."""

    faults: str
    draws: Tuple[Draws, ...]


class Found(NamedTuple):
    """How near two vehicles came in a flight, and what broke."""

    nearest_m: float
    broke: Tuple[str, ...]


Fly = Callable[[List[Varied]], Iterable[Found]]


def search(
    kinds: Sequence[str], flights: int, seed: int, fly: Fly, log: Optional[Path] = None
) -> Dict[Varied, Found]:
    """Flies at most so many flights, in generations; what ``log`` holds of an earlier search with
    the same kinds and seed is not flown again.

    Raises SimulationError for fewer flights than a generation has, and where ``log`` is no log.
    """
    if flights < _LEAST:
        raise SimulationError(f"--search: {flights} flights are too few, {_LEAST} at least")
    known = _read(log)
    found: Dict[Varied, Found] = {}

    def generation(_nearest: Callable, vectors: Iterable[np.ndarray]) -> List[float]:
        varied = [_varied(kinds, vector) for vector in vectors]
        new = [v for v in dict.fromkeys(varied) if v not in known]
        for v, how in zip(new, fly(new)):
            known[v] = how
        _append(log, {v: known[v] for v in new})
        found.update({v: known[v] for v in varied})
        return [known[v].nearest_m for v in varied]

    size = min(_POPULATION, flights)
    numbers = 2 + 2 * _DRAWS
    differential_evolution(
        lambda _vector: _APART_M,  # ``generation`` flies
        [(0.0, 1.0)] * numbers,
        init=np.random.default_rng([seed, 31]).random((size, numbers)),
        maxiter=flights // size - 1,
        tol=0.0,
        polish=False,
        updating="deferred",
        workers=generation,
        seed=seed,
    )
    return found


def _varied(kinds: Sequence[str], vector: np.ndarray) -> Varied:
    """The first two numbers say which kinds; the same kind twice is one fault."""
    numbers = [round(float(v), _DIGITS) for v in vector]
    names = [kinds[min(len(kinds) - 1, int(v * len(kinds)))] for v in numbers[:2]]
    each = (tuple(numbers[2 : 2 + _DRAWS]), tuple(numbers[2 + _DRAWS :]))
    count = 1 if names[0] == names[1] else 2
    return Varied("+".join(names[:count]), each[:count])


def table(found: Dict[Varied, Found], seed: int, rows: int) -> List[str]:
    """Lines of a table of the flights in which vehicles came nearest, the worst first, each pair of
    faults once."""
    worst = sorted(found.items(), key=lambda each: each[1].nearest_m)
    by_faults: Dict[str, Tuple[Varied, Found]] = {}
    for varied, how in worst:
        by_faults.setdefault(varied.faults, (varied, how))
    heads = ("nearest (m)", "faults", "broke", "see it")
    lines = [heads, ("---",) * len(heads)]
    for varied, how in list(by_faults.values())[:rows]:
        again = f"--seed {seed} --faults '{varied.faults}' --draws '{draws.to_text(varied.draws)}'"
        nearest = f"{how.nearest_m:.2f}" if how.nearest_m < _APART_M else "–"
        lines.append((nearest, varied.faults, ", ".join(how.broke) or "–", f"`{again} --trace`"))
    return ["| " + " | ".join(cells) + " |" for cells in lines]


def found_in(nearest_m: float, broke: Iterable[str]) -> Found:
    """Of one flight."""
    return Found(min(nearest_m, _APART_M), tuple(dict.fromkeys(broke)))


def _read(log: Optional[Path]) -> Dict[Varied, Found]:
    if log is None or not log.exists():
        return {}
    try:
        told = [json.loads(line) for line in log.read_text().splitlines()]
        return {
            Varied(t["faults"], draws.from_text(t["draws"])): Found(
                t["nearest_m"], tuple(t["broke"])
            )
            for t in told
        }
    except (ValueError, KeyError, TypeError) as error:
        raise SimulationError(f"{log} is no log of a search: {error}; name another") from None


def _append(log: Optional[Path], found: Dict[Varied, Found]) -> None:
    if log is None:
        return
    with log.open("a") as file:
        for v, how in found.items():
            told = {"faults": v.faults, "draws": draws.to_text(v.draws), **how._asdict()}
            file.write(json.dumps(told) + "\n")

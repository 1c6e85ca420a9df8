# SPDX-License-Identifier: Apache-2.0
"""All faults by name, and which of them befall a flight of a given seed."""

import zlib
from itertools import combinations
from typing import Callable, Dict, List, Sequence, Tuple

import numpy as np

from fcsv_sim.errors import SimulationError
from fcsv_sim.rehearsal.board_faults import BOARD_FAULTS
from fcsv_sim.rehearsal.draws import ChosenDraws, Draws
from fcsv_sim.rehearsal.fault import Fault
from fcsv_sim.rehearsal.people_faults import PEOPLE_FAULTS
from fcsv_sim.rehearsal.tracker_faults import TRACKER_FAULTS

#: By name.
FAULTS: Dict[str, Callable[[np.random.Generator], Fault]] = {
    f.name: f for f in (*TRACKER_FAULTS, *BOARD_FAULTS, *PEOPLE_FAULTS)
}
NONE, ALL, PAIRS = "none", "all", "pairs"
_AND = "+"


def faults_of(names: str, seed: int) -> Tuple[str, ...]:
    """The faults of one flight. ``names``: none, all (single faults and pairs in turn), pairs, or
    names with commas, of which each may be a pair (A+B). Depends on the seed alone, so that a
    flight can be flown again by it.

    Raises SimulationError for a name that is not known.

    >>> faults_of("abort,radio cut+battery", 1)
    ('radio cut', 'battery')
    """
    if names == ALL:
        singles = [NONE, *FAULTS]
        return _pair(seed) if seed % 2 else _single(singles[seed // 2 % len(singles)])
    if names == PAIRS:
        return _pair(seed)
    listed = [_single(name.strip()) for name in names.split(",")]
    return listed[seed % len(listed)]


def make_faults(names: Sequence[str], seed: int, chosen: Sequence[Draws] = ()) -> List[Fault]:
    """The faults themselves; each draws from a source of its own, or first what was ``chosen`` for
    it."""
    sources = [np.random.default_rng([seed, 23, zlib.crc32(name.encode())]) for name in names]
    for k, draws in enumerate(chosen[: len(names)]):
        sources[k] = ChosenDraws(draws, sources[k])
    return [FAULTS[name](source) for name, source in zip(names, sources)]


def _pair(seed: int) -> Tuple[str, ...]:
    pairs = list(combinations(FAULTS, 2))
    return pairs[int(np.random.default_rng([seed, 29]).integers(len(pairs)))]


def _single(name: str) -> Tuple[str, ...]:
    if name == NONE:
        return ()
    for one in name.split(_AND):
        if one not in FAULTS:
            raise SimulationError(f"--faults: '{one}' is not one of {', '.join(FAULTS)}")
    return tuple(name.split(_AND))

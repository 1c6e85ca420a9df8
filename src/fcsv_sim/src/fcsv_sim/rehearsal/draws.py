# SPDX-License-Identifier: Apache-2.0
"""A fault's draws that somebody chose: when it begins, whom it befalls, and its sizes."""

from statistics import NormalDist
from typing import Optional, Sequence, Tuple

import numpy as np

from fcsv_sim.errors import SimulationError

Draws = Tuple[float, ...]  # of one fault, each 0..1
_NORMAL, _TAIL = NormalDist(), 1e-3


class ChosenDraws(np.random.Generator):
    """Gives chosen numbers (0..1) as its first draws, each stretched to what is asked for, then
    draws as ``source`` does.

    >>> chosen = ChosenDraws([0.25, 0.5, 0.99], np.random.default_rng(1))
    >>> chosen.uniform(2.0, 4.0), chosen.choice(["a", "b"]), int(chosen.integers(3))
    (2.5, 'b', 2)
    >>> chosen.random() == np.random.default_rng(1).random()
    True
    """

    def __init__(self, numbers: Sequence[float], source: np.random.Generator):
        super().__init__(source.bit_generator)
        self._left = list(numbers)

    def random(self, *args, **kwargs):
        return super().random(*args, **kwargs) if args or not self._left else self._left.pop(0)

    def uniform(self, low=0.0, high=1.0, size=None):
        if size is not None or not self._left:
            return super().uniform(low, high, size)
        return low + (high - low) * self._left.pop(0)

    def choice(self, a, *args, **kwargs):
        return a[self._index(len(a))] if self._left else super().choice(a, *args, **kwargs)

    def integers(self, low, high=None, *args, **kwargs):
        if not self._left:
            return super().integers(low, high, *args, **kwargs)
        first, count = (0, low) if high is None else (low, high - low)
        return first + self._index(count)

    def normal(self, loc=0.0, scale=1.0, size=None):
        if not isinstance(size, int) or len(self._left) < size:
            return super().normal(loc, scale, size)
        shares = [min(1.0 - _TAIL, max(_TAIL, self._left.pop(0))) for _ in range(size)]
        return loc + scale * np.array([_NORMAL.inv_cdf(share) for share in shares])

    def _index(self, count: int) -> int:
        return min(count - 1, int(self._left.pop(0) * count))


def to_text(draws: Sequence[Draws]) -> str:
    """Words of --draws: numbers with spaces, faults with commas.

    >>> to_text([(0.5, 0.25), (0.125,)]), from_text("0.5 0.25,0.125")
    ('0.5 0.25,0.125', ((0.5, 0.25), (0.125,)))
    """
    return ",".join(" ".join(f"{v:g}" for v in of_one) for of_one in draws)


def from_text(text: Optional[str]) -> Tuple[Draws, ...]:
    """Reads --draws. Raises SimulationError for what is no number from 0 to 1."""
    if not text:
        return ()
    try:
        draws = tuple(tuple(map(float, of_one.split())) for of_one in text.split(","))
    except ValueError:
        draws = ((-1.0,),)
    if not all(0.0 <= v <= 1.0 for of_one in draws for v in of_one):
        raise SimulationError(f"--draws: '{text}' are not numbers from 0 to 1, faults with commas")
    return draws

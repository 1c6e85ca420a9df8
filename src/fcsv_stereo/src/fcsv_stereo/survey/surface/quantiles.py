# SPDX-License-Identifier: Apache-2.0
"""Exact quantiles of numbers that are never in memory together: counts of the upper half of their
bits, then of the lower half of those that matter."""

from typing import Callable, Iterable, List, Sequence, Tuple

import numpy as np

_HALF = 1 << 16


def quantiles(blocks: Callable[[], Iterable[np.ndarray]], shares: Sequence[float]) -> np.ndarray:
    """(S,C) quantiles, as of ``np.quantile``, of each column of ``blocks`` (N,C) float32, which are
    gone through twice. NaN where there are no numbers.

    >>> quantiles(lambda: [np.float32([[3], [-1]]), np.float32([[2]])], (0.0, 0.5, 0.75)).ravel().tolist()
    [-1.0, 2.0, 2.5]
    """
    upper = sum(np.stack([_counts(k) for k in (_keys(b) >> 16).T]) for b in blocks())
    if np.ndim(upper) == 0 or not upper[0].sum():
        return np.full((len(shares), 1 if np.ndim(upper) == 0 else len(upper)), np.nan)
    at = np.asarray(shares, float) * (upper[0].sum() - 1)
    ranks = np.stack([np.floor(at), np.ceil(at)]).astype(int)  # (2,S)
    ends = np.cumsum(upper, axis=1)
    buckets = np.stack([np.searchsorted(e, ranks, side="right") for e in ends])  # (C,2,S)
    wanted: List[Tuple[int, int]] = [(c, b) for c, of in enumerate(buckets) for b in np.unique(of)]
    lower = {pair: np.zeros(_HALF, int) for pair in wanted}
    for block in blocks():
        keys = _keys(block)
        for c, b in wanted:
            column = keys[:, c]
            lower[c, b] += _counts(column[column >> 16 == b] & (_HALF - 1))
    found = np.empty(buckets.shape)
    for c, i, s in np.ndindex(buckets.shape):
        b = buckets[c, i, s]
        before = ends[c][b] - upper[c][b]
        low = np.searchsorted(np.cumsum(lower[c, b]), ranks[i, s] - before, side="right")
        found[c, i, s] = _value(int(b) << 16 | int(low))
    share = at - np.floor(at)
    first, second = found[:, 0], found[:, 1]
    apart = second - first  # as numpy does it, to the last bit
    return np.where(share < 0.5, first + apart * share, second - apart * (1.0 - share)).T


def _counts(values: np.ndarray) -> np.ndarray:
    return np.bincount(values, minlength=_HALF)


def _keys(block: np.ndarray) -> np.ndarray:
    """Whole numbers in the order of the float32 numbers."""
    bits = np.ascontiguousarray(block, np.float32).view(np.uint32)
    return np.where(bits >> 31, ~bits, bits | np.uint32(1 << 31))


def _value(key: int) -> float:
    bits = key & 0x7FFFFFFF if key >> 31 else ~key & 0xFFFFFFFF
    return float(np.uint32(bits).view(np.float32))

# SPDX-License-Identifier: Apache-2.0
"""Work on bands of a picture's rows by a pool of threads: kernels release the interpreter's
lock."""

from concurrent.futures import ThreadPoolExecutor
from typing import Callable, List, TypeVar

T = TypeVar("T")


def for_rows(
    pool: ThreadPoolExecutor, height: int, work: Callable[[int, int], T], rows: int = 32
) -> List[T]:
    """What ``work(y0, y1)`` returns for each band of at most ``rows`` rows, from the top down."""
    bands = [(y, min(y + rows, height)) for y in range(0, height, rows)]
    return list(pool.map(lambda band: work(*band), bands))

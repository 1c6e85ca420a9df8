# SPDX-License-Identifier: Apache-2.0
"""Durations as people read them."""

import math


def clock_words(seconds: float) -> str:
    """Minutes and seconds.

    >>> clock_words(75.2), clock_words(math.nan)
    ('1:15', '-')
    """
    if not math.isfinite(seconds):
        return "-"
    minutes, rest = divmod(int(max(seconds, 0.0)), 60)
    return f"{minutes}:{rest:02d}"

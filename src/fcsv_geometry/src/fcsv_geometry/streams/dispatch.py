# SPDX-License-Identifier: Apache-2.0
"""Which function takes a message: by its type, as ports are told everything through one door."""

from typing import Callable, Mapping


def by_type(takers: Mapping[type, Callable], message: object, refusal: str) -> Callable:
    """Gives the taker of a message. Raises TypeError that begins with ``refusal`` where its type
    has none.

    >>> by_type({int: abs}, -3, "a clock takes no")(-3)
    3
    >>> by_type({int: abs}, "noon", "a clock takes no")
    Traceback (most recent call last):
    TypeError: a clock takes no str
    """
    taker = takers.get(type(message))
    if taker is None:
        raise TypeError(f"{refusal} {type(message).__name__}")
    return taker

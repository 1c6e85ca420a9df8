# SPDX-License-Identifier: Apache-2.0
"""Which function takes a message: by its type, as ports are told everything through one door."""

from typing import Any, Callable, Dict, Mapping


class Takers(Dict[type, Callable[..., Any]]):
    """The takers of messages by their types; a type that has none raises TypeError, which begins
    with ``refusal``.

    >>> takers = Takers({int: abs}, "a clock takes no")
    >>> takers[type(-3)](-3)
    3
    >>> takers[type("noon")]
    Traceback (most recent call last):
    TypeError: a clock takes no str
    """

    def __init__(self, takers: Mapping[type, Callable[..., Any]], refusal: str):
        super().__init__(takers)
        self._refusal = refusal

    def __missing__(self, kind: type) -> Callable[..., Any]:
        raise TypeError(f"{self._refusal} {kind.__name__}")

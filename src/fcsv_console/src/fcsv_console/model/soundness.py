# SPDX-License-Identifier: Apache-2.0
"""What may be believed of a fact: numbers that are none, or are nonsense, are refused with a
reason."""

import dataclasses
import math
from typing import Any, Iterator

_MAY_BE_NAN = {
    "share",
    "voltage_v",
    "round_trip_s",
    "loss",
    "coverage",
    "error_px",
    "refined_px",
    "surprise",
    "picture_focal_px",
}  # not known
_MAY_BE_INFINITE = {"minutes_left"}
_FARTHEST_M = 1e5


def unsound(fact: Any) -> str:
    """Why a fact cannot be used; "" where it can.

    >>> from fcsv_console.model.facts import OdometryReport
    >>> unsound(OdometryReport("uav1", (0.0, float("nan"), 1.0)))
    'p_odom_m holds nan'
    """
    for field in dataclasses.fields(fact):
        value = getattr(fact, field.name)
        for number in _flat(value):
            if isinstance(number, float) and not _fine(field.name, number):
                return f"{field.name} holds {number:g}"
    share = getattr(fact, "share", math.nan)
    return (
        f"share is {share:g}, not in 0..1"
        if not math.isnan(share) and not 0.0 <= share <= 1.0 + 1e-6
        else ""
    )


def _flat(value: Any) -> Iterator[Any]:
    """A value, or those of a tuple, of tuples in it too."""
    if isinstance(value, tuple):
        for part in value:
            yield from _flat(part)
    else:
        yield value


def _fine(name: str, number: float) -> bool:
    if math.isnan(number):
        return name in _MAY_BE_NAN
    if math.isinf(number):
        return name in _MAY_BE_INFINITE
    return not name.endswith("_m") or abs(number) < _FARTHEST_M

# SPDX-License-Identifier: Apache-2.0
"""When simulated cameras take pictures: in phase by the clock that machines share, as a common
trigger does it."""

import math

# of a period: a stamp that floating point left just before its moment is of that moment
_EARLY = 1e-6


def newest(now_s: float, rate_hz: float) -> float:
    """The newest common moment that is not after now: a whole number of periods since the clock's
    zero.

    >>> [newest(t, 4.0) for t in (10.0, 10.2, 10.25, 10.49)]
    [10.0, 10.0, 10.25, 10.25]
    """
    return math.floor(now_s * rate_hz + _EARLY) / rate_hz


def after(stamp_s: float, rate_hz: float) -> float:
    """The first common moment after a stamp.

    >>> after(10.25, 4.0), after(10.3, 4.0)
    (10.5, 10.5)
    """
    return (math.floor(stamp_s * rate_hz + _EARLY) + 1) / rate_hz

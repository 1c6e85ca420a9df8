# SPDX-License-Identifier: Apache-2.0
"""Stamps against the clock: one that lies ahead never grows old, so that nothing may rest on it."""

#: A stamp may be so far (s) ahead of now: messages of other computers, whose clocks are set.
AHEAD_S = 0.2


def ahead_of_clock(now_s: float, stamp_s: float, bound_s: float = AHEAD_S) -> str:
    """How far a stamp lies ahead of now, and what to do; empty where that is within ``bound_s``.

    >>> ahead_of_clock(10.0, 1007.0), ahead_of_clock(10.0, 10.1)
    ("is 997.0 s ahead of this computer's clock: set the clocks (chrony)", '')
    """
    return _off(stamp_s - now_s, bound_s, "ahead of")


def behind_clock(now_s: float, stamp_s: float, bound_s: float) -> str:
    """How far a stamp lies behind now, and what to do; empty where that is within ``bound_s``.

    >>> behind_clock(100.0, 40.0, 5.0), behind_clock(100.0, 99.0, 5.0)
    ("is 60.0 s behind this computer's clock: set the clocks (chrony)", '')
    """
    return _off(now_s - stamp_s, bound_s, "behind")


def _off(off_s: float, bound_s: float, side: str) -> str:
    if not off_s > bound_s:
        return ""
    return f"is {off_s:.1f} s {side} this computer's clock: set the clocks (chrony)"

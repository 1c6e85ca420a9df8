# SPDX-License-Identifier: Apache-2.0
"""Memory as small as what is used: Zenoh's threads come and go with every cut and leave their heaps in pieces.

glibc gives every thread a heap and keeps what is free; where the C library is another one, nothing is done here.
"""

import ctypes

_ARENA_MAX = -8  # M_ARENA_MAX of malloc.h
_HEAPS = 2


def few_heaps() -> bool:
    """What the threads before a cut left behind is used again by those after it. Call before threads begin."""
    return bool(_call("mallopt", _ARENA_MAX, _HEAPS))


def give_back() -> bool:
    """Free memory goes back to the system, also from between what is used. Takes some milliseconds."""
    return bool(_call("malloc_trim", 0))


def _call(function: str, *arguments: int) -> int:
    try:
        return getattr(ctypes.CDLL(None), function)(*arguments)
    except AttributeError:
        return 0

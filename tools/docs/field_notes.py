# SPDX-License-Identifier: Apache-2.0
"""The comments that say what the fields of a dataclass are: beside a field, or on lines of their own above it."""

import inspect
import re
from typing import Dict

_FIELD = re.compile(r"^    (\w+): (.*)$")
_BESIDE = re.compile(r"  # (?!noqa|type:)(.+)$")
_ABOVE = re.compile(r"^    # (.+)$")


def notes_of(cls) -> Dict[str, str]:
    """Gives, by field, its comment; fields without one are left out. Empty where the source is not to be had."""
    try:
        source = inspect.getsource(cls)
    except (OSError, TypeError):
        return {}
    return notes_in(source)


def notes_in(source: str) -> Dict[str, str]:
    """Gives the comments of a class's ``source``.

    >>> notes_in("class A:\\n    # on two\\n    # lines\\n    a: int = 1\\n    b: int = 2  # beside\\n")
    {'a': 'on two lines', 'b': 'beside'}
    """
    found, above = {}, []
    for line in source.splitlines():
        comment, field = _ABOVE.match(line), _FIELD.match(line)
        if field:
            beside = _BESIDE.search(field.group(2))
            note = beside.group(1) if beside else " ".join(above)
            if note:
                found[field.group(1)] = note
        above = [*above, comment.group(1)] if comment else []
    return found

# SPDX-License-Identifier: Apache-2.0
"""Choices among a few, which files, messages and command lines spell as words."""

from enum import Enum

from fcsv_stereo.errors import InputError


class Word(str, Enum):
    """A member is its word: it equals it, prints as it and is written to files as it.

    ``Axis("vertical")`` is the way from a word to a member; it raises InputError where it is none.
    """

    def __str__(self) -> str:
        return str(self.value)

    @classmethod
    def _missing_(cls, value):
        raise InputError(
            f"{cls.__name__}: '{value}' is not one of {', '.join(m.value for m in cls)}"
        )


class Axis(Word):
    """Names the direction of a baseline, in the reference's image plane."""

    HORIZONTAL = "horizontal"
    VERTICAL = "vertical"

    @property
    def coordinate(self) -> int:
        """Says which coordinate it is of a picture or a point: 0 (x: columns differ) or 1 (y: rows
        differ)."""
        return 0 if self is Axis.HORIZONTAL else 1


class InputKind(Word):
    """Names the kind of a map's input: a session (home is level, cameras are nearly parallel) or
    photographs (any poses)."""

    SESSION = "session"
    PHOTOGRAPHS = "photographs"


#: the words of Axis, for command lines and files
AXES = tuple(a.value for a in Axis)

# SPDX-License-Identifier: Apache-2.0
"""Which pictures of a recording are matched (thesis 5.4): the answer to poses and pictures not
quite in step."""

from dataclasses import dataclass
from typing import List, Sequence, Tuple

from fcsv_stereo.model import ConfigurationInput, Picture


@dataclass(frozen=True)
class SelectionOptions:
    """The buffer ends after ``buffer_s`` or ``buffer_pictures``, whichever is first; the reference
    is the picture in the middle of the last ``saved_s`` of it, and others within ``bracket_s`` of
    that one are tried."""

    buffer_s: float = 5.0
    buffer_pictures: int = 30
    saved_s: float = 3.0
    bracket_s: float = 0.5

    def __post_init__(self):
        if not (
            self.buffer_s > 0
            and self.buffer_pictures >= 1
            and self.saved_s > 0
            and self.bracket_s >= 0
        ):
            raise ValueError(f"selection: {self} holds a number that is not positive")


def buffered(pictures: Sequence[Picture], options: SelectionOptions) -> List[Picture]:
    """Keeps, of a recording in order of time, what the buffer kept: at least one picture where
    there is one."""
    end_s = pictures[0].stamp_s + options.buffer_s if pictures else 0.0
    return [p for p in pictures if p.stamp_s <= end_s][: options.buffer_pictures]


def select(given: ConfigurationInput, options: SelectionOptions) -> Tuple[Picture, List[Picture]]:
    """The reference picture, and the other camera's that are tried against it (the best match rate
    wins).

    5.4 speaks of "the middle of the 3 seconds time saved" of a buffer of 5 s: the vehicle has just
    arrived when it begins, so the saved time is taken as its last 3 s. Shorter recordings are used
    whole. Where no other picture lies in the bracket, the nearest in time is tried alone.
    """
    references = buffered(given.references, options)
    end_s = references[-1].stamp_s
    start_s = max(references[0].stamp_s, end_s - options.saved_s)
    middle_s = (start_s + end_s) / 2.0
    reference = min(references, key=lambda p: abs(p.stamp_s - middle_s))
    near = [p for p in given.others if abs(p.stamp_s - reference.stamp_s) <= options.bracket_s]
    return reference, near or [min(given.others, key=lambda p: abs(p.stamp_s - reference.stamp_s))]

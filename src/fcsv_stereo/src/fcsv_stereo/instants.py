# SPDX-License-Identifier: Apache-2.0
"""Pictures of one instant: which pictures of several cameras were taken together, and how far apart
they were.

Cameras that run freely are apart by up to half a period; those with a common trigger are not, but
each may miss some.
"""

from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence

from fcsv_stereo.errors import InputError
from fcsv_stereo.model.inputs import ConfigurationInput, MapInput
from fcsv_stereo.model.pictures import Picture
from fcsv_stereo.model.words import InputKind

MOST_SKEW_S = 0.020  # what walks moves by 3 cm, a car in a street by 0.3 m
_NEAR_S = 1.0  # a stamp that a user reads off a list is of that recording


@dataclass(frozen=True)
class Instant:
    """Configurations with one picture of each camera: the reference's, the same in all, and the
    others' nearest to it.

    ``skew_s``: between the reference's picture and the one furthest from it in time.
    """

    configurations: List[ConfigurationInput]
    skew_s: float

    @property
    def reference(self) -> Picture:
        """The reference camera's picture."""
        return self.configurations[0].references[0]


def skew_s(references: Sequence[Picture], other: Picture) -> float:
    """Between a picture and the reference camera's nearest in time (s); infinite without one."""
    return min((abs(r.stamp_s - other.stamp_s) for r in references), default=float("inf"))


def middle(configuration: ConfigurationInput) -> Picture:
    """The other camera's picture of the recording's middle: of those with a reference picture of
    their instant, if any.

    What moved is seen by the reference camera in that instant.
    """
    numbered = list(enumerate(configuration.others))
    together = [
        (k, o) for k, o in numbered if skew_s(configuration.references, o) <= MOST_SKEW_S
    ] or numbered
    return min(together, key=lambda entry: abs(entry[0] - len(numbered) // 2))[1]


def at_once(configurations: Sequence[ConfigurationInput]) -> List[List[ConfigurationInput]]:
    """The configurations in groups, in order: in a group each was recorded while the first of it
    was."""
    groups: List[List[ConfigurationInput]] = []
    for c in configurations:
        stamps = {p.stamp_s for p in c.references}
        if groups and stamps & {p.stamp_s for p in groups[-1][0].references}:
            groups[-1].append(c)
        else:
            groups.append([c])
    return groups


def instants(group: Sequence[ConfigurationInput]) -> List[Instant]:
    """One for each picture that the reference camera took in all recordings of a group, in order of
    time."""
    shared = set.intersection(*({p.name for p in c.references} for c in group))
    found = []
    for reference in (p for p in group[0].references if p.name in shared):
        nearest = [min(c.others, key=lambda o: abs(o.stamp_s - reference.stamp_s)) for c in group]
        chosen = [replace(c, references=[reference], others=[o]) for c, o in zip(group, nearest)]
        found.append(Instant(chosen, max(abs(o.stamp_s - reference.stamp_s) for o in nearest)))
    return found


def of_one_instant(given: MapInput, stamp_s: Optional[float] = None) -> MapInput:
    """The input of one instant: the one nearest to ``stamp_s``, or of the middle of the last
    recording.

    Raises InputError where the cameras took no pictures within MOST_SKEW_S of each other, or
    nothing was recorded at that time.
    """
    if given.kind is not InputKind.SESSION:
        raise InputError("--instant is for sessions: photographs do not say when they were taken")
    groups = at_once(given.configurations)
    group = (
        groups[-1] if stamp_s is None else min(groups, key=lambda g: _from_recording_s(g, stamp_s))
    )
    off_s = 0.0 if stamp_s is None else _from_recording_s(group, stamp_s)
    if off_s > _NEAR_S:
        raise InputError(f"--instant {stamp_s:.3f}: the nearest picture is {off_s:.1f} s off")
    candidates = instants(group)
    together = [i for i in candidates if i.skew_s <= MOST_SKEW_S]
    if not together:
        least = min((i.skew_s for i in candidates), default=float("inf"))
        raise InputError(
            f"no pictures of one instant: the nearest are {1e3 * least:.0f} ms apart, at most {1e3 * MOST_SKEW_S:.0f} "
            "are wanted; record at a higher rate, or trigger the cameras together"
        )
    chosen = together[len(together) // 2]
    if stamp_s is not None:
        chosen = min(together, key=lambda i: abs(i.reference.stamp_s - stamp_s))
    return replace(given, configurations=chosen.configurations)


def _from_recording_s(group: Sequence[ConfigurationInput], stamp_s: float) -> float:
    """How far a stamp is from the nearest picture of the reference camera."""
    return min(abs(p.stamp_s - stamp_s) for p in group[0].references)


def skews(given: MapInput) -> Dict[str, float]:
    """Gives, by name of the other cameras' pictures: how far (s) the reference camera's nearest is.
    Empty for photographs."""
    if given.kind is not InputKind.SESSION:
        return {}
    return {o.name: skew_s(c.references, o) for c in given.configurations for o in c.others}

# SPDX-License-Identifier: Apache-2.0
"""Every picture of a map: what it was for, how far refinement moved it, whether the map rests on
it, and why not."""

from dataclasses import asdict, dataclass
from typing import Dict, List, Optional, Sequence, Tuple

from fcsv_stereo.model import ImageEntry, MapInput, MapResult


@dataclass(frozen=True)
class PictureUse:
    """``role``: "reference" or "other"; ``configurations`` are those that it was matched for.
    ``why_not`` is None where the map rests on it. ``turned_deg`` and ``moved_m`` lie between its
    pose before and after refinement."""

    name: str
    vehicle: str
    stamp_s: float
    role: str
    configurations: Tuple[str, ...]
    refined: bool
    turned_deg: float
    moved_m: float
    used: bool
    why_not: Optional[str]

    def to_dict(self) -> dict:
        """Gives the entry for report.json."""
        return {**asdict(self), "configurations": list(self.configurations)}


def picture_list(result: MapResult) -> List[PictureUse]:
    """Pictures that the method looked at, the map's reference first, then in the order of the
    input."""
    return [
        _use(i, result)
        for i in sorted(result.images, key=lambda i: i.name != result.reference.name)
    ]


def spare(given: MapInput, result: MapResult) -> Dict[str, int]:
    """Counts, by vehicle, how many pictures of the recordings the map did not need: one of each
    recording is enough."""
    looked_at, counts = {i.name for i in result.images}, {}
    for name, vehicle in {
        p.name: p.vehicle for c in given.configurations for p in (*c.references, *c.others)
    }.items():
        if name not in looked_at:
            counts[vehicle] = counts.get(vehicle, 0) + 1
    return counts


def _use(image: ImageEntry, result: MapResult) -> PictureUse:
    matched = [
        p.configuration.name for p in result.pairs if image.name in (p.reference_name, p.other_name)
    ]
    role = "reference" if image.name in _references(result) else "other"
    used = image.left_out is None
    return PictureUse(
        image.name,
        image.vehicle,
        image.stamp_s,
        role,
        tuple(matched),
        image.refined,
        image.turned_deg,
        image.moved_m,
        used,
        image.left_out,
    )


def _references(result: MapResult) -> Sequence[str]:
    return [result.reference.name, *(p.reference_name for p in result.pairs)]

# SPDX-License-Identifier: Apache-2.0
"""Names by which a person tells pictures apart: vehicle, configuration and number, not a stamp of
ten digits."""

from dataclasses import replace
from datetime import datetime, timezone
from typing import Dict, List

from fcsv_stereo.model import ImageEntry, MapResult, Pair

_LEAST_DATE_S = 1e9  # stamps below it are no Unix time: of a simulation, or numbers of photographs


def picture_names(result: MapResult) -> Dict[str, str]:
    """Gives, by the names of a session's pictures (VEHICLE/STAMP), what the report calls them;
    other pictures keep theirs."""
    groups: Dict[str, List[ImageEntry]] = {}
    for image in sorted(result.images, key=lambda i: i.stamp_s):
        if image.name == f"{image.vehicle}/{image.stamp_s:.3f}":
            groups.setdefault(_group(image, result), []).append(image)
    names = {}
    for group, images in groups.items():
        for number, image in enumerate(images, 1):
            names[image.name] = group if len(images) == 1 else f"{group}, {number}"
    return names


def _group(image: ImageEntry, result: MapResult) -> str:
    if image.name == result.reference.name:
        return f"{image.vehicle}, reference"
    for p in result.pairs:
        if image.name in (p.other_name, p.reference_name, *(name for name, _ in p.candidates)):
            return f"{image.vehicle}, {p.configuration.name}"
    return f"{image.vehicle}, of no pair"


def named(result: MapResult) -> MapResult:
    """The result with these names everywhere, in the sentences of its warnings too."""
    names = picture_names(result)
    if not names:
        return result

    def of(name: str) -> str:
        return names.get(name, name)

    def renamed(text: str) -> str:
        for name in sorted(names, key=len, reverse=True):
            text = text.replace(name, names[name])
        return text

    return replace(
        result,
        reference=replace(result.reference, name=of(result.reference.name)),
        images=[
            replace(i, name=of(i.name), left_out=i.left_out and renamed(i.left_out))
            for i in result.images
        ],
        pairs=[_NamedPair(p, names) for p in result.pairs],
        warnings=[renamed(w) for w in result.warnings],
        unseen=[renamed(u) for u in result.unseen],
        watched=[of(name) for name in result.watched],
        skews_s={of(name): skew for name, skew in result.skews_s.items()},
    )


class _NamedPair:
    """A pair whose pictures have other names; all else is the pair's own, made when it is looked
    at."""

    def __init__(self, pair: Pair, names: Dict[str, str]):
        self._pair = pair
        self.reference_name = names.get(pair.reference_name, pair.reference_name)
        self.other_name = names.get(pair.other_name, pair.other_name)
        self.candidates = [(names.get(name, name), rate) for name, rate in pair.candidates]

    def __getattr__(self, name: str):
        return getattr(self._pair, name)


def are_photographs(result: MapResult) -> bool:
    """Whether no vehicle took the pictures: each is by a camera of its own (``colmap``)."""
    return all(i.vehicle in ("camera", i.name) for i in result.images)


def time_of(stamp_s: float) -> str:
    """A stamp as UTC where it is a Unix time, else in seconds.

    >>> time_of(1795759387.25), time_of(12.5)
    ('2026-11-27 06:03:07.250 UTC', '12.500 s')
    """
    if stamp_s < _LEAST_DATE_S:
        return f"{stamp_s:.3f} s"
    at = datetime.fromtimestamp(round(stamp_s, 3), timezone.utc)
    return f"{at:%Y-%m-%d %H:%M:%S}.{at.microsecond // 1000:03d} UTC"

# SPDX-License-Identifier: Apache-2.0
"""What is shown of pictures: each camera's newest one with its tags, the map's reference picture
under its depth."""

import math
from dataclasses import dataclass
from typing import Dict, Optional, Sequence, Tuple

import numpy as np

from fcsv_console.model import facts as f
from fcsv_console.model.hearing import Aged

Outline = Tuple[Tuple[float, float], ...]
# tags are found in every picture, previews are one in some: an outline of another moment is left
# out
_TOGETHER_S = 0.2
_CAMERA = "camera/color/image_raw/compressed"
_OPACITY = 0.6
REFERENCE, DEPTH = "reference", "depth"
#: Of viridis at 0, 1/4, 1/2, 3/4 and 1, which colour-blind people read as one scale.
_SCALE = np.array(
    [(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)], float
)


@dataclass(frozen=True)
class CameraPicture:
    """``outlines``: of the tags in it, ``ids`` beside; ``problem``: why the newest one cannot be
    shown."""

    vehicle: str
    picture: Aged[f.PreviewReport]
    outlines: Tuple[Outline, ...] = ()
    ids: Tuple[int, ...] = ()
    problem: str = ""

    @property
    def empty(self) -> str:
        """Why there is no picture to show; "" where there is one."""
        if self.problem or self.picture.value is not None:
            return ""
        return f"No picture of {self.vehicle} was heard yet: one comes every second once its camera and its radio run"

    @property
    def words(self) -> str:
        """Vehicle, rate, age, tags."""
        if self.problem:
            return f"{self.vehicle}: {self.problem}"
        if self.picture.value is None:
            return f"{self.vehicle}: no picture was heard"
        rate = (
            f"STOPPED {self.picture.words} ago"
            if self.picture.stale
            else f"{self.picture.rate_hz:.1f} Hz, {self.picture.age_s:.1f} s old"
        )
        tags = f", tag {', '.join(str(i) for i in self.ids)}" if self.ids else ""
        return f"{self.vehicle}: {rate}{tags}"


@dataclass(frozen=True)
class MapPictures:
    """``reference`` and ``depth`` of one size, or None; ``match``: share (0..1) of it with a depth,
    NaN: not known; ``state``: what the live map said last, "" where none is heard."""

    reference: Optional[f.MapPicture] = None
    depth: Optional[f.MapPicture] = None
    match: float = math.nan
    problem: str = ""
    state: str = ""

    @property
    def empty(self) -> str:
        """Why there is no picture to show; "" where there is one."""
        if self.problem or self.reference is not None:
            return ""
        if not self.state:
            return "No map grows in this flight: the live map does not run (live:=true, LIVE=1 starts it)"
        return (
            f"The map begins with the first configuration that is recorded (live map: {self.state})"
        )

    @property
    def words(self) -> str:
        """What is shown, and how much of it has a depth."""
        if self.problem:
            return f"map: {self.problem}"
        if self.reference is None:
            return "map: no reference picture yet"
        return "map: no depth yet" if self.depth is None else f"map: {self.match:.0%} have a depth"


class NewestPictures:
    """Keeps the newest of each; what cannot be shown is named until a good one comes."""

    def __init__(self) -> None:
        self._tags: Dict[str, f.TagReport] = {}
        self._map: Dict[str, f.MapPicture] = {}
        self._problems: Dict[Tuple[str, str], str] = {}
        self._match, self._state = math.nan, ""

    def tell(self, fact: f.Fact) -> None:
        """A fact that was found sound, or one that could not be used."""
        if isinstance(fact, f.Unusable):
            if fact.topic == _CAMERA or fact.topic.startswith("/map/"):
                self._problems[(fact.vehicle, fact.topic)] = fact.why
        elif isinstance(fact, f.PreviewReport):
            self._problems.pop((fact.vehicle, _CAMERA), None)
        elif isinstance(fact, f.TagReport):
            self._tags[fact.vehicle] = fact
        elif isinstance(fact, f.MapReport):
            self._state = f"{fact.state}: {fact.detail}".rstrip(": ")
        elif isinstance(fact, f.MapPicture):
            self._problems.pop(("", f"/map/{fact.kind}"), None)
            self._map[fact.kind] = fact
            self._match = match_rate(self._map.get(DEPTH))

    def cameras(
        self, heard: Sequence[Tuple[str, Aged[f.PreviewReport]]]
    ) -> Tuple[CameraPicture, ...]:
        """Gives the pictures of every vehicle."""
        return tuple(self._camera(name, picture) for name, picture in heard)

    def _camera(self, name: str, picture: Aged[f.PreviewReport]) -> CameraPicture:
        tags, problem = self._tags.get(name), self._problems.get((name, _CAMERA), "")
        if (
            tags is None
            or picture.value is None
            or abs(tags.stamp_s - picture.value.stamp_s) > _TOGETHER_S
        ):
            return CameraPicture(name, picture, problem=problem)
        return CameraPicture(name, picture, tags.corners_px, tags.ids, problem)

    def map(self) -> MapPictures:
        """Gives the pictures as the live map told it last."""
        problem = "; ".join(
            why for (_, topic), why in self._problems.items() if topic.startswith("/map/")
        )
        reference, depth = self._map.get(REFERENCE), self._map.get(DEPTH)
        if (
            reference
            and depth
            and (reference.width, reference.height) != (depth.width, depth.height)
        ):
            sizes = [f"{p.width} x {p.height}" for p in (depth, reference)]
            return MapPictures(
                reference, problem=f"depth is {sizes[0]}, its picture {sizes[1]}", state=self._state
            )
        return MapPictures(reference, depth, self._match, problem, self._state)


def pixels(picture: f.MapPicture) -> np.ndarray:
    """(height, width, 3) uint8 of a reference, (height, width) float32 of a depth."""
    if picture.kind == DEPTH:
        return np.frombuffer(picture.data, "<f4").reshape(picture.height, picture.width)
    return np.frombuffer(picture.data, np.uint8).reshape(picture.height, picture.width, 3)


def match_rate(depth: Optional[f.MapPicture]) -> float:
    """Share (0..1) of the pixels with a depth; NaN without a picture."""
    if depth is None or not depth.data:
        return math.nan
    return float(np.isfinite(pixels(depth)).mean())


def overlaid(reference: np.ndarray, depth: Optional[np.ndarray]) -> np.ndarray:
    """(H, W, 3) uint8: the picture in grey, near things yellow and far ones violet over it, by
    their order in depth."""
    if depth is None:
        return reference
    grey = reference.astype(float).mean(axis=2, keepdims=True) * np.ones(3)
    known = np.isfinite(depth) & (depth > 0.0)
    if not known.any():
        return grey.astype(np.uint8)
    near, far = np.percentile(1.0 / depth[known], (98.0, 2.0))
    share = np.clip((1.0 / depth[known] - far) / max(near - far, 1e-9), 0.0, 1.0) * (
        len(_SCALE) - 1
    )
    at = np.arange(len(_SCALE))
    colours = np.stack([np.interp(share, at, _SCALE[:, k]) for k in range(3)], axis=1)
    grey[known] = (1.0 - _OPACITY) * grey[known] + _OPACITY * colours
    return grey.astype(np.uint8)

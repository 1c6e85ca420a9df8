# SPDX-License-Identifier: Apache-2.0
"""What cameras on the ground see, as drawn from above (thesis figure 5.6): the mocap's, and the
gimbals'."""

from dataclasses import dataclass
from typing import Dict, Tuple

import cv2
import numpy as np

from fcsv_console.model import facts as f
from fcsv_console.model.hearing import AgingFact, slow


@dataclass(frozen=True)
class GroundView:
    """``vehicle``: whom a gimbal follows, "" of a mocap; ``outline_m``: from above, corners (x, y)
    in home in order."""

    vehicle: str
    eye_m: Tuple[float, float]
    outline_m: Tuple[Tuple[float, float], ...]

    @property
    def words(self) -> str:
        return f"gimbal of {self.vehicle}" if self.vehicle else "mocap"


class GroundViews:
    """The newest of each camera. What is not heard any more is not shown: nobody knows where a
    gimbal looks then."""

    def __init__(self):
        self._heard: Dict[str, AgingFact[f.SeenFrom]] = {}

    def tell(self, now_s: float, fact: f.SeenFrom) -> None:
        self._heard.setdefault(fact.gimbal_of, slow()).tell(now_s, fact, fact.age_s)

    def shown(self, now_s: float) -> Tuple[GroundView, ...]:
        """Gives the views of this moment, by name."""
        now = [(name, heard.at(now_s)) for name, heard in sorted(self._heard.items())]
        return tuple(
            GroundView(name, aged.value.eye_m[:2], outline(aged.value))
            for name, aged in now
            if not aged.stale
        )


def outline(seen: f.SeenFrom) -> Tuple[Tuple[float, float], ...]:
    """The pyramid of ``seen`` from above: its convex hull.

    >>> level = f.SeenFrom("", (0.0, 0.0, 1.0), ((2.0, 1.0, 2.0), (2.0, -1.0, 2.0), (2.0, -1.0, 0.0), (2.0, 1.0, 0.0)))
    >>> sorted(outline(level))
    [(0.0, 0.0), (2.0, -1.0), (2.0, 1.0)]
    """
    points = np.array([p[:2] for p in (seen.eye_m, *seen.corners_m)], np.float32)
    return tuple((float(x), float(y)) for x, y in cv2.convexHull(points)[:, 0])

# SPDX-License-Identifier: Apache-2.0
"""The pictures of a joint match: which serve, and what is known of them at a stage."""

from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_stereo.joint.tuning import MATCH, NO_BASELINE_M
from fcsv_stereo.joint.views import Views, grey, nearest_in_view, views
from fcsv_stereo.model import Picture, PoseUncertainty

Exposure = Tuple[float, float]
_LEAST_SIDE_PX = 16  # windows of 9 px have no room in less


@dataclass(frozen=True)
class MatchPictures:
    """The reference and those that are matched with it.

    ``exposures`` are by each picture, the reference's first, the gain and offset that make its grey
    like the reference's, None before they are known. Grey pictures are made when they are needed:
    large ones are as large as all else. ``covariances`` (6x6; rad in camera axes, m in home's) are
    those of the others' poses, None where not given. ``prior`` is what poses may be adjusted by;
    None where they are taken as they are. ``pixel_errors``: see ``adjust``.
    """

    reference: Picture
    others: List[Picture]
    exposures: List[Optional[Exposure]]
    covariances: List[Optional[np.ndarray]]
    prior: Optional[List[np.ndarray]] = None
    pixel_errors: Optional[List[Optional[np.ndarray]]] = None

    @classmethod
    def of(
        cls,
        reference: Picture,
        others: List[Picture],
        poses: Optional[Sequence[PoseUncertainty]],
        adjust_poses: bool,
    ) -> "MatchPictures":
        """``poses`` may be None: then none is adjusted."""
        noise = [p.noise for p in poses] if poses else [None] * len(others)
        pixel = [p.pixel for p in poses] if poses else [None] * len(others)
        prior = noise if adjust_poses and poses else None
        return cls(reference, others, [None] * (1 + len(others)), noise, prior, pixel)

    def views(self, scale: float) -> Views:
        """Makes the views at ``scale`` of the full size."""
        return views(
            self.reference, self.others, scale, map(self.grey, range(1 + len(self.others)))
        )

    def grey(self, i: int) -> np.ndarray:
        """HxW float32 at full size of picture i, 0: the reference; exposures made alike."""
        image, exposure = grey((self.reference, *self.others)[i]), self.exposures[i]
        return image if exposure is None else exposure[0] * image + exposure[1]

    @property
    def shape(self) -> Tuple[int, int]:
        """Gives the size of the reference."""
        return self.reference.image.shape[:2]

    def posed(self, others: List[Picture], covariances: List[np.ndarray]) -> "MatchPictures":
        """The same pictures with other poses."""
        return replace(self, others=others, covariances=covariances)


def usable(reference: Picture, others: Sequence[Picture]) -> Tuple[List[int], Dict[int, str]]:
    """Indices of the pictures that see something of the reference's from another place, and why
    others do not."""
    left_out: Dict[int, str] = {}
    for i, other in enumerate(others):
        baseline_m = float(np.linalg.norm(other.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]))
        if min(*reference.image.shape[:2], *other.image.shape[:2]) < _LEAST_SIDE_PX:
            left_out[i] = (
                f"{other.name} or {reference.name} is smaller than {_LEAST_SIDE_PX} px: nothing to match"
            )
        elif baseline_m < NO_BASELINE_M:
            left_out[i] = (
                f"{other.name} and {reference.name} were taken from one place: no baseline"
            )
    some = [i for i in range(len(others)) if i not in left_out]
    if some:
        pictures = [others[i] for i in some]
        # no precision is asked for: the rough match's size will do
        scale = MATCH.largest_volume / 2.0
        found = views(reference, pictures, scale, map(grey, (reference, *pictures)))
        for i, nearest in zip(some, nearest_in_view(found)):
            if nearest <= 0.0:
                left_out[i] = f"{others[i].name} does not overlap {reference.name}"
    return [i for i in range(len(others)) if i not in left_out], dict(sorted(left_out.items()))

# SPDX-License-Identifier: Apache-2.0
"""One picture's tags and all that is needed to see the body in them: looked at without the tracker,
and its lock."""

from dataclasses import dataclass
from typing import Mapping, Optional, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.config import BodyTag
from fcsv_tracking.gimbal.geometry import Angles
from fcsv_tracking.gimbal.pose import AMBIGUOUS, BodySight, PoseRules, locate_body
from fcsv_tracking.tags import TagObservation


@dataclass(frozen=True)
class TagPicture:
    """What the tracker knew when the picture came; G ground robot, C gimbal camera, D body."""

    stamp_s: float
    own: Sequence[TagObservation]  # of the vehicle's own tags
    angles: Angles
    rates_radps: np.ndarray  # (2,) of pan and tilt
    T_G_C: np.ndarray
    R_cam_body_before: Optional[np.ndarray]  # by the last pose, None where that is too old
    blur_px: float

    @property
    def turning_radps(self) -> float:
        """Gives the rate of the faster joint."""
        return float(np.max(np.abs(self.rates_radps)))


@dataclass(frozen=True)
class Seen:
    """T_G_D and the sight it comes from; where none can be trusted, why, and T_G_D if it is good
    enough to follow."""

    T_G_D: Optional[np.ndarray]
    sight: Optional[BodySight] = None
    rejected: Optional[SampleRejected] = None


def find_body(
    picture: TagPicture, tags: Mapping[int, BodyTag], focal_px: float, rules: PoseRules
) -> Seen:
    """The body in one picture; takes milliseconds, and changes nothing."""
    try:
        sight = locate_body(
            picture.own, tags, focal_px, rules, picture.R_cam_body_before, picture.blur_px
        )
    except SampleRejected as error:
        attitude_alone = error.reason == AMBIGUOUS  # the place is good enough to follow
        return Seen(
            picture.T_G_C @ _rough(picture.own, tags) if attitude_alone else None, rejected=error
        )
    return Seen(picture.T_G_C @ sight.T_cam_body, sight)


def _rough(own: Sequence[TagObservation], tags: Mapping[int, BodyTag]) -> np.ndarray:
    """T_cam_body by the largest tag alone, whichever of its two poses holds."""
    largest = max(own, key=lambda o: o.edge_px)
    return largest.T_cam_tag @ transforms.invert(tags[largest.id].T_body_tag)

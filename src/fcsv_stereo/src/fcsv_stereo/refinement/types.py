# SPDX-License-Identifier: Apache-2.0
"""What refinement takes and gives back."""

from dataclasses import dataclass, field
from typing import Dict, List, Optional

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_stereo.errors import InputError
from fcsv_stereo.model import Picture, PosePrior, PoseUncertainty
from fcsv_stereo.refinement.features import KnownFeatures

METRIC = PosePrior(position_m=0.02)  # of pictures in metres of which nothing is said
# share by which a focal length may well be wrong: from a data sheet, of a lens at another zoom
ANY_FOCAL = 0.05


@dataclass(frozen=True)
class RefineOptions:
    """Choices of the refinement; defaults suit the simulated flights and ordinary photographs."""

    prior: PosePrior = METRIC
    refine_focal: bool = False  # one scale of the focal length, common to all pictures
    # a rolling shutter or a wrong focal length that the pictures show beyond doubt
    correct_camera: bool = True
    # focal lengths may be of another lens or size of picture; else off by per cents at most
    other_lens: bool = True
    # nobody doubts the cameras: no focal length, no rolling shutter is looked for
    calibrated: bool = False
    refine_time_offset: bool = False  # one per vehicle besides the reference's
    time_offset_sigma_s: float = 0.1
    focal_sigma: float = 0.01  # of the prior of the focal length, as a share of it
    features: int = 3500  # corners in the reference picture, spread over it
    # of a link; fewer, or fewer than 0.6 of it measured: a picture keeps its prior
    least_inliers: int = 25
    # also match the others with each other where the reference does not see
    pair_others: bool = True
    unit_m: float = 1.0  # the unit of the poses' positions, for what is said of them in metres
    # of a camera between its first and last row; None: nothing tells it
    most_turn_rad: Optional[float] = None
    # of earlier ones, where pictures come again
    known: Optional[KnownFeatures] = field(default=None, repr=False)
    threads: int = 2

    def __post_init__(self):
        if self.features < 50 or self.least_inliers < 8 or self.threads < 1:
            raise InputError("refinement needs at least 50 features, 8 inliers and 1 thread")
        if self.calibrated and self.refine_focal:
            raise InputError(
                "a calibrated rig (--rig) has its focal lengths; leave --refine-focal out"
            )
        if not (self.time_offset_sigma_s > 0.0 and 0.0 < self.focal_sigma < 1.0):
            raise InputError("priors of time offset and focal length must be positive")


@dataclass(frozen=True)
class RefinedPicture:
    """A picture after refinement; ``picture`` has the refined pose, or the prior where it was
    refused.

    ``inliers`` of a refused one: those that agree with a prior which they do not better. The
    epipolar errors are rms over the inliers (px), NaN where there are none; ``reason`` says why it
    was refused.
    """

    picture: Picture
    prior_T_home_cam: np.ndarray
    refined: bool
    reason: str
    inliers: int
    epipolar_before_px: float
    epipolar_after_px: float
    uncertainty: PoseUncertainty

    @property
    def correction_rad(self) -> float:
        """Angle between the prior's rotation and the refined one."""
        R = self.prior_T_home_cam[:3, :3].T @ self.picture.T_home_cam[:3, :3]
        return float(Rotation.from_matrix(R).magnitude())

    @property
    def correction_m(self) -> float:
        """Distance between the prior's position and the refined one."""
        return float(np.linalg.norm(self.picture.T_home_cam[:3, 3] - self.prior_T_home_cam[:3, 3]))


@dataclass(frozen=True)
class Refinement:
    """All pictures after one adjustment; ``reference`` keeps its pose, ``others`` keep their order.

    ``unseen`` are sentences about what may be wrong and would show nowhere. ``focal_scale``
    multiplies every focal length (already done in the pictures' cameras). ``time_offsets_s`` is by
    vehicle what is to be added to the stamps of its pictures.
    """

    reference: Picture
    others: List[RefinedPicture]
    warnings: List[str]
    timing_s: Dict[str, float]
    focal_scale: float = 1.0
    time_offsets_s: Dict[str, float] = field(default_factory=dict)
    unseen: List[str] = field(default_factory=list)

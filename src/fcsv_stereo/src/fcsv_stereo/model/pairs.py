# SPDX-License-Identifier: Apache-2.0
"""What a map knows of one of its pairs, by one interface whatever the method."""

from dataclasses import dataclass
from typing import List, Protocol, Tuple

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model.configuration import Configuration


class Pair(Protocol):
    """What report, products, checks and evaluation read of a pair; they take nothing else of it.

    An attribute may be made when it is looked at (rectified pictures, disparity).
    """

    @property
    def configuration(self) -> Configuration:
        """The configuration that was recorded."""

    @property
    def reference_name(self) -> str:
        """Name of the reference picture."""

    @property
    def other_name(self) -> str:
        """Name of the other picture."""

    @property
    def T_home_cam_reference(self) -> np.ndarray:
        """4x4 pose of the reference picture's camera, as the map used it."""

    @property
    def T_home_cam_other(self) -> np.ndarray:
        """4x4 pose of the other picture's camera, as the map used it."""

    @property
    def camera_other(self) -> PinholeCamera:
        """The other picture's camera, without distortion."""

    @property
    def depth(self) -> np.ndarray:
        """HxW float32 (m along the optical axis, NaN where none) in the map's reference picture,
        untrimmed.

        What this pair measured by itself; or, with ``shares_depth``, the map's depth where this
        pair agrees with it.
        """

    @property
    def shares_depth(self) -> bool:
        """Whether ``depth`` is one depth of all pairs."""

    @property
    def reference_rectified(self) -> np.ndarray:
        """HxWx3 uint8 RGB."""

    @property
    def other_rectified(self) -> np.ndarray:
        """HxWx3 uint8 RGB."""

    @property
    def disparity(self) -> np.ndarray:
        """HxW float32 (px along the configuration's axis, NaN where none) in the reference's
        rectified view."""

    @property
    def match_rate(self) -> float:
        """Share of the pixels that this pair matched."""

    @property
    def effective_range_m(self) -> Tuple[float, float]:
        """Nearest and farthest depth (m) that this pair is good for (3.1 to 3.3)."""

    @property
    def candidates(self) -> List[Tuple[str, float]]:
        """Every other picture that was tried, with its match rate (5.4)."""


@dataclass(frozen=True)
class PairResult:
    """A pair that was matched by itself: a ``Pair`` whose attributes are all made."""

    configuration: Configuration
    reference_name: str
    other_name: str
    reference_rectified: np.ndarray
    other_rectified: np.ndarray
    disparity: np.ndarray
    depth: np.ndarray
    match_rate: float
    effective_range_m: Tuple[float, float]
    candidates: List[Tuple[str, float]]
    T_home_cam_reference: np.ndarray
    T_home_cam_other: np.ndarray
    camera_other: PinholeCamera
    shares_depth: bool = False

# SPDX-License-Identifier: Apache-2.0
"""What a mapping method starts from, whatever it was read from."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import List, Optional

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import InputError
from fcsv_stereo.result import Configuration


@dataclass(frozen=True)
class Picture:
    """An undistorted picture (HxWx3 uint8 RGB), its pinhole camera and the prior of its pose.

    ``blank`` (HxW bool) are pixels that the camera did not take, as taking out the distortion leaves them along the
    borders; None where there are none.
    """

    name: str
    vehicle: str
    stamp_s: float
    image: np.ndarray
    camera: PinholeCamera
    T_home_cam: np.ndarray
    blank: Optional[np.ndarray] = None

    @classmethod
    def undistorted(cls, name, vehicle, stamp_s, image, camera: PinholeCamera, T_home_cam) -> "Picture":
        """From the picture as a ``camera`` with distortion took it."""
        undistorted = camera.undistort(image)
        return cls(name, vehicle, stamp_s, undistorted, camera.undistorted(), T_home_cam, camera.blank())

    def shrunk(self, scale: float) -> "Picture":
        """The picture at a share of its size."""
        height, width = (max(1, round(n * scale)) for n in self.image.shape[:2])
        image = cv2.resize(self.image, (width, height), interpolation=cv2.INTER_AREA)
        blank = self.blank
        if blank is not None:
            blank = cv2.resize(blank.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) > 0
        return replace(self, image=image, camera=self.camera.resized(width, height), blank=blank)


@dataclass(frozen=True)
class PosePrior:
    """Standard deviations, per axis, of a picture's prior pose relative to the reference's.

    The position's is ``position_m`` plus, in quadrature, ``position_share`` of the distance from the reference.
    """

    rotation_rad: float = float(np.radians(0.3))
    position_m: float = 0.02
    position_share: float = 0.01

    def __post_init__(self):
        if not 0.0 < self.rotation_rad <= np.pi or not np.isfinite(self.rotation_rad):
            raise InputError(f"prior of rotation is {self.rotation_rad} rad; it must lie in 0 to pi")
        shares = (self.position_m, self.position_share)
        if not np.isfinite(shares).all() or min(shares) < 0.0 or max(shares) <= 0.0:
            raise InputError(f"prior of position is {self.position_m} m and {self.position_share} of the distance")

    def position_sigma_m(self, distance_m: float) -> float:
        """Per axis, at a distance from the reference.

        >>> PosePrior(position_m=0.03, position_share=0.01).position_sigma_m(4.0)
        0.05
        """
        return float(np.hypot(self.position_m, self.position_share * distance_m))


@dataclass(frozen=True)
class ConfigurationInput:
    """Pictures of one configuration, in order of time: of the reference camera and of the other one."""

    configuration: Configuration
    references: List[Picture]
    others: List[Picture]


#: Of a flight: the calibration's few centimetres, and one per cent of the way flown since by both.
FLOWN = PosePrior(position_m=0.15)


@dataclass(frozen=True)
class MapInput:
    """``kind`` is "session" (home is level, cameras are nearly parallel) or "photographs" (any poses).

    ``prior`` says how good the pictures' poses are, where that is known better than the method assumes.
    """

    kind: str
    configurations: List[ConfigurationInput]
    truth_folder: Optional[Path] = None
    warnings: List[str] = field(default_factory=list)
    prior: Optional[PosePrior] = None

# SPDX-License-Identifier: Apache-2.0
"""What a stereo depth camera can say: its range, and how well it knows a depth."""

from dataclasses import dataclass

import numpy as np

from fcsv_geometry.config import require_positive


@dataclass(frozen=True)
class DepthSensor:
    """An Intel RealSense D435 or D435F. Raises ValueError where a number is none.

    An error of ``subpixel_px`` in the match of one frame, another one in the next. An error of
    ``offset_px`` in all of them (the module's calibration), which no number of frames averages out.
    Both go with the square of the depth: sigma = z**2 px / (f b), as Intel's "Tuning depth cameras
    for best performance" has it, with 0.08 px of a well textured target. Baseline 50 mm; 848 px are
    90 degrees wide; from 0.3 m on, to about 10 m (thesis 6.2).
    """

    baseline_m: float = 0.05
    focal_px: float = 424.0
    subpixel_px: float = 0.08
    offset_px: float = 0.03
    least_m: float = 0.3
    most_m: float = 10.0

    def __post_init__(self):
        require_positive(self)
        if self.least_m >= self.most_m:
            raise ValueError(f"most_m: {self.most_m} m must be more than least_m, {self.least_m} m")

    def noise_m(self, depth_m):
        """Standard deviation (m) of a depth (m) in one frame, as that of another frame is not.

        >>> [round(float(DepthSensor().noise_m(z)), 4) for z in (1.0, 2.0, 8.0)]
        [0.0038, 0.0151, 0.2415]
        """
        return np.square(depth_m) * (self.subpixel_px / (self.focal_px * self.baseline_m))

    def offset_m(self, depth_m):
        """Standard deviation (m) of what all frames of one camera are wrong by at a depth (m)."""
        return np.square(depth_m) * (self.offset_px / (self.focal_px * self.baseline_m))

    @property
    def sure_m(self) -> float:
        """Depth (m) up to which a measured one is not only what noise brought into range from
        beyond ``most_m``.

        >>> round(DepthSensor().sure_m, 2)
        9.19
        """
        return self.most_m - 2.0 * float(
            np.hypot(self.noise_m(self.most_m), self.offset_m(self.most_m))
        )

    def in_range(self, depth_m: np.ndarray) -> np.ndarray:
        """Bool, of depths (m, NaN where there is none): which can be believed."""
        with np.errstate(invalid="ignore"):
            return (depth_m >= self.least_m) & (depth_m <= self.most_m)

# SPDX-License-Identifier: Apache-2.0
"""Which part of the reference picture the other camera sees too (thesis 2.2, figure 2.5, and
3.5)."""

import numpy as np


def overlap_starts_m(baseline_m: float, fov_rad: float, tilt_rad: float = 0.0) -> float:
    """Depth (m) at which the fields of view meet; nearer things are in one picture only.

    ``fov_rad`` is the whole angle of view along the baseline; ``tilt_rad`` turns the other camera
    inward.

    >>> round(overlap_starts_m(8.0, np.radians(56.0)), 2)
    7.52
    >>> overlap_starts_m(8.0, np.radians(56.0), np.radians(8.0)) < 7.52
    True
    """
    half = fov_rad / 2.0
    return float(baseline_m / (np.tan(half) + np.tan(half + tilt_rad)))


def non_overlap(z_m, baseline_m: float, fov_rad: float, tilt_rad: float = 0.0):
    """Share (0 to 1) of the reference picture, along the baseline, that the other does not see at
    depth z (m).

    In the plane of the optical axes the reference sees |x| <= z tan(fov/2); the other, at x =
    baseline and turned inward, sees from baseline - z tan(fov/2 + tilt) to baseline + z tan(fov/2 -
    tilt). For a pitched camera above or below the same holds with the vertical angle of view.

    >>> round(float(non_overlap(20.0, 8.0, np.radians(56.0))), 3)
    0.376
    >>> float(non_overlap(5.0, 8.0, np.radians(56.0)))
    1.0
    """
    z = np.asarray(z_m, float)
    half = fov_rad / 2.0
    edge = z * np.tan(half)
    low = np.maximum(-edge, baseline_m - z * np.tan(half + tilt_rad))
    high = np.minimum(edge, baseline_m + z * np.tan(half - tilt_rad))
    with np.errstate(divide="ignore", invalid="ignore"):
        shared = np.where(edge > 0, (high - low) / (2.0 * edge), 0.0)
    return 1.0 - np.clip(shared, 0.0, 1.0)

# SPDX-License-Identifier: Apache-2.0
"""What a tracking camera thinks of its own poses: realsense2_camera puts it into the covariance of
the odometry."""

import math

FAILED, LOW, MEDIUM, HIGH = 0.0, 1.0, 2.0, 3.0
_BEST_VARIANCE_M2 = 0.01  # the driver: variance = 0.01 * 10^(3 - confidence)


def confidence(variance_m2: float) -> float:
    """0 failed, 1 low, 2 medium, 3 high, from the variance of x; NaN for a tracker that tells none
    (variance 0).

    >>> [confidence(v) for v in (0.01, 0.1, 1.0, 10.0, 1e-3, 0.0)]
    [3.0, 2.0, 1.0, 0.0, 3.0, nan]
    """
    if not variance_m2 > 0.0:
        return math.nan
    return min(HIGH - math.log10(variance_m2 / _BEST_VARIANCE_M2), HIGH)

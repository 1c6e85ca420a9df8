# SPDX-License-Identifier: Apache-2.0
"""The thesis's equations of depth error and effective range (f in px, lengths in m)."""

import re
from dataclasses import dataclass

import numpy as np

from fcsv_stereo.errors import InputError


@dataclass(frozen=True)
class ErrorThreshold:
    """The accepted depth error: metres, or a share of the distance."""

    value: float
    relative: bool

    def __post_init__(self):
        if not self.value > 0 or (self.relative and self.value >= 1):
            raise InputError(
                f"error threshold {self.value} must be positive, and below 100 % where it is a share"
            )


def parse_threshold(text: str) -> ErrorThreshold:
    """ "10%" or "0.5" or "0.5m".

    >>> parse_threshold("10%")
    ErrorThreshold(value=0.1, relative=True)
    """
    match = re.fullmatch(r"\s*([0-9.]+)\s*(%|m)?\s*", text)
    try:
        value = float(match.group(1)) if match else float("nan")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(
            f"error threshold '{text}' is not understood; write metres (0.5) or a share of the distance (10%)"
        )
    return (
        ErrorThreshold(value / 100.0, True)
        if match.group(2) == "%"
        else ErrorThreshold(value, False)
    )


def depth_error(z_m, baseline_m: float, focal_px: float, disparity_error_px: float = 1.0):
    """Equation 2.12.

    >>> round(depth_error(400.0, 8.0, 602.0), 1)
    33.2
    """
    return np.square(z_m) / (baseline_m * focal_px) * disparity_error_px


def farthest(
    baseline_m: float, focal_px: float, threshold: ErrorThreshold, disparity_error_px: float = 1.0
) -> float:
    """Equation 3.1; with a share e of the distance the error e z equals 2.12 at z = e b f / error.

    >>> [round(farthest(b, 602.0, ErrorThreshold(0.1, True))) for b in (2, 4, 6, 8)]
    [120, 241, 361, 482]
    """
    if threshold.relative:
        return threshold.value * baseline_m * focal_px / disparity_error_px
    return float(np.sqrt(threshold.value * baseline_m * focal_px / disparity_error_px))


def baseline_for(
    z_m: float, focal_px: float, threshold: ErrorThreshold, disparity_error_px: float = 1.0
) -> float:
    """Equation 3.2: the baseline (m) whose error at z_m equals the threshold; the inverse of 3.1.

    >>> round(baseline_for(40.0, 602.0, ErrorThreshold(0.5, False)), 2)
    5.32
    >>> round(baseline_for(481.6, 602.0, ErrorThreshold(0.1, True)), 2)
    8.0
    """
    accepted_m = threshold.value * (z_m if threshold.relative else 1.0)
    return z_m**2 / (accepted_m * focal_px) * disparity_error_px


def segment_ends(nearest_m: float, range_m: float, count: int) -> np.ndarray:
    """Equation 3.3: the far ends (m) of ``count`` equal segments between the smallest and the
    largest range.

    >>> segment_ends(0.0, 40.0, 3).round(2).tolist()
    [13.33, 26.67, 40.0]
    """
    return nearest_m + (range_m - nearest_m) / count * np.arange(1, count + 1)

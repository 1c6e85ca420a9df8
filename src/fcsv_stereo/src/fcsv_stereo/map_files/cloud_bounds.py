# SPDX-License-Identifier: Apache-2.0
"""Which points of a map are worth a cloud: near enough, sure enough. Depth and sigma of the pixels
stay as they are."""

import re
from dataclasses import dataclass, replace
from typing import Optional, Union

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.equations import ErrorThreshold, farthest, parse_threshold
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import CloudCut, MapResult

#: What a cloud's points may be unsure of (share of the distance): two standard deviations are then
#: 40 %, and what is less sure has no place that anybody could use. Below it the points hardly get
#: better, and fewer (docs/user/maps.md#clouds).
DEFAULT_SIGMA = ErrorThreshold(0.2, True)
_AUTO, _NONE = "auto", "none"
_AT_A_TIME = 1 << 18  # points: clouds of large pictures


@dataclass(frozen=True)
class CloudBounds:
    """``range_m``: farthest depth (m along the optical axis), "auto": as far as the baselines hold,
    None: any. ``sigma``: largest standard deviation, None: any."""

    range_m: Union[float, str, None] = _AUTO
    sigma: Optional[ErrorThreshold] = DEFAULT_SIGMA

    @classmethod
    def of_words(cls, range_m: str = _AUTO, sigma: Optional[str] = None) -> "CloudBounds":
        """Reads the bounds as an operator writes them. Raises InputError.

        >>> CloudBounds.of_words("none", "none")
        CloudBounds(range_m=None, sigma=None)
        >>> CloudBounds.of_words("250", "15%")
        CloudBounds(range_m=250.0, sigma=ErrorThreshold(value=0.15, relative=True))
        """
        return cls(_range(range_m), DEFAULT_SIGMA if sigma is None else _sigma(sigma))


def _range(word: str) -> Union[float, str, None]:
    if word in (_AUTO, _NONE):
        return None if word == _NONE else word
    metres = re.fullmatch(r"\s*([0-9]+\.?[0-9]*|\.[0-9]+)\s*m?\s*", word)
    if metres is None or not float(metres.group(1)) > 0.0:
        raise InputError(
            f"--cloud-range-m '{word}' is not understood; write metres (300), 'auto' or 'none'"
        )
    return float(metres.group(1))


def _sigma(word: str) -> Optional[ErrorThreshold]:
    if word == _NONE:
        return None
    try:
        return parse_threshold(word)
    except InputError as error:
        raise InputError(
            f"--cloud-sigma '{word}' is not understood; write a share of the distance below 100 % (20%), metres (5), "
            "or 'none'"
        ) from error


def held_range_m(result: MapResult) -> Optional[float]:
    """Depth (m) at which one pixel of disparity on the widest pair is ``DEFAULT_SIGMA`` of the
    distance (3.1).

    Of a pair's baseline counts what lies across the reference's optical axis. None where there is
    no pair, or none that has a baseline.
    """
    T_cam_home, camera = transforms.invert(result.reference.T_home_cam), result.reference.camera
    reach = [0.0]
    for p in result.pairs:
        across_m = float(
            np.linalg.norm(transforms.apply(T_cam_home, p.T_home_cam_other[:3, 3])[:2])
        )
        focal_px = (camera.fx, camera.fy)[p.configuration.axis.coordinate]
        reach.append(farthest(across_m, focal_px, DEFAULT_SIGMA))
    return max(reach) or None


def bound_cloud(result: MapResult, bounds: CloudBounds) -> MapResult:
    """The result whose cloud holds the points within ``bounds``, and ``cut``: how many were left
    out, and why.

    A cloud that loses all of its points is a warning.
    """
    cloud = result.cloud
    range_m = held_range_m(result) if bounds.range_m == _AUTO else bounds.range_m
    depth_m = _depth_m(result)
    far, unsure = np.zeros((2, len(cloud)), bool)
    if range_m is not None:
        far = depth_m > range_m
    if bounds.sigma is not None:
        unsure = ~(
            cloud.sigma_m <= bounds.sigma.value * (depth_m if bounds.sigma.relative else 1.0)
        )
    kept = ~(far | unsure)
    cut = CloudCut(range_m, bounds.sigma, int(far.sum()), int((unsure & ~far).sum()))
    warnings = list(result.warnings)
    if len(cloud) and not kept.any():
        warnings.append(
            f"the cloud is empty: all {len(cloud):,} points lie {in_words(cut)}. --cloud-range-m and --cloud-sigma "
            "widen its bounds; depth.npy has all depths."
        )
    return replace(result, cloud=cloud[kept], cut=cut, warnings=warnings)


def _depth_m(result: MapResult) -> np.ndarray:
    """(N,) of the cloud's points along the reference's optical axis."""
    T_cam_home, points = transforms.invert(result.reference.T_home_cam), result.cloud.points_home_m
    out = np.empty(len(points))
    for i in range(0, len(points), _AT_A_TIME):
        part = slice(i, i + _AT_A_TIME)
        out[part] = transforms.apply(T_cam_home, points[part].astype(float))[:, 2]
    return out


def in_words(cut: CloudCut) -> str:
    """What was left out.

    >>> in_words(CloudCut(963.4, DEFAULT_SIGMA, 12, 3456))
    'beyond 963 m (12) or less sure than 20 % of the distance (3,456)'
    """
    said = []
    if cut.range_m is not None:
        said.append(f"beyond {cut.range_m:.0f} m ({cut.beyond_range:,})")
    if cut.sigma is not None:
        worth = (
            f"{100.0 * cut.sigma.value:g} % of the distance"
            if cut.sigma.relative
            else f"{cut.sigma.value:g} m"
        )
        said.append(f"less sure than {worth} ({cut.beyond_sigma:,})")
    return " or ".join(said)

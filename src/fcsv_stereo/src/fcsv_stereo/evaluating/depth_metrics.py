# SPDX-License-Identifier: Apache-2.0
"""The metrics that the field reports of depths with a standard deviation (docs/lab/benchmarks.md).

Arrays are (N,), of the pixels that have a depth and a truth. Errors and sigmas that are sorted or
averaged are relative: an error in metres is large where the depth is, whatever its sigma.

Sources: mean relative error and inlier ratio at 1.03: Schröppel et al. 2022 (Robust MVD);
sparsification and AUSE: Ilg et al. 2018; coverage and sharpness: Gneiting et al. 2007.
"""

from dataclasses import dataclass
from typing import Mapping, Optional, Tuple

import numpy as np
from scipy.special import ndtri

Groups = Mapping[str, np.ndarray]  # pixels (N,) bool by name

LEVELS = (0.5, 0.68, 0.9, 0.95)  # nominal coverage of the intervals that are judged
INLIER = 0.03  # Robust MVD's bound
GROUP_LEVEL = 0.9  # the interval by which the worst group is found
LEAST_GROUP = 0.01  # of the pixels; of fewer, chance makes the worst group
WORST_ERRORS, SUREST = 0.05, 0.2  # shares of the pixels that the overconfident share compares
_LEVELS = ", ".join(f"{100 * level:.0f}" for level in LEVELS)

#: What ``DepthMetrics.cells`` holds, in its order.
TITLES = (
    "mean relative error",
    "within 3 %, of the answered",
    "AUSE",
    f"errors in intervals of {_LEVELS} %",
    "sharpness: median of sigma over depth",
    "worst band of distance, in its interval of 90 %",
    "overconfident share",
)


@dataclass(frozen=True)
class GroupCoverage:
    """``coverage``: share of a group's errors within the interval of ``GROUP_LEVEL``."""

    name: str
    pixels: int
    coverage: float


@dataclass(frozen=True)
class DepthMetrics:
    """Holds figures of the answered pixels. ``interval_coverage``: by nominal level, the share of
    errors in that level's interval about the depth. ``sharpness``: median of sigma over depth.
    ``worst_group``: None where every group is too small.
    """

    mean_relative_error: float
    within_3_percent: float
    ause: float
    interval_coverage: Tuple[Tuple[float, float], ...]
    sharpness: float
    worst_group: Optional[GroupCoverage]
    overconfident_share: float

    def cells(self) -> Tuple[str, ...]:
        """Formats the figures for tables, by ``TITLES``."""
        worst = self.worst_group
        return (
            f"{self.mean_relative_error:.2%}",
            f"{self.within_3_percent:.1%}",
            f"{self.ause:.3f}",
            ", ".join(f"{100 * share:.1f}" for _, share in self.interval_coverage) + "%",
            f"{self.sharpness:.2%}",
            "–" if worst is None else f"{worst.coverage:.1%} ({worst.name})",
            f"{self.overconfident_share:.1%}",
        )

    def to_dict(self) -> dict:
        """Gives the figures for report.json; levels in percent."""
        worst = self.worst_group
        return {
            "mean_relative_error": self.mean_relative_error,
            "within_3_percent": self.within_3_percent,
            "ause": self.ause,
            "interval_coverage": {f"{level:.0%}": share for level, share in self.interval_coverage},
            "sharpness": self.sharpness,
            "worst_group": None if worst is None else dict(vars(worst), level=f"{GROUP_LEVEL:.0%}"),
            "overconfident_share": self.overconfident_share,
        }


def depth_metrics(
    depth: np.ndarray, sigma: np.ndarray, true: np.ndarray, groups: Optional[Groups] = None
) -> Optional[DepthMetrics]:
    """All metrics; None where there are no pixels. ``depth``, its ``sigma`` and the ``true`` depth
    are (N,), m and positive. Of ``groups`` the worst is found.

    >>> m = depth_metrics(np.array([10.1, 20.1]), np.array([0.2, 0.2]), np.array([10.0, 20.0]))
    >>> round(m.mean_relative_error, 5), m.within_3_percent, m.ause
    (0.0075, 1.0, 0.0)
    """
    if not len(depth):
        return None
    depth, sigma, true = (np.asarray(a, float) for a in (depth, sigma, true))
    error = np.abs(depth - true)
    relative, relative_sigma = error / true, sigma / depth
    return DepthMetrics(
        mean_relative_error=float(relative.mean()),
        within_3_percent=inlier_ratio(depth, true),
        ause=ause(relative, relative_sigma),
        interval_coverage=tuple((p, interval_coverage(error, sigma, p)) for p in LEVELS),
        sharpness=float(np.median(relative_sigma)),
        worst_group=worst_group(error, sigma, groups or {}),
        overconfident_share=overconfident_share(relative, relative_sigma),
    )


def inlier_ratio(depth: np.ndarray, true: np.ndarray, within: float = INLIER) -> float:
    """Share of depths that are off by less than a factor of 1 + ``within``, to either side.

    >>> inlier_ratio(np.array([1.02, 0.98, 1.04, 0.5]), np.ones(4))
    0.5
    """
    return float((np.maximum(depth / true, true / depth) < 1.0 + within).mean())


def interval_sigmas(level: float) -> float:
    """Half the width (in standard deviations) of the interval that holds ``level`` of a normal
    distribution.

    >>> [round(interval_sigmas(level), 3) for level in LEVELS]
    [0.674, 0.994, 1.645, 1.96]
    """
    return float(ndtri(0.5 + 0.5 * level))


def interval_coverage(error: np.ndarray, sigma: np.ndarray, level: float) -> float:
    """Share of absolute errors within the interval of a level; ``level`` where sigma is right.

    >>> interval_coverage(np.array([0.1, 1.0, 1.7, 3.0]), np.ones(4), 0.9)
    0.5
    """
    return float((error <= interval_sigmas(level) * sigma).mean())


def worst_group(error: np.ndarray, sigma: np.ndarray, groups: Groups) -> Optional[GroupCoverage]:
    """The group with the lowest coverage; groups below ``LEAST_GROUP`` of the pixels are left out.

    >>> near = np.array([True, True, False, False])
    >>> worst_group(np.array([0.1, 0.2, 0.3, 9.0]), np.ones(4), {"near": near, "far": ~near})
    GroupCoverage(name='far', pixels=2, coverage=0.5)
    """
    found = []
    for name, mask in groups.items():
        if mask.sum() >= max(1.0, LEAST_GROUP * len(error)):
            coverage = interval_coverage(error[mask], sigma[mask], GROUP_LEVEL)
            found.append(GroupCoverage(name, int(mask.sum()), coverage))
    return min(found, key=lambda g: g.coverage) if found else None


def risk_over_coverage(error: np.ndarray, uncertainty: np.ndarray) -> np.ndarray:
    """(N,): mean error of the 1, 2, ... N pixels of least uncertainty. Pixels that are equally
    uncertain each count with their mean error, so that their order does not matter.

    >>> risk_over_coverage(np.array([4.0, 1.0, 3.0]), np.array([2.0, 1.0, 2.0])).round(2).tolist()
    [1.0, 2.25, 2.67]
    """
    _, tie, counts = np.unique(uncertainty, return_inverse=True, return_counts=True)
    means = np.bincount(tie, weights=error) / counts
    return np.cumsum(np.repeat(means, counts)) / np.arange(1, len(error) + 1)


def ause(error: np.ndarray, uncertainty: np.ndarray) -> float:
    """Area under the sparsification error: how much more error is left where pixels are removed by
    uncertainty than where they are removed by error (the oracle). It is a share of the error of all
    pixels, and a mean over all shares that are left. 0: uncertainty sorts as errors do.
    Uncertainty that says nothing has 1/2 for uniform errors.

    >>> error = (np.arange(1000) + 0.5) / 1000
    >>> ause(error, error), round(ause(error, np.ones(1000)), 2)
    (0.0, 0.5)
    """
    mean = float(error.mean())
    if mean == 0.0:
        return 0.0
    more = risk_over_coverage(error, uncertainty) - risk_over_coverage(error, error)
    return float(more.mean()) / mean


def overconfident_share(error: np.ndarray, uncertainty: np.ndarray) -> float:
    """Gives, of the worst ``WORST_ERRORS`` of the errors, the share among the ``SUREST`` pixels:
    ``SUREST`` where uncertainty says nothing, 0 where it tells these errors.

    >>> error = np.arange(100.0)
    >>> [overconfident_share(error, u) for u in (error, -error, 0.0 * error)]
    [0.0, 1.0, 0.2]
    """
    worst = _lowest(-error, WORST_ERRORS)
    return float((worst * _lowest(uncertainty, SUREST)).sum() / worst.sum())


def _lowest(values: np.ndarray, share: float) -> np.ndarray:
    """(N,): 1 for values of the lowest ``share``, else 0; equals at the bound share the rest."""
    _, tie, counts = np.unique(values, return_inverse=True, return_counts=True)
    below = np.cumsum(counts) - counts
    return np.clip((share * len(values) - below) / counts, 0.0, 1.0)[tie]

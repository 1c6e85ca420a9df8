# SPDX-License-Identifier: Apache-2.0
"""Which points of a map come of which baseline: by axis, and by axis and length. For who looks at a
map as it grows."""

from typing import Dict, List, Sequence, Tuple

import numpy as np

from fcsv_stereo.model import Cloud

MOST_POINTS = 60_000  # of one group; a screen has no more pixels for them


def groups(baselines: Sequence[Tuple[str, float]]) -> Dict[str, List[int]]:
    """Indices of pairs by name: every axis, then every axis with its length in steps of 0.1 m.

    ``baselines``: (axis, length in m) of each pair.

    >>> groups([("horizontal", 2.0), ("vertical", 5.0), ("horizontal", 2.52), ("horizontal", 2.04)])
    {'horizontal': [0, 2, 3], 'vertical': [1], 'horizontal_2m': [0, 3], 'vertical_5m': [1],
    'horizontal_2_5m': [2]}
    """
    found: Dict[str, List[int]] = {}
    for i, (axis, _) in enumerate(baselines):
        found.setdefault(axis, []).append(i)
    for i, (axis, baseline_m) in enumerate(baselines):
        name = f"{axis}_{round(float(baseline_m), 1):g}m"
        found.setdefault(name.replace(".", "_"), []).append(i)
    return found


def chosen(cloud: Cloud, pairs: Sequence[int], most: int = MOST_POINTS) -> np.ndarray:
    """Indices of the cloud's points that come of ``pairs``, evenly thinned to ``most`` of them at
    most."""
    of_pairs = np.flatnonzero(np.isin(cloud.baseline_index, np.asarray(pairs, int)))
    return of_pairs[:: max(1, -(-len(of_pairs) // most))]

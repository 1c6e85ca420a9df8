# SPDX-License-Identifier: Apache-2.0
"""Where the pairs of one axis deny what those of the other say: sigma must know.

What moves along one axis in step with its baselines looks like another depth there; to the other
axis it does not (docs/design/decisions/0008).
"""

from typing import Dict, List

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.joint.checks.visibility import seen_from, visible
from fcsv_stereo.joint.tuning import AXIS_CONFLICT, MOVED, SHARED
from fcsv_stereo.model import MapInput, MapResult

_MARGIN = np.ones((SHARED.around_px,) * 2, np.uint8)


def doubt_contradicted(given: MapInput, result: MapResult) -> MapResult:
    """The result with sigma at least a fifth of the depth where one axis agrees with it and the
    other does not.

    Denied: two pairs of an axis (or its only one) see a place that nothing of the map hides, and
    none agrees; and what is connected to it that only one of them sees (the picture ends there for
    the others), if that one does not agree. Pictures that were taken when a reference picture was
    do not need it: ``moved`` compares these.
    """
    if len({p.configuration.axis for p in result.pairs}) < 2 or _of_one_moment(given):
        return result
    step = max(1, int(np.sqrt(result.depth.size / AXIS_CONFLICT.pixels)))
    denied = _denied(result, step)
    if not denied.any():
        return result
    denied = (
        cv2.resize(
            denied.astype(np.uint8), result.depth.shape[::-1], interpolation=cv2.INTER_NEAREST
        )
        > 0
    )
    least = np.where(
        denied, np.float32(AXIS_CONFLICT.least_relative_sigma) * result.depth, np.float32(0.0)
    )
    sigma = np.maximum(result.sigma, least).astype(np.float32)
    return result.with_sigma(sigma)


def _of_one_moment(given: MapInput) -> bool:
    """Whether all pictures have a reference picture of their moment: photographs do not say when
    they were taken."""
    apart_s = (
        min(abs(r.stamp_s - o.stamp_s) for r in c.references)
        for c in given.configurations
        for o in c.others
    )
    return given.kind == "session" and all(s <= AXIS_CONFLICT.apart_s for s in apart_s)


def _denied(result: MapResult, step: int) -> np.ndarray:
    """Gives what is denied at every ``step``-th pixel, bool."""
    reference, seen, surely, agreed = result.reference, {}, {}, {}
    by_axis: Dict[str, List] = {}
    for pair in result.pairs:
        by_axis.setdefault(pair.configuration.axis, []).append(pair)
    for axis, pairs in by_axis.items():
        views = []
        for pair in pairs:
            T = transforms.invert(pair.T_home_cam_other) @ reference.T_home_cam
            other = pair.camera_other
            uv, z = seen_from(result.depth, reference.camera, T, other, step)
            views.append(visible(uv, z, (other.height, other.width), step))
        seen[axis], surely[axis] = (
            np.sum(views, axis=0) >= least for least in (1, min(2, len(pairs)))
        )
        agreed[axis] = np.any([np.isfinite(p.depth[::step, ::step]) for p in pairs], axis=0)
    known = np.isfinite(result.depth[::step, ::step])
    denied, sure = (_dense(known & _by_one_axis(by, agreed)) for by in (seen, surely))
    _, labels = cv2.connectedComponents(denied.astype(np.uint8), connectivity=8)
    large = (
        np.bincount(labels[sure & denied], minlength=labels.max() + 1)
        >= 3 * MOVED.least_share * labels.size  # smaller spots are edges and noise
    )
    large[0] = False
    return cv2.dilate(large[labels].astype(np.uint8), _MARGIN) > 0


def _by_one_axis(seen: Dict[str, np.ndarray], agreed: Dict[str, np.ndarray]) -> np.ndarray:
    """HxW bool: seen by an axis that does not agree, while the other does."""
    a, b = seen
    return (seen[a] & ~agreed[a] & agreed[b]) | (seen[b] & ~agreed[b] & agreed[a])


def _dense(denied: np.ndarray) -> np.ndarray:
    """HxW bool: most of the surroundings are denied."""
    return cv2.blur(denied.astype(np.float32), (SHARED.window_px,) * 2) > AXIS_CONFLICT.share

# SPDX-License-Identifier: Apache-2.0
"""The same picture twice, under two names and poses: one of them at most is where it is said to
be."""

from dataclasses import replace
from typing import Dict, List, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.refinement.features import FeatureView
from fcsv_stereo.refinement.graph import prior_to_reference
from fcsv_stereo.refinement.links import PairLink
from fcsv_stereo.refinement.types import RefineOptions

_SMALL_PX = 96  # width at which all pairs are compared
_ALIKE_SMALL, _ALIKE = 0.8, 0.85  # correlation of the detail: small, and in the whole picture
_LARGE_PX = 640


def without_copies(
    views: List[FeatureView],
    direct: Dict[int, PairLink],
    between: List[PairLink],
    options: RefineOptions,
) -> Tuple[Dict[int, PairLink], List[PairLink]]:
    """Links without those of pictures that are copies; of a picture and its copies the one that is
    nearest to its prior pose stays, and the reference does always."""
    out = dict(direct)
    for of in _copies(views):
        kept = 0 if 0 in of else min(of, key=lambda k: _away(views, direct[k], options))
        for k in of:
            if k != kept:
                name = views[kept].picture.name
                reason = (
                    f"pixel for pixel it is the same picture as {name} and shows no parallax against it: a copy under "
                    "another name and pose, or one that was taken from the same place"
                )
                out[k] = replace(direct[k], reason=reason, same_place=True)
    left_out = {k for k in out if out[k] is not direct[k]}
    return out, [l for l in between if not {l.a, l.b} & left_out]


def _copies(views: List[FeatureView]) -> List[List[int]]:
    """Groups of numbers of pictures that are the same."""
    small = [_detail(v.gray, _SMALL_PX) for v in views]
    groups: List[List[int]] = []
    for k, view in enumerate(views):
        for group in groups:
            j = group[0]
            if _alike(small[j], small[k]) > _ALIKE_SMALL and _same(views[j], view):
                group.append(k)
                break
        else:
            groups.append([k])
    return [g for g in groups if len(g) > 1]


def _same(a: FeatureView, b: FeatureView) -> bool:
    width = min(a.gray.shape[1], b.gray.shape[1], _LARGE_PX)
    return _alike(_detail(a.gray, width), _detail(b.gray, width)) > _ALIKE


def _detail(gray: np.ndarray, width: int) -> np.ndarray:
    """The picture at that width, less its means over some pixels."""
    height = max(1, round(gray.shape[0] * width / gray.shape[1]))
    image = cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    return image - cv2.GaussianBlur(image, (0, 0), 2.0)


def _alike(a: np.ndarray, b: np.ndarray) -> float:
    """Correlation; 0 of pictures of another shape, or without detail."""
    if a.shape != b.shape or min(a.std(), b.std()) < 0.3:
        return 0.0
    return float((a * b).mean() / np.sqrt(np.square(a).mean() * np.square(b).mean()))


def _away(views: List[FeatureView], link: PairLink, options: RefineOptions) -> float:
    """How far the features put a picture from its prior, in standard deviations; infinite where
    they do not tell."""
    if link.reason:
        return float("inf")
    prior = prior_to_reference(views, link.b, options.prior)
    off = transforms.invert(prior.T_a_b) @ link.T_a_b
    turned = np.linalg.norm(cv2.Rodrigues(off[:3, :3])[0]) / prior.rotation_rad
    return float(max(turned, np.linalg.norm(off[:3, 3]) / prior.position_m))

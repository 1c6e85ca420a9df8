# SPDX-License-Identifier: Apache-2.0
"""Exposures made alike, by what the pictures agree on."""

from concurrent.futures import ThreadPoolExecutor
from typing import List, Optional, Tuple

import numpy as np

from fcsv_stereo.joint.refine.residuals import Residuals, differences
from fcsv_stereo.joint.tuning import RESIDUALS, SHARED
from fcsv_stereo.joint.views import Views
from fcsv_stereo.joint.volume.census import MOST_GAIN


def same_exposure(
    found: Views, w: np.ndarray, r: Residuals, pool: ThreadPoolExecutor
) -> List[Optional[Tuple[float, float]]]:
    """Gain and offset of each picture (the reference's first) that bring its grey to the
    reference's; None: it stays.

    By the pixels of ``found`` at which a pair agrees (``r``) at inverse depth ``w`` (HxW, 1/m).
    """
    out: List[Optional[Tuple[float, float]]] = [None] * (1 + len(found))
    for i, (trust, difference) in enumerate(zip(r.trust, differences(found, w, pool))):
        good = trust > RESIDUALS.least_trust
        if good.sum() < SHARED.least_pixels:
            continue
        here, there = found.reference[good], (found.reference - difference)[good]
        gain = float(np.clip(here.std() / max(there.std(), 1e-3), 1.0 / MOST_GAIN, MOST_GAIN))
        out[i + 1] = gain, float(np.median(here - gain * there))
    return out

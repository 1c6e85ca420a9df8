# SPDX-License-Identifier: Apache-2.0
"""The sky: what is at infinity for every pair, from the top of the picture down to the skyline."""

import cv2
import numpy as np

from fcsv_stereo.joint.photometric import Residuals

_MOST_PX = 1.2  # of movement in the fastest pair: infinity, as well as a coarse match can tell
_GROWTH_PX = 12  # by which the match makes what is in front of the sky too large
_STEP = 12.0  # grey levels: the skyline
_LIKENESS = 25.0  # grey levels of colour


def sky(w: np.ndarray, r: Residuals, colour: np.ndarray) -> np.ndarray:
    """HxW bool, from inverse depth (1/m), what pairs make of it, and ``colour`` (HxWx3 float32).

    The windows of the match carry the skyline into the sky, which has little texture; so the sky grows again over
    pixels that look like it, up to the next edge of the picture.
    """
    still = (cv2.medianBlur(w.astype(np.float32), 5) * r.speed.max(axis=0) < _MOST_PX).astype(np.uint8)
    still = cv2.morphologyEx(still, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    labels = cv2.connectedComponents(still, connectivity=4)[1]
    top = np.unique(labels[:2][still[:2] > 0])
    out = np.isin(labels, top) & (still > 0)
    kernel = np.ones((3, 3), np.uint8)
    smooth = np.max(cv2.morphologyEx(colour, cv2.MORPH_GRADIENT, kernel), axis=2) < _STEP
    share = cv2.blur(out.astype(np.float32), (25, 25))
    mean = cv2.blur(colour * out[..., None], (25, 25)) / np.maximum(share, 1e-3)[..., None]
    alike = (np.abs(colour - mean).mean(axis=2) < _LIKENESS) & (share > 0.02)
    for _ in range(_GROWTH_PX):
        out = out | (cv2.dilate(out.astype(np.uint8), kernel) > 0) & smooth & alike
    return out

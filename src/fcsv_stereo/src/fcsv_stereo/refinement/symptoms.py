# SPDX-License-Identifier: Apache-2.0
"""What a person sees at once in a picture that could not be used: too bright, too dark, blurred."""

import cv2
import numpy as np

_WHITE, _MOST_WHITE = 250, 0.3  # grey value; share of the picture beyond that of the reference
# grey value of the brightest part; times as bright the reference must be there
_DARK, _LEAST_BRIGHT = 48, 2.0
_LEAST_DETAIL = 0.1  # of the reference's


def symptom(gray: np.ndarray, reference: np.ndarray) -> str:
    """Says, in words, against the reference picture (both HxW uint8); empty where the picture looks
    as good.

    >>> ramp = np.tile(np.arange(200, dtype=np.uint8), (100, 1))
    >>> symptom(np.full_like(ramp, 255), ramp), symptom(ramp // 16, ramp), symptom(ramp, ramp)
    ('it is over-exposed', 'it is under-exposed', '')
    """
    if (gray >= _WHITE).mean() - (reference >= _WHITE).mean() > _MOST_WHITE:
        return "it is over-exposed"
    brightest, there = (float(np.percentile(g, 99)) for g in (gray, reference))
    if brightest < _DARK and there > _LEAST_BRIGHT * max(brightest, 1.0):
        return "it is under-exposed"
    if _detail(gray) < _LEAST_DETAIL * _detail(reference):
        return "it is blurred, or shows nothing with detail"
    return ""


def _detail(gray: np.ndarray) -> float:
    """Mean square of the second derivative, after the noise of single pixels is taken out."""
    return float(np.mean(np.square(cv2.Laplacian(cv2.GaussianBlur(gray, (0, 0), 1.0), cv2.CV_32F))))

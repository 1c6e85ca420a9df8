# SPDX-License-Identifier: Apache-2.0
"""What whoever monitors a scene is shown: the reference picture and its depth, with their rate,
skew and age."""

from collections import deque
from typing import Deque, Sequence, Tuple

import cv2
import numpy as np

from fcsv_stereo.model import MapInput

RANGE_M = (5.0, 400.0)  # ends of the colours, on a logarithmic scale, of what flies
_WINDOW_S = 5.0
_BAR_PX, _TEXT = 22, 0.42
_MARKS_M = (0.3, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 400)


class ImageRate:
    """How many depth images a second there were in the last five seconds."""

    def __init__(self):
        self._at_s: Deque[float] = deque()

    def tick(self, now_s: float) -> None:
        """One came."""
        self._at_s.append(now_s)

    def hz(self, now_s: float) -> float:
        """Intervals over their time; 0 with fewer than two.

        >>> rate = ImageRate()
        >>> for k in range(9): rate.tick(0.25 * k)
        >>> rate.hz(2.0), rate.hz(9.0)
        (4.0, 0.0)
        """
        while self._at_s and now_s - self._at_s[0] > _WINDOW_S:
            self._at_s.popleft()
        if len(self._at_s) < 2:
            return 0.0
        return (len(self._at_s) - 1) / max(self._at_s[-1] - self._at_s[0], 1e-6)


def skew_s(given: MapInput) -> float:
    """Between the reference's picture and the one furthest from it in time (s)."""
    return max(
        abs(o.stamp_s - r.stamp_s)
        for c in given.configurations
        for r in c.references
        for o in c.others
    )


def in_words(rate_hz: float, skew: float, age_s: float, names: Sequence[str]) -> str:
    """One line for the picture.

    >>> in_words(3.72, 0.004, 0.42, ["uav2, horizontal 4.0 m"])
    '3.7 Hz, skew 4 ms, 0.4 s old: uav2, horizontal 4.0 m'
    """
    return f"{rate_hz:.1f} Hz, skew {1e3 * skew:.0f} ms, {age_s:.1f} s old: {'; '.join(names)}"


def picture(
    rgb: np.ndarray, depth: np.ndarray, line: str, range_m: Tuple[float, float] = RANGE_M
) -> np.ndarray:
    """(H + 44, 2 W, 3) uint8: the picture, its depth in colours (black: none), a line above, the
    scale below.

    ``rgb`` (H, W, 3) uint8, ``depth`` (H, W) m, NaN where there is none; ``range_m`` from red to
    blue.
    """
    width = 2 * depth.shape[1]
    above, below = (np.zeros((_BAR_PX, width, 3), np.uint8) for _ in range(2))
    while cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, _TEXT, 1)[0][0] > width - 12:
        line = line[:-1]  # what does not fit is left out
    cv2.putText(
        above, line, (4, 15), cv2.FONT_HERSHEY_SIMPLEX, _TEXT, (255, 255, 255), 1, cv2.LINE_AA
    )
    scale = range_m[0] * (range_m[1] / range_m[0]) ** np.linspace(0.0, 1.0, width)
    below[:6] = colours(scale[None], range_m)
    for mark in (m for m in _MARKS_M if range_m[0] <= m <= range_m[1]):
        x = min(int(_share(np.array(float(mark)), range_m) * width), width - 40)
        cv2.putText(
            below,
            f"{mark} m",
            (x, 19),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.36,
            (255, 255, 255),
            1,
            cv2.LINE_AA,
        )
    return np.vstack([above, np.hstack([rgb, colours(depth, range_m)]), below])


def colours(depth: np.ndarray, range_m: Tuple[float, float] = RANGE_M) -> np.ndarray:
    """(H, W, 3) uint8 RGB of depth (H, W) m: red near, blue far, black where there is none."""
    known = np.isfinite(depth)
    near = 255.0 * (1.0 - _share(np.where(known, depth, range_m[1]), range_m))
    bgr = cv2.applyColorMap(near.astype(np.uint8), cv2.COLORMAP_TURBO)
    return np.where(known[..., None], bgr[..., ::-1], 0).astype(np.uint8)


def _share(depth_m: np.ndarray, range_m: Tuple[float, float]) -> np.ndarray:
    """0 at the near end of the colours, 1 at the far one."""
    near_m, far_m = range_m
    return np.clip(np.log(np.maximum(depth_m, 1e-3) / near_m) / np.log(far_m / near_m), 0.0, 1.0)

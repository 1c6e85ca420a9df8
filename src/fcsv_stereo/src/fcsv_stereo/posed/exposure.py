# SPDX-License-Identifier: Apache-2.0
"""Pictures of 16 bits to 8: one linear scale for all pictures of a camera, so that a place stays
equally bright."""

from dataclasses import dataclass
from typing import Iterable

import numpy as np

#: Percentiles of all samples that become 0 and 255: a hot pixel, the sun, or 12 bits in 16 do not
#: set the scale.
DARK_PERCENTILE, BRIGHT_PERCENTILE = 0.1, 99.9
_SAMPLES = 100000  # of each picture


@dataclass(frozen=True)
class Exposure:
    """``table`` (65536 uint8) holds the 8-bit value of each 16-bit one."""

    table: np.ndarray

    @classmethod
    def common(cls, images: Iterable[np.ndarray]) -> "Exposure":
        """That of all pictures (uint16, any shape) together; colours and pictures keep their
        relation.

        >>> ramp = np.arange(4096, dtype=np.uint16).reshape(64, 64)
        >>> [int(v) for v in Exposure.common([ramp]).to_8_bit(np.array([0, 2048, 4095, 65535], np.uint16))]
        [0, 128, 255, 255]
        """
        counts = np.zeros(1 << 16, np.int64)
        for image in images:
            samples = image.reshape(-1)[:: max(1, image.size // _SAMPLES)]
            counts += np.bincount(samples, minlength=len(counts))
        share = np.cumsum(counts) / max(counts.sum(), 1)
        dark, bright = (
            int(np.searchsorted(share, p / 100.0)) for p in (DARK_PERCENTILE, BRIGHT_PERCENTILE)
        )
        values = (np.arange(len(counts)) - dark) * (255.0 / max(bright - dark, 1))
        return cls(np.clip(np.rint(values), 0, 255).astype(np.uint8))

    def to_8_bit(self, image: np.ndarray) -> np.ndarray:
        """A picture (uint16) as uint8; one that has 8 bits already stays as it is."""
        return image if image.dtype == np.uint8 else self.table[image]

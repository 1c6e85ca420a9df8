# SPDX-License-Identifier: Apache-2.0
"""What was said of a tracker that drifts: it stands until its vehicle is calibrated, or home is
set, anew."""

from typing import Dict, Tuple

import numpy as np


class LatchedDriftWarning:
    """Keeps, by vehicle: what was said, and T_home_odom then. The witness may be gone by then: a
    tag drifts out of view."""

    def __init__(self) -> None:
        self._said: Dict[str, Tuple[str, np.ndarray]] = {}

    def of(self, name: str, T_home_odom: np.ndarray) -> str:
        """Empty where nothing stands."""
        said, by = self._said.get(name, ("", None))
        return said if said and np.array_equal(by, T_home_odom) else ""

    def say(self, name: str, T_home_odom: np.ndarray, said: str) -> None:
        """Takes what was said from now on."""
        self._said[name] = (said, T_home_odom)

    def forget(self, name: str) -> None:
        """Its place in home is not known any more."""
        self._said.pop(name, None)

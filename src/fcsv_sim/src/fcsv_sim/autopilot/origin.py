# SPDX-License-Identifier: Apache-2.0
"""The origin of the autopilot's filter, with the two traps of the real one."""

from typing import Optional, Tuple

_FIELD_ELEVATION_S = 1.0


class EkfOrigin:
    """One that is set before the filter begins is confirmed and lost when it begins. While one at
    altitude 0 is reported and the vehicle is disarmed, the height datum is reset once a second
    (``step`` says when)."""

    def __init__(self):
        # latitude, longitude (1e-7 deg), altitude (mm)
        self.value: Optional[Tuple[int, int, int]] = None
        self._early = False
        self._reset_s = float("-inf")

    def set(self, value: Tuple[int, int, int], filter_runs: bool) -> bool:
        """Whether it is accepted: once."""
        if self.value is not None:
            return False
        self.value, self._early = value, not filter_runs
        return True

    def reported(self, filter_runs: bool) -> Optional[Tuple[int, int, int]]:
        """What the autopilot tells when asked."""
        return None if self._early and filter_runs else self.value

    def step(self, now_s: float, armed: bool, filter_runs: bool) -> bool:
        """Whether the height datum is reset now."""
        if self.value is None:
            return False
        if filter_runs and self._early:
            self.value, self._early = None, False
            return False
        if (
            armed
            or not filter_runs
            or self.value[2] != 0
            or now_s - self._reset_s < _FIELD_ELEVATION_S
        ):
            return False
        self._reset_s = now_s
        return True

# SPDX-License-Identifier: Apache-2.0
"""Whether the odometry frame is still the one that was calibrated."""

from typing import Optional


class CalibratedFrame:
    """Epochs of this vehicle's odometry: of now, and of the last calibration."""

    def __init__(self):
        self._epoch: Optional[int] = None
        self._calibrated: Optional[int] = None
        self._reason = ""

    def odometry(self, epoch: int, reason: str) -> bool:
        """The epoch of now, and why it began. Whether the frame was begun anew since the last
        call."""
        begun_anew = self._epoch is not None and epoch != self._epoch
        self._epoch, self._reason = epoch, reason
        return begun_anew

    def calibrated(self, epoch: int) -> None:
        """A calibration was made with this epoch."""
        self._calibrated = epoch

    @property
    def outdated(self) -> str:
        """Why the calibration does not hold any more; empty where it does, or where there is
        none."""
        if None in (self._epoch, self._calibrated) or self._epoch == self._calibrated:
            return ""
        return f"its odometry began anew after the calibration ({self._reason}); calibrate again"

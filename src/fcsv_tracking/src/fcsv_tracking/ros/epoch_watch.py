# SPDX-License-Identifier: Apache-2.0
"""Epochs of all vehicles' odometry: for which of them a calibration or home holds."""

import threading
from typing import Dict, Sequence

import rospy

from fcsv_msgs.msg import Epoch, Epochs
from fcsv_tracking.errors import CalibrationRefused


class EpochWatch:
    """Listens to every vehicle's odometry/epoch. A vehicle that sends none is in no message."""

    def __init__(self, names: Sequence[str]):
        self._lock = threading.Lock()
        self._epochs: Dict[str, int] = {}
        for name in names:
            rospy.Subscriber(f"/{name}/odometry/epoch", Epoch, self._on_epoch, name, queue_size=2)

    def now(self, names: Sequence[str]) -> Dict[str, int]:
        """The epochs of now, by vehicle."""
        with self._lock:
            return {n: self._epochs[n] for n in names if n in self._epochs}

    def require_same(self, before: Dict[str, int]) -> None:
        """Raises CalibrationRefused where an odometry began anew since."""
        now = self.now(list(before))
        other = [n for n in before if now[n] != before[n]]
        if other:
            raise CalibrationRefused(f"the odometry of {', '.join(other)} began anew meanwhile: calibrate once more")

    def _on_epoch(self, message: Epoch, name: str) -> None:
        with self._lock:
            self._epochs[name] = message.epoch


def to_message(stamp: rospy.Time, epochs: Dict[str, int]) -> Epochs:
    """For which epochs something holds that was found at ``stamp``."""
    message = Epochs(vehicles=list(epochs), epochs=list(epochs.values()))
    message.header.stamp = stamp
    return message

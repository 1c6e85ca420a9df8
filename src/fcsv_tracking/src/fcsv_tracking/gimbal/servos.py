# SPDX-License-Identifier: Apache-2.0
"""Interface of a gimbal's servos, real or simulated: command angles, read angles."""

import abc
from dataclasses import dataclass
from typing import Dict

from fcsv_tracking.errors import TrackingError
from fcsv_tracking.gimbal.geometry import Angles


class ServoError(TrackingError):
    """A servo does not answer, or says what is wrong with it; the message names the servo and the
    remedy."""


@dataclass(frozen=True)
class GimbalReading:
    """How the gimbal stood at ``stamp_s``."""

    stamp_s: float
    angles: Angles


class GimbalServos(abc.ABC):
    """A pan and a tilt servo. Every call may raise ServoError."""

    @abc.abstractmethod
    def turn(self, angles: Angles) -> None:
        """Turn there, and hold."""

    @abc.abstractmethod
    def read(self) -> GimbalReading:
        """Both angles at one moment."""

    @abc.abstractmethod
    def health(self) -> Dict[str, str]:
        """Gives figures, for diagnostics: values that a person reads (temperature, voltage, load),
        by name."""

    @abc.abstractmethod
    def close(self) -> None:
        """Let go: no torque from here on."""

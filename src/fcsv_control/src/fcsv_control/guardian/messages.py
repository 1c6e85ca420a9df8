# SPDX-License-Identifier: Apache-2.0
"""What a guardian wants done, and what it tells."""

from enum import IntEnum
from typing import Optional, Sequence, Tuple, Union

import numpy as np

from fcsv_geometry.frozen import frozen
from fcsv_geometry.vehicles.modes import Mode


def in_words(action: str, reasons: Sequence[str]) -> str:
    """What a guardian does and why, empty where it does nothing.

    >>> in_words("aside", ["uav2 comes down"]), in_words("hold", []), in_words("", ["uav2 is silent"])
    ('aside: uav2 comes down', 'hold', '')
    """
    return ": ".join(filter(None, (action, "; ".join(reasons)))) if action else ""


@frozen
class AskMode:
    """A mode command for the autopilot."""

    mode: Mode


@frozen
class HoldAt:
    """Where to be: T_odom_body, streamed while the guardian holds."""

    T_odom_body: np.ndarray


class Cause(IntEnum):
    """Why GUIDED is refused, as in fcsv_msgs/GuardianState: what others excuse has a number."""

    OTHER = 0
    STICK = 1  # the throttle stick is not in the middle
    NO_POSES = 2


@frozen
class Forbidden:
    """One reason why GUIDED is refused, and its words."""

    text: str
    cause: Cause = Cause.OTHER


@frozen
class GuardianVerdict:
    """``holds``: the agent must be quiet, why in ``reasons``; ``forbidden``: why GUIDED is refused;
    ``uncontrolled``: the vehicle comes down without a position; ``lost``: so it did, and nobody
    knows where it is since; ``lost_s``: so long it flew on; ``taken``: it is not in the companion's
    hands; ``going_to_m``: where it flies, in its odometry frame."""

    action: str = ""
    holds: bool = False
    uncontrolled: bool = False
    reasons: Tuple[str, ...] = ()
    forbidden: Tuple[Forbidden, ...] = ()
    lost: bool = False
    taken: bool = False
    going_to_m: Optional[Tuple[float, float, float]] = None
    lost_s: float = 0.0

    @property
    def forbids(self) -> Tuple[str, ...]:
        """Why GUIDED is refused, in words."""
        return tuple(f.text for f in self.forbidden)

    @property
    def causes(self) -> Tuple[Cause, ...]:
        """Why GUIDED is refused, as others excuse it."""
        return tuple(f.cause for f in self.forbidden)

    @property
    def in_words(self) -> str:
        """What is done and why, empty where nothing is done."""
        return in_words(self.action, self.reasons)


@frozen
class Warned:
    """A text for people; ``acts`` where the guardian does something."""

    text: str
    acts: bool


@frozen
class RestartLink:
    """The flight link's process ``pid`` hangs: end it, so that it is started again. Without it the
    autopilot gets no poses."""

    pid: int = 0


Output = Union[AskMode, HoldAt, RestartLink, Warned]

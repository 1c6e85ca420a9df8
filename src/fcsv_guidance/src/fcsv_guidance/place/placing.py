# SPDX-License-Identifier: Apache-2.0
"""The robot's place out of poses that somebody publishes."""

from collections import deque
from dataclasses import dataclass
from typing import Deque, Dict, Optional, Sequence

import numpy as np

from fcsv_geometry import frames, rotations
from fcsv_guidance.clock import ahead_of_clock
from fcsv_guidance.errors import DisputedPlaceError, PlaceError
from fcsv_guidance.messages import RobotPlace

_HEADING_RAD = 1.0  # a heading of a larger sigma leads nowhere
# so long after its last pose a publisher is gone: another may have taken its place
_GONE_S = 2.0
# faster steps from pose to pose are no motion: where a place is found anew one leads away, where
# two programs publish places they lead back, too
_FASTEST_MPS, _FASTEST_RADPS, _NOISE_M, _NOISE_RAD, _SIGMAS = 5.0, 3.0, 0.3, 0.7, 3.0
_MANY_STEPS = 3  # back, within _GONE_S


@dataclass(frozen=True)
class ReceivedPose:
    """A pose of the robot as a message says it. ``covariance``: 36 numbers as ROS has them, None
    where it has none; ``caller``: the program that published it, empty where nobody says."""

    stamp_s: float
    frame: str
    T_home_robot: np.ndarray
    covariance: Optional[Sequence[float]] = None
    caller: str = ""


class PoseIntake:
    """Poses of one publisher in the order of their stamps. ``sigma_m``: how well the place is known
    where no covariance says it."""

    def __init__(self, sigma_m: Optional[float]):
        self._sigma_m = sigma_m
        self._last: Optional[RobotPlace] = None
        self._before: Optional[RobotPlace] = None  # the one before that
        self._callers: Dict[str, float] = {}  # when each was heard last
        self._steps: Deque[float] = deque(maxlen=_MANY_STEPS)  # when one led back

    def receive(self, now_s: float, pose: ReceivedPose) -> RobotPlace:
        """The place of a pose. Raises PlaceError as ``robot_place`` does and where the pose is older
        than the last one, DisputedPlaceError where two programs publish it, or seem to."""
        self._require_one_caller(now_s, pose.caller)
        place = robot_place(
            now_s, pose.stamp_s, pose.frame, pose.T_home_robot, pose.covariance, self._sigma_m
        )
        last, before = self._last, self._before
        if last is not None and ahead_of_clock(now_s, last.stamp_s):
            last = before = None  # the clock was set back
        if last is not None and place.stamp_s < last.stamp_s:
            raise PlaceError(
                f"its stamp is {last.stamp_s - place.stamp_s:.2f} s older than the last one's; do two "
                "programs publish it?"
            )
        self._last, self._before = place, last
        if before is not None and _is_step(last, place) and not _is_step(before, place):
            self._steps.append(now_s)
        if len(self._steps) == _MANY_STEPS and abs(now_s - self._steps[0]) <= _GONE_S:
            raise DisputedPlaceError(
                "the poses of the robot contradict each other; do two programs publish them?"
            )
        return place

    def _require_one_caller(self, now_s: float, caller: str) -> None:
        heard = {c: s for c, s in self._callers.items() if abs(now_s - s) <= _GONE_S}
        self._callers = {**heard, caller: now_s}
        if len(self._callers) > 1:
            names = " and ".join(sorted(self._callers))
            raise DisputedPlaceError(f"{names} publish the robot's pose at once: stop all but one")


def robot_place(
    now_s: float,
    stamp_s: float,
    frame: str,
    T_home_robot: np.ndarray,
    covariance: Optional[Sequence[float]],
    sigma_m: Optional[float],
) -> RobotPlace:
    """The place of a pose in ``frame``. ``covariance``: 36 numbers as ROS has them; where there are
    none, or those of x and y are 0, ``sigma_m`` counts.

    Raises PlaceError where the frame is not home, the stamp lies ahead, the heading is not known,
    or nothing tells how well the place is known.
    """
    if frame != frames.HOME:
        raise PlaceError(
            f"its frame is '{frame}', not {frames.HOME}; publish the robot's pose in {frames.HOME}"
        )
    ahead = ahead_of_clock(now_s, stamp_s)
    if ahead:
        raise PlaceError(f"its stamp {ahead}")
    stated_m = None if covariance is None else _stated_sigma_m(covariance)
    sigma_m = sigma_m if stated_m is None else stated_m
    if sigma_m is None:
        raise PlaceError(
            "it has no covariance of x and y, and no sigma_m was given; say how well the robot's "
            "place is known"
        )
    yaw_rad = float(np.arctan2(T_home_robot[1, 0], T_home_robot[0, 0]))
    return RobotPlace(
        stamp_s, float(T_home_robot[0, 3]), float(T_home_robot[1, 3]), yaw_rad, sigma_m
    )


def _is_step(a: RobotPlace, b: RobotPlace) -> bool:
    """Whether the robot cannot have driven from place to place."""
    elapsed_s = b.stamp_s - a.stamp_s
    far_m = float(np.hypot(b.x_m - a.x_m, b.y_m - a.y_m))
    noise_m = _NOISE_M + _SIGMAS * (a.sigma_m + b.sigma_m)
    turned_rad = abs(rotations.wrap(b.yaw_rad - a.yaw_rad))
    return (
        far_m > _FASTEST_MPS * elapsed_s + noise_m
        or turned_rad > _FASTEST_RADPS * elapsed_s + _NOISE_RAD
    )


def _stated_sigma_m(covariance: Sequence[float]) -> Optional[float]:
    """What 36 numbers say of x and y together; None where they say nothing. A yaw variance of 0
    says nothing either. Raises PlaceError where they say that the place or heading is not known."""
    x, y, yaw = (float(covariance[k]) for k in (0, 7, 35))
    if not (np.isfinite([x, y]).all() and min(x, y) >= 0.0):
        raise PlaceError(f"its covariance of x and y ({x}, {y}) is none")
    if (x == 0.0) != (y == 0.0):
        raise PlaceError(f"its covariance of x and y ({x}, {y}) is only half filled in")
    if not 0.0 <= yaw <= _HEADING_RAD**2:
        raise PlaceError(
            f"its yaw variance ({yaw} rad^2) says that the heading is not known; "
            f"at most {_HEADING_RAD**2:g} rad^2 is driven by"
        )
    return float(np.sqrt(x + y)) if x > 0.0 else None

# SPDX-License-Identifier: Apache-2.0
"""What a flight link hears of its autopilot, tells, and is told, as data."""

from dataclasses import dataclass
from typing import Dict, Optional, Tuple, Union

import numpy as np

# ---- what the autopilot says ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class StateHeard:
    """A heartbeat came: the state may have changed."""


@dataclass(frozen=True)
class BatteryHeard:
    """The state's battery fields were told."""


@dataclass(frozen=True)
class PoseHeard:
    """The autopilot's estimate of the body (4x4) and its velocity (m/s) in its external navigation's frame (ENU)."""

    T_odom_body: np.ndarray
    v_odom_mps: Tuple[float, float, float]


@dataclass(frozen=True)
class BarometerHeard:
    """The autopilot's first barometer, as a height in the standard atmosphere: only differences mean something."""

    height_m: float


@dataclass(frozen=True)
class TextHeard:
    """A whole status text and its MAV_SEVERITY."""

    severity: int
    text: str


@dataclass(frozen=True)
class RcHeard:
    """The state's transmitter fields were told."""


@dataclass(frozen=True)
class EstimateMoved:
    """The autopilot's estimate moved by ``step_m`` (3,) (odometry frame) against the world: it adopted a jump of the
    external navigation, at once or over many messages. A target has to move along, or the difference is flown.
    """

    step_m: np.ndarray


@dataclass(frozen=True)
class Refused:
    """The autopilot refused what another component of this computer (MAVROS) asked for."""

    reason: str


@dataclass(frozen=True)
class HomeHeard:
    """How far the autopilot's home is above its origin."""

    above_origin_m: float


Event = Union[
    StateHeard, BatteryHeard, PoseHeard, BarometerHeard, TextHeard, RcHeard, EstimateMoved, Refused, HomeHeard,
]  # fmt: skip


# ---- what processes on board tell each other -----------------------------------------------------------------


@dataclass(frozen=True)
class PoseFed:
    """T_odom_body of the odometry, as it goes to the autopilot."""

    T_odom_body: np.ndarray


@dataclass(frozen=True)
class PoseEstimated:
    """T_odom_body by the autopilot's estimate."""

    T_odom_body: np.ndarray


@dataclass(frozen=True)
class LinkLives:
    """What the flight link tells of itself; fields as in fcsv_msgs/LinkHealth, ``in_the_air`` None: it has not said."""

    doubt: str
    ekf_variance: float
    throttle: float
    throttle_age_s: float
    system_status: int
    origin_set: bool
    parameters_ok: bool
    parameter: str
    in_the_air: Optional[bool]
    connected: bool
    pid: int


@dataclass(frozen=True)
class AutopilotLimits:
    """The autopilot's parameters that limit how it flies, in its units."""

    values: Dict[str, float]


@dataclass(frozen=True)
class ModeAsked:
    """A process on board asks the autopilot for a mode."""

    mode: str

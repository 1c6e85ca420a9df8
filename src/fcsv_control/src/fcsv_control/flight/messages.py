# SPDX-License-Identifier: Apache-2.0
"""What a flight link hears of its autopilot, tells, and is told, as data."""

from enum import IntEnum
from typing import Dict, Optional, Sequence, Tuple, Union

import numpy as np

from fcsv_control.errors import CommandRefused, LinkError
from fcsv_geometry.frozen import frozen
from fcsv_geometry.vehicles.modes import Mode

# ---- what the autopilot says ---------------------------------------------------------------------


@frozen
class StateReceived:
    """A heartbeat came: the state may have changed."""


@frozen
class BatteryReceived:
    """The state's battery fields were told."""


@frozen
class PoseReceived:
    """The autopilot's estimate of the body (4x4) and its velocity (m/s) in its external
    navigation's frame (ENU)."""

    T_odom_body: np.ndarray
    v_odom_mps: Tuple[float, float, float]


@frozen
class BarometerReceived:
    """The autopilot's first barometer, as a height in the standard atmosphere: only differences
    mean something."""

    height_m: float


class FixStatus(IntEnum):
    """What a GPS fix was helped by, as in sensor_msgs/NavSatStatus."""

    ALONE = 0
    SATELLITES = 1
    GROUND = 2


@frozen
class FixReceived:
    """A three-dimensional GPS fix (WGS 84): degrees, m above the ellipsoid, standard deviations per
    axis (m); NaN: not told. The vehicle is not flown by it."""

    status: FixStatus
    latitude_deg: float
    longitude_deg: float
    height_m: float
    sigma_m: float
    height_sigma_m: float


@frozen
class TextReceived:
    """A whole status text and its MAV_SEVERITY."""

    severity: int
    text: str


@frozen
class RcReceived:
    """The state's transmitter fields were told."""


@frozen
class EstimateMoved:
    """The autopilot's estimate moved by ``step_m`` (3,) (odometry frame) against the world: it
    adopted a jump of the external navigation, at once or over many messages. A target has to move
    along, or the difference is flown.
    """

    step_m: np.ndarray


@frozen
class Refused:
    """The autopilot refused what another component of this computer (MAVROS) asked for."""

    reason: str


@frozen
class HomeReceived:
    """How far the autopilot's home is above its origin."""

    above_origin_m: float


Event = Union[
    StateReceived,
    BatteryReceived,
    PoseReceived,
    BarometerReceived,
    FixReceived,
    TextReceived,
    RcReceived,
    EstimateMoved,
    Refused,
    HomeReceived,
]


# ---- the line ------------------------------------------------------------------------------------


@frozen
class FromAutopilot:
    """A MAVLink message came."""

    message: object


@frozen
class ToAutopilot:
    """A MAVLink message is to be sent."""

    message: object


# ---- what processes on board tell each other -----------------------------------------------------


@frozen
class PoseFed:
    """T_odom_body of the odometry, as it goes to the autopilot; ``stamp_s`` by this computer's time
    of day."""

    T_odom_body: np.ndarray
    stamp_s: float


@frozen
class PosePassed:
    """A pose of the odometry was believed, and went to the autopilot."""


@frozen
class OdometryReset:
    """The odometry's frame was begun anew: the next pose is adopted at once."""


@frozen
class PoseEstimated:
    """T_odom_body by the autopilot's estimate."""

    T_odom_body: np.ndarray


@frozen
class AutopilotState:
    """What the autopilot shows; fields as in mavros_msgs/State."""

    connected: bool
    armed: bool
    guided: bool
    manual_input: bool
    mode: Mode
    system_status: int


@frozen
class BatteryReading:
    """The autopilot's battery monitor: share of the charge 0..1, voltage, current; NaN: not
    known."""

    share: float
    voltage_v: float
    current_a: float


@frozen
class TransmitterReading:
    """The pilot's transmitter: pulse widths (us), signal strength 0..254 (255: not known)."""

    channels: Tuple[int, ...]
    rssi: int


@frozen
class LinkLives:
    """What the flight link tells of itself; fields as in fcsv_msgs/LinkHealth, None: the autopilot
    has not said."""

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
    ekf_flags: int
    ekf_age_s: float
    feed_rate_hz: float
    feed_age_s: float
    estimate_apart_m: float
    prearm_ok: Optional[bool]


@frozen
class AutopilotLimits:
    """The autopilot's parameters that limit how it flies, in its units; NaN: not read yet."""

    values: Dict[str, float]


@frozen
class ParametersChecked:
    """The autopilot's parameters against the profile; fields as in fcsv_msgs/ParameterReport."""

    profile: str
    firmware: str
    complete: bool
    blocks: Sequence[str]
    advises: Sequence[str]
    unknown: Sequence[str]
    limits: AutopilotLimits


@frozen
class ModeAsked:
    """A process on board asks the autopilot for a mode."""

    mode: Mode


@frozen
class LinkText:
    """The flight link's own words to people, and their MAV_SEVERITY."""

    severity: int
    text: str


@frozen
class RequestOver:
    """An Ask has ended: done where ``refusal`` is empty. ``answered``: by the autopilot, or by this
    link itself."""

    number: int
    refusal: str = ""
    answered: bool = True

    def require_done(self) -> None:
        """Raises CommandRefused with the reason, LinkError where nobody answered."""
        if self.refusal:
            raise CommandRefused(self.refusal) if self.answered else LinkError(self.refusal)

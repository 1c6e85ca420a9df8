# SPDX-License-Identifier: Apache-2.0
"""What a vehicle tells of itself, and what the calibration tells of all, as data: what ports are
given and give.

A message here is what a topic carries, without its transport. ``publisher`` is the node from which
it came to this machine (a relay where it crossed the radio; empty: not known), ``topic`` the topic
below the vehicle's name.
"""

from typing import ClassVar, Dict, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry.frozen import frozen
from fcsv_geometry.home import OdomLink
from fcsv_geometry.vehicles.modes import Mode


@frozen
class VehicleOdometry:
    """Its place T_odom_body (4, 4) in its own odometry frame, its velocity (3,) m/s in the body's
    axes; ``stamp_s`` is by the time of day of its computer."""

    topic: ClassVar[str] = "odometry/state"
    vehicle: str
    publisher: str
    stamp_s: float
    T_odom_body: np.ndarray
    v_body_mps: Tuple[float, float, float]


@frozen
class OdometryEpoch:
    """Its odometry began for the ``number``-th time, for a reason."""

    topic: ClassVar[str] = "odometry/epoch"
    vehicle: str
    publisher: str
    number: int
    reason: str


@frozen
class VehicleHeight:
    """Its height (m) by the autopilot's estimate, in the odometry frame."""

    topic: ClassVar[str] = "mavros/local_position/pose"
    vehicle: str
    publisher: str
    z_m: float


@frozen
class VehicleState:
    """What its autopilot shows; ``mode`` empty: its flight link hears no autopilot."""

    topic: ClassVar[str] = "mavros/state"
    vehicle: str
    publisher: str
    mode: Mode
    armed: bool
    connected: bool


@frozen
class GuardianStatus:
    """What its guardian does, and why, in words; ``lost``: nobody knows where it is, ``lost_s``: so
    long it flew on."""

    topic: ClassVar[str] = "guardian/state"
    vehicle: str
    publisher: str
    words: str
    lost: bool
    lost_s: float


@frozen
class BatteryCharge:
    """The share of its charge that is left, 0..1; NaN: not known."""

    topic: ClassVar[str] = "mavros/battery"
    vehicle: str
    publisher: str
    share: float


@frozen
class RecorderState:
    """What is wrong with its recorder (empty: nothing), and how many pictures it has recorded."""

    topic: ClassVar[str] = "recorder/status"
    vehicle: str
    publisher: str
    problem: str
    pictures: int


@frozen
class SeenTag:
    """A tag in a picture: corners (4, 2) as undistorted x/z, y/z in the detector's order;
    ``p_cam_tag_m`` (3,) in the camera's optical frame, None where its pose is none."""

    id: int
    size_m: float
    corners_normalized: np.ndarray
    p_cam_tag_m: Optional[np.ndarray]


@frozen
class SeenTags:
    """The tags in one picture of a vehicle; T_odom_cam (4, 4) of its camera at ``stamp_s``, None
    where it is none."""

    topic: ClassVar[str] = "tags/detections"
    vehicle: str
    publisher: str
    stamp_s: float
    T_odom_cam: Optional[np.ndarray]
    focal_px: float
    tags: Sequence[SeenTag]

    @property
    def lacks_a_pose(self) -> bool:
        """Whether the camera's or a tag's pose was none."""
        return self.T_odom_cam is None or any(t.p_cam_tag_m is None for t in self.tags)


@frozen
class SceneLook:
    """What two pictures of a vehicle say of its tracker's motion between them: see
    SceneMotion.msg."""

    span_s: float
    off_rad: float
    turn_rad: float
    points: int
    one_way: float


@frozen
class RelayAges:
    """A relay measured when the newest messages of topics were sent, by this machine's monotonic
    clock (s)."""

    topics: Sequence[str]
    sent_s: Sequence[float]


@frozen
class CalibrationFound:
    """The links of a calibration, for the moment ``stamp_s``."""

    stamp_s: float
    links: Sequence[OdomLink]


@frozen
class HomeFound:
    """T_odom_home (4, 4) in the odometry of ``reference``."""

    stamp_s: float
    reference: str
    T_odom_home: np.ndarray


CALIBRATION, HOME = "calibration", "home"


@frozen
class EpochsFound:
    """Says for which epochs of the vehicles' odometry a CALIBRATION or HOME (``of``) holds."""

    of: str
    stamp_s: float
    epochs: Dict[str, int]


@frozen
class MissionPhase:
    """The mission is in this phase."""

    phase: str


@frozen
class Reply:
    """Answers to who called a service: whether it is done, and what to read; ``clocks_apart``: it
    is not done because two clocks differ; ``drifted``: because a tracker does."""

    done: bool
    text: str
    clocks_apart: bool = False
    drifted: bool = False


@frozen
class Dropped:
    """Something that was heard is of no use: what, for counts, and why."""

    what: str
    why: str


@frozen
class Diagnosis:
    """Is for diagnostics: problems by their key (empty: none), and values."""

    problems: Dict[str, str]
    values: Dict[str, object]

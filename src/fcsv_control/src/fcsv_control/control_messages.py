# SPDX-License-Identifier: Apache-2.0
"""What the control PC's processes tell each other, and are asked, as data."""

from typing import List, Sequence

from fcsv_control.agent.messages import Ack
from fcsv_control.flight_check.lines import Line
from fcsv_control.mission.ways.places import FollowPlace
from fcsv_geometry.frozen import frozen
from fcsv_geometry.missions.stations import HOME_VIEW
from fcsv_geometry.vehicles.telemetry import MissionPhase

# ---- requests ------------------------------------------------------------------------------------


@frozen
class Confirm:
    """The operator confirms a step of the mission."""

    step: str


@frozen
class Operate:
    """One of mission.operator_commands.OPERATIONS."""

    operation: str


@frozen
class Execute:
    """Fly these configurations (none: all)."""

    configurations: Sequence[int]


@frozen
class FollowAsked:
    """A vehicle is asked to fly to a place in ``frame``, which must be home, while vehicles
    follow."""

    frame: str
    vehicle: str
    place: FollowPlace


@frozen
class Abort:
    """The operator lands everybody whom the mission flies."""


@frozen
class Cancel:
    """Who asked for configurations does not want them any more."""


@frozen
class StopCalled:
    """Somebody calls to stop or to land everybody (``asked``: stopping.STOP or LAND)."""

    asked: str
    reason: str


# ---- messages ------------------------------------------------------------------------------------


@frozen
class CommandAnswered:
    """A vehicle's agent answered a command."""

    vehicle: str
    ack: Ack

    @property
    def outcome(self) -> str:
        """Empty when done, else why not."""
        return "" if self.ack.result == 0 else self.ack.reason or "refused without a reason"


@frozen
class WallClock:
    """The time of day ``wall_s``, read between two looks at the monotonic clock."""

    before_s: float
    wall_s: float
    after_s: float


@frozen
class CheckTable:
    """The fleet's flight check; it counts for ``patience_s``."""

    lines: Sequence[Line]
    patience_s: float


@frozen
class PairLooked:
    """Whether the pictures of two vehicles show another place than their trackers."""

    reference: str
    vehicle: str
    off: bool


@frozen
class StopOver:
    """The operator goes on after everybody was stopped."""

    reason: str


@frozen
class ServiceWanted:
    """The mission calls "calibrate", "set_home" or "calibrate_in_flight"."""

    name: str


@frozen
class ServiceAnswered:
    """How that ended."""

    name: str
    done: bool
    text: str
    drifted: bool = False  # it is not done because a tracker drifts


@frozen
class MissionAlive:
    """The mission lives and commands as ``sender``, whose monotonic clock says ``sent_s``."""

    sender: str
    sent_s: float


@frozen
class MissionStatus(MissionPhase):
    """Where the mission is; ``captured``: indices of configurations that are recorded, ``progress``
    0..1; ``station`` and ``heading_rad``: from where the running configuration is flown."""

    detail: str
    waits_for: str
    stage: str
    configuration: int
    problems: List[str]
    over: bool
    progress: float
    captured: List[int]
    station: str = HOME_VIEW.station
    heading_rad: float = HOME_VIEW.heading_rad


@frozen
class FramesJudged:
    """Whether calibration and home of before a restart count: the mission goes on by them, or
    begins anew."""

    count: bool

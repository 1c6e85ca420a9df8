# SPDX-License-Identifier: Apache-2.0
"""What a guardian knows of its own vehicle and of the others at one moment."""

import math
from dataclasses import dataclass, field
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_control.flight.pose_feed.estimate import apart_m
from fcsv_control.recent_way import RecentWay
from fcsv_geometry import transforms
from fcsv_geometry.frozen import changed, frozen
from fcsv_geometry.missions import separation
from fcsv_geometry.missions.airspace import Occupant
from fcsv_geometry.missions.fence import Fence
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.streams.stream import Stream
from fcsv_geometry.vehicles.modes import Mode

_INF = float("inf")
_FLYING_M = 0.5  # above where it stood
AUTOPILOT_FAILSAFE = (5, 6)  # MAV_STATE_CRITICAL, MAV_STATE_EMERGENCY
_SMOOTH_S, _SAME_S = 0.3, 0.005  # of how another moves; less apart it is the same message
_GOES_ON_S, _FLIES_MPS = (1.0, 2.0, 3.0), 0.5  # of one that comes down on its way


@frozen
class LinkReport:
    """What the flight link says of the autopilot and of the feed; ``throttle`` -1..1, NaN without a
    transmitter."""

    doubt: str = ""  # PoseCheck's
    ekf_variance: float = 0.0  # the largest
    throttle: float = math.nan
    failsafe: bool = False
    origin_set: bool = True
    parameters_ok: bool = True
    parameter: str = ""  # the first that does not fit
    in_the_air: Optional[bool] = None  # as the autopilot says; None: it has not
    connected: bool = True  # its heartbeat is heard


@frozen
class Other:
    """Another vehicle as heard last; position (m) in home. ``uncontrolled``: it comes down without
    a position; ``lost``: so it did, and where it is was last known then; ``taken``: a pilot has it,
    or its autopilot."""

    p_home_m: np.ndarray
    heard_s: float
    speed_mps: float = 0.0
    armed: bool = True
    mode: Mode = Mode.UNHEARD
    uncontrolled: bool = False
    sigma_m: float = 0.0  # of its place in home, as calibration left it
    lost: bool = False
    lost_s: float = 0.0  # so long it flew without a position, as it tells
    taken: bool = False
    going_to_m: Optional[np.ndarray] = None  # where it was sent, in home
    # (3,) as it was heard to move
    v_home_mps: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def after(self, before: Optional["Other"]) -> "Other":
        """Gives the vehicle with how it moved since it was heard before. What it says of a place
        that it has lost counts for nothing."""
        if before is None:
            return self
        since_s, v_mps = self.heard_s - before.heard_s, before.v_home_mps
        if self.astray:
            return changed(self, p_home_m=before.p_home_m, v_home_mps=v_mps)
        if since_s > _SMOOTH_S:
            v_mps = (self.p_home_m - before.p_home_m) / since_s
        elif since_s > _SAME_S:
            v_mps = v_mps + ((self.p_home_m - before.p_home_m) - since_s * v_mps) / _SMOOTH_S
        return changed(self, v_home_mps=v_mps)

    @property
    def astray(self) -> bool:
        """Whether what it says of its place counts for nothing."""
        return self.uncontrolled or self.lost

    def reach_m(self, now_s: float) -> float:
        """How far from where it was last known it may lie, of one that is lost."""
        return separation.lost_reach_m(self.lost_s + (now_s - self.heard_s if self.armed else 0.0))

    def places_m(self, now_s: float, silent_s: float) -> List[np.ndarray]:
        """Where to look for it: one that has been silent for longer than ``silent_s`` may have
        flown on to where it was sent, and one that comes down as it flies goes on that way, if it
        has no position for seconds."""
        flew_on = (
            self.going_to_m is not None and now_s - self.heard_s > silent_s and not self.astray
        )
        places = [self.p_home_m, self.going_to_m] if flew_on else [self.p_home_m]
        if self.armed and (self.uncontrolled or self.mode == Mode.LAND):
            level_mps = self.v_home_mps * [1.0, 1.0, 0.0]
            if float(np.linalg.norm(level_mps)) > _FLIES_MPS:
                places += [self.p_home_m + s * level_mps for s in _GOES_ON_S]
        return places

    def occupant(self, now_s: float, silent_s: float) -> Occupant:
        """What it occupies; one that lies on the ground, lost, has no height."""
        return Occupant(
            self.places_m(now_s, silent_s),
            None,
            self.astray,
            self.reach_m(now_s) if self.lost else 0.0,
            self.lost and not self.armed,
        )


@dataclass
class VehicleSituation:
    """Own times are when something was heard last; poses T_odom_body."""

    mode: Mode = Mode.UNHEARD
    armed: bool = False
    state_s: float = -_INF
    feed: Stream[np.ndarray] = field(default_factory=Stream)  # of the odometry
    estimate: Optional[np.ndarray] = None
    take_off: Optional[np.ndarray] = None  # estimate when last on the ground
    epoch: Optional[int] = None  # of the odometry
    take_off_epoch: Optional[int] = None  # in another one ``take_off`` is elsewhere
    lost: bool = False  # its tracker failed in this flight: where it is, is not known since
    lost_since_s: Optional[float] = None
    lost_epoch: Optional[int] = None  # of the odometry, as it was lost
    calibrated: Optional[int] = None  # the epoch of the last calibration
    lost_s: float = 0.0  # so long it has flown without a position
    sent_to: Optional[np.ndarray] = None  # T_odom_body, where the mission sent it
    slows_mps2: float = FlightBounds.acceleration_mps2  # as it stops or lands
    confidence: float = math.nan
    link: LinkReport = field(default_factory=LinkReport)
    link_s: float = -_INF
    battery: Stream[float] = field(default_factory=Stream)  # share of the charge; NaN: not known
    control_s: float = -_INF
    agent_s: float = -_INF
    T_home_odom: Optional[np.ndarray] = None
    sigma_m: float = 0.0  # of its own place in home, as calibration left it
    mission_fence: Optional[Fence] = None  # besides the guardian's own
    others: Dict[str, Other] = field(default_factory=dict)
    way: RecentWay = field(default_factory=RecentWay)
    _in_home: Tuple = (None, None, None)  # T_home_odom and estimate, and the place in home by them

    def began_anew(self, epoch: int) -> None:
        """Forgets the places of the odometry, where it is another one: where it was sent is
        elsewhere now."""
        self.sent_to = self.sent_to if epoch == self.epoch else None
        self.epoch = epoch

    def going_to_m(self, place: Optional[np.ndarray]) -> Optional[Tuple[float, float, float]]:
        """Where it flies, in the odometry frame: to ``place`` (T_odom_body) where the guardian
        holds it, else to where the mission sent it. None where nobody on board steers it."""
        there = self.sent_to if place is None else place
        return None if there is None or self.mode != Mode.GUIDED else tuple(there[:3, 3].tolist())

    def fed(self, now_s: float, T_odom_body: np.ndarray) -> None:
        """A pose came from the odometry."""
        self.feed.tell(now_s, T_odom_body)

    def estimated(self, now_s: float, T_odom_body: np.ndarray) -> None:
        """The autopilot's estimate came."""
        self.estimate = T_odom_body
        self.way.add(now_s, T_odom_body[:3, 3])

    def lose(self, now_s: float, blind: bool, found: bool) -> None:
        """It is lost from when it is ``blind`` until its next take-off, or until it is ``found``;
        and where its odometry, that began anew since, was calibrated again: people flew it, and its
        place is known by that. What lies on the ground drifts no further."""
        anew = self.calibrated == self.epoch and self.epoch != self.lost_epoch
        self.lost = blind or (self.lost and not found and not anew)
        if not self.lost:
            self.lost_since_s, self.lost_s = None, 0.0
        elif self.armed:
            if self.lost_since_s is None:
                self.lost_since_s, self.lost_epoch = now_s, self.epoch
            self.lost_s = now_s - self.lost_since_s

    def slept(self, seconds: float) -> None:
        """This process itself did not run for so long."""
        self.feed.at_s += seconds
        self.battery.at_s += seconds
        for name in ("link_s", "agent_s", "control_s"):
            setattr(self, name, getattr(self, name) + seconds)

    def battery_now(self, now_s: float, old_s: float) -> float:
        """0..1; NaN where it is not known, or was last heard ``old_s`` ago."""
        return self.battery.value if self.battery.fresh(now_s, old_s) else math.nan

    @property
    def flying(self) -> bool:
        """Armed and off the ground, as the autopilot believes."""
        if self.armed and self.link.in_the_air is not None:
            return self.link.in_the_air
        if not self.armed or self.estimate is None or self.take_off is None:
            return self.armed
        return bool(self.estimate[2, 3] - self.take_off[2, 3] > _FLYING_M)

    @property
    def apart_m(self) -> float:
        """Between the tracker's pose and the estimate; NaN where one of them is not known."""
        return apart_m(
            *(None if T is None else T[:3, 3].tolist() for T in (self.feed.value, self.estimate))
        )

    @property
    def p_odom_m(self) -> np.ndarray:
        """(3,) the estimate's place in the odometry frame; its origin while there is none."""
        return np.zeros(3) if self.estimate is None else self.estimate[:3, 3]

    @property
    def from_take_off_m(self) -> Optional[np.ndarray]:
        """(3,) the place against the take-off place; None while either is not known."""
        if self.estimate is None or self.take_off is None:
            return None
        return self.estimate[:3, 3] - self.take_off[:3, 3]

    @property
    def p_home_m(self) -> Optional[np.ndarray]:
        """(3,) in home; None while home is not known."""
        T_home_odom, T_odom_body = self.T_home_odom, self.estimate
        if T_odom_body is None or T_home_odom is None:
            return None
        home, body, p_home_m = self._in_home
        # several watches ask for it in every step
        if home is not T_home_odom or body is not T_odom_body:
            p_home_m = transforms.apply(T_home_odom, T_odom_body[:3, 3])
            self._in_home = (T_home_odom, T_odom_body, p_home_m)
        return p_home_m

    @property
    def p_home_stop_m(self) -> Optional[np.ndarray]:
        """(3,) where it comes to a stand if it is to land now; None while home is not known."""
        here = self.p_home_m
        if here is None:
            return None
        return separation.stop_m(
            here, self.T_home_odom[:3, :3] @ self.way.velocity_mps(), self.slows_mps2
        )

    def tilt_rad(self) -> float:
        """Gives the angle of the body's up axis against the vertical."""
        return (
            0.0
            if self.estimate is None
            else math.acos(max(-1.0, min(1.0, float(self.estimate[2, 2]))))
        )

# SPDX-License-Identifier: Apache-2.0
"""What the control PC has heard of one vehicle. Ages count from when it was sent, as the relay here
measured it by monotonic clocks: no stamp of a sender enters an age."""

import math
from dataclasses import dataclass
from typing import Callable, Optional, Sequence

import numpy as np

from fcsv_control.mission.snapshot import VehicleView
from fcsv_geometry import transforms
from fcsv_geometry.home import camera_in_home
from fcsv_geometry.missions import separation
from fcsv_geometry.vehicles import thresholds as at
from fcsv_geometry.vehicles.modes import Mode

_TAG_GAP_S = 2.5  # a camera on a slow computer takes a picture a second
_SIGHT_OLD_S = 0.5  # where it was seen longer ago it may not be any more
_NEVER_S = -math.inf
# topics whose age counts, and all of them
ODOMETRY, STATE, BATTERY = "odometry/state", "mavros/state", "mavros/battery"
GUARDIAN, RECORDER = "guardian/state", "recorder/status"
AGED = (ODOMETRY, STATE, BATTERY, GUARDIAN, RECORDER)


def _as_it_came(_topic: str, came_s: float) -> float:
    return came_s


@dataclass
class FrameEpochs:
    """Holds the epochs of a vehicle's odometry: its epoch now, and those for which calibration and
    home hold; None: not heard."""

    now: Optional[int] = None
    reason: str = ""
    calibration: Optional[int] = None
    home: Optional[int] = None

    @property
    def problem(self) -> str:
        """Why calibration or home does not hold any more; empty where they do.

        >>> FrameEpochs(8, "the tracker was silent for 0.7 s", 7).problem
        'its odometry began anew (the tracker was silent for 0.7 s): calibrate and set home again'
        """
        if self.now is None or all(
            known in (None, self.now) for known in (self.calibration, self.home)
        ):
            return ""
        return f"its odometry began anew ({self.reason}): calibrate and set home again"


class VehicleTelemetry:
    """``now_s`` is monotonic time of this machine. ``since_s`` gives from when the newest message
    of a topic counts that came at some time: Arrivals.since_s, where a relay is between."""

    def __init__(
        self,
        T_body_cam: np.ndarray,
        since_s: Callable[[str, float], float] = _as_it_came,
        T_body_tag: Optional[np.ndarray] = None,
    ):
        self._since_s = since_s
        self._T_body_cam, self._T_body_tag = T_body_cam, T_body_tag
        self._p_odom_front_tag: Optional[np.ndarray] = None
        self.epochs = FrameEpochs()
        self._T_odom_body: Optional[np.ndarray] = None
        self._v_odom_mps: Optional[np.ndarray] = None
        self._odometry_s = self._state_s = self._recorder_s = _NEVER_S
        self._tag_s = self._tag_since_s = _NEVER_S
        self._z_m, self._ground_z_m = math.nan, 0.0  # no height is heard yet
        self._mode, self._armed, self._connected = Mode.UNHEARD, False, False
        self._battery_share, self._battery_s = math.nan, _NEVER_S
        self._guarded, self._guarded_s, self._lost, self._lost_s = "", _NEVER_S, False, 0.0
        self._problem, self._pictures, self._pictures_before = "", 0, 0

    def odometry(self, now_s: float, T_odom_body: np.ndarray, v_body_mps: Sequence[float]) -> None:
        """Its place in its own odometry frame, and velocity (3,) in the body's; where the place is
        lost, the last one that was believed stays."""
        if not self._lost:
            self._T_odom_body = T_odom_body
        self._v_odom_mps, self._odometry_s = (
            T_odom_body[:3, :3] @ np.asarray(v_body_mps, float),
            now_s,
        )

    def position(self, z_m: float) -> None:
        """Height by the autopilot's estimate. The ground is where it was last known not to be
        armed; of one that flew before anything was heard (a mission that began anew), where the
        estimate began."""
        self._z_m = z_m
        if self._mode and not self._armed:
            self._ground_z_m = z_m

    def state(self, now_s: float, mode: Mode, armed: bool, connected: bool) -> None:
        """What its autopilot shows. Without a mode its link hears no autopilot (yet): what it
        showed before stays."""
        self._connected, self._state_s = connected, now_s
        if mode:
            self._mode, self._armed = mode, armed

    def guardian(self, now_s: float, words: str, lost: bool, lost_s: float = 0.0) -> None:
        """What its guardian does and why; empty where it leaves the vehicle alone. ``lost``: its
        tracker failed in flight, and where it is has not been known since; ``lost_s``: so long it
        flew on."""
        self._guarded, self._guarded_s, self._lost, self._lost_s = words, now_s, lost, lost_s

    def battery(self, now_s: float, share: float) -> None:
        """0..1, NaN where unknown."""
        self._battery_share, self._battery_s = share, now_s

    def recorder(self, now_s: float, problem: str, pictures: int) -> None:
        """What its recorder says; one that is started again counts its pictures from nothing."""
        self._pictures_before += 0 if pictures >= self._pictures else self._pictures
        self._problem, self._pictures, self._recorder_s = problem, pictures, now_s

    def front_tag(self, now_s: float, p_odom_tag: Optional[np.ndarray] = None) -> None:
        """It has seen the tag of the vehicle in front: at (3,) in its own odometry frame, where
        that is known."""
        self._p_odom_front_tag = p_odom_tag
        if now_s - self._tag_s > _TAG_GAP_S:
            self._tag_since_s = now_s
        self._tag_s = now_s

    def _guardian_words(self, now_s: float) -> str:
        """Where one was heard it must go on being heard."""
        silent = (
            self._guarded_s != _NEVER_S
            and now_s - self._since_s(GUARDIAN, self._guarded_s) > at.GUARDIAN_AGE_S.mission.red
        )
        return "it is silent" if silent else self._guarded

    def _astray_m(self, now_s: float, pose_age_s: float) -> float:
        """How far from where it was last known it may be: of one that is lost, which in silence
        flies on, and of one that is silent, whom its guardian moves aside of others; 0 of all
        others."""
        if self._lost:
            silent_s = now_s - self._since_s(GUARDIAN, self._guarded_s) if self._armed else 0.0
            return separation.lost_reach_m(self._lost_s + silent_s)
        silent = self._armed and pose_age_s > at.POSE_AGE_S.mission.red
        return separation.SILENT_REACH_M if silent else 0.0

    def pose_age_s(self, now_s: float) -> float:
        """Since its newest pose was sent."""
        return now_s - self._since_s(ODOMETRY, self._odometry_s)

    def state_age_s(self, now_s: float) -> float:
        """Since its newest state was sent."""
        return now_s - self._since_s(STATE, self._state_s)

    def view(self, now_s: float, T_home_odom: Optional[np.ndarray]) -> VehicleView:
        """The vehicle now; its place in home where ``T_home_odom`` is known."""
        known = self._T_odom_body is not None and T_home_odom is not None
        seen = now_s - self._tag_s < _TAG_GAP_S
        tagged = known and self._T_body_tag is not None and not self._lost
        p_tag = (T_home_odom @ self._T_odom_body @ self._T_body_tag)[:3, 3] if tagged else None
        p_front = self._p_odom_front_tag if known and now_s - self._tag_s < _SIGHT_OLD_S else None
        pose_age_s, state_s = self.pose_age_s(now_s), self._since_s(STATE, self._state_s)
        battery_s = self._since_s(BATTERY, self._battery_s)
        return VehicleView(
            pose_age_s=pose_age_s,
            speed_mps=math.inf
            if self._v_odom_mps is None
            else math.sqrt(self._v_odom_mps @ self._v_odom_mps),
            v_home_mps=T_home_odom[:3, :3] @ self._v_odom_mps
            if known and not self._lost
            else np.zeros(3),
            height_m=self._z_m - self._ground_z_m,
            state_age_s=now_s - state_s,
            connected=self._connected,
            armed=self._armed,
            mode=self._mode,
            sees_front_s=self._tag_s - self._tag_since_s if seen else 0.0,
            T_home_cam=camera_in_home(T_home_odom, self._T_odom_body, self._T_body_cam)
            if known
            else None,
            battery_share=self._battery_share
            if state_s - battery_s <= at.BATTERY_AGE_S.mission.red
            else math.nan,
            recorder_age_s=now_s - self._since_s(RECORDER, self._recorder_s),
            recorder_problem=self._problem,
            pictures=None
            if self._recorder_s == _NEVER_S
            else self._pictures_before + self._pictures,
            guarded=self._guardian_words(now_s),
            frame_problem=self.epochs.problem,
            lost=self._lost,
            astray_m=self._astray_m(now_s, pose_age_s),
            p_home_tag=p_tag,
            p_home_front_tag=None
            if p_front is None or self._lost
            else transforms.apply(T_home_odom, p_front),
        )

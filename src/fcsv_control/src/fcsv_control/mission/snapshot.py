# SPDX-License-Identifier: Apache-2.0
"""What the mission knows of its vehicles at one moment."""

from dataclasses import field
from typing import Dict, Optional

import numpy as np

from fcsv_geometry.frozen import frozen
from fcsv_geometry.missions import separation
from fcsv_geometry.missions.airspace import Occupant
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.thresholds import STATE_AGE_S

_INF = float("inf")


@frozen
class VehicleView:
    """One vehicle as heard over the radio; ages in s, infinite where nothing came yet."""

    pose_age_s: float = _INF
    speed_mps: float = _INF
    # (3,), once calibration and home are known
    v_home_mps: np.ndarray = field(default_factory=lambda: np.zeros(3))
    # by the autopilot's estimate, above where it stood disarmed; NaN until one is heard
    height_m: float = 0.0
    state_age_s: float = _INF
    connected: bool = False
    armed: bool = False
    mode: Mode = Mode.UNHEARD
    sees_front_s: float = 0.0  # for how long it has seen the tag of the vehicle in front
    T_home_cam: Optional[np.ndarray] = None  # once calibration and home are known
    battery_share: float = float("nan")  # 0..1, NaN where unknown
    recorder_age_s: float = _INF
    recorder_problem: str = ""
    pictures: Optional[int] = None  # recorded so far, None where unknown
    guarded: str = ""  # what its guardian does, and why
    lost: bool = False  # its place is the last one before its tracker failed
    # so far from its last place, horizontally, it may be: it is lost, or silent
    astray_m: float = 0.0
    frame_problem: str = ""  # why its odometry frame is not the one that was calibrated
    p_home_tag: Optional[np.ndarray] = None  # (3,) of the tag that it carries, by its own tracker
    # (3,) of the tag in front, as it sees it now by its own tracker
    p_home_front_tag: Optional[np.ndarray] = None
    sighted_off: str = ""  # what was seen elsewhere than trackers say (TagInFront, PairsSeen)

    @property
    def fresh(self) -> bool:
        """Whether its state counts: what an older one says may have changed."""
        return self.state_age_s <= STATE_AGE_S.mission.red

    @property
    def down(self) -> bool:
        """Whether it was just heard with its motors off."""
        return self.fresh and not self.armed


@frozen
class RecorderView:
    """The control PC's own recorder: age (s) of what it said last, and what is wrong with it."""

    age_s: float = _INF
    problem: str = ""


@frozen
class Snapshot:
    """All vehicles, and T_home_odom and T_body_cam of each where known; ``recorder`` None: none is
    asked for. ``clock_set``: how often this machine's time of day was set. ``slows_mps2``: by how
    much who stops slows down."""

    now_s: float
    vehicles: Dict[str, VehicleView]
    T_home_odom: Dict[str, np.ndarray] = field(default_factory=dict)
    T_body_cam: Dict[str, np.ndarray] = field(default_factory=dict)
    recorder: Optional[RecorderView] = None
    clock_set: int = 0
    slows_mps2: float = FlightBounds.acceleration_mps2

    def p_home_cam(self, name: str) -> np.ndarray:
        """Position (m) of a vehicle's camera in home; only where it is known."""
        return self.vehicles[name].T_home_cam[:3, 3]

    def occupant(self, name: str) -> Occupant:
        """What a vehicle occupies in home; only where its place is known."""
        here, view = self.p_home_cam(name), self.vehicles[name]
        stop = separation.stop_m(here, view.v_home_mps, self.slows_mps2)
        lies = not (view.lost and view.armed)  # as far as it is astray at all
        return Occupant([here], stop, view.lost, view.astray_m, lies)

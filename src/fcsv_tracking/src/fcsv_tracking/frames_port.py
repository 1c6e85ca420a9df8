# SPDX-License-Identifier: Apache-2.0
"""The process of the frames without its transport: odometry, calibration and home in; odometry
frames in home, and cameras in home with how well they are known, out."""

import math
from dataclasses import dataclass
from typing import List, Mapping, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry import frames
from fcsv_geometry.home import HomeFrames, Place, camera_in_home
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.streams.flow import RateGate
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_geometry.vehicles.tracker import TrackerProfile
from fcsv_geometry.vehicles.vehicle import VehicleGeometry
from fcsv_tracking.column.camera_covariance import AgeRules, camera_covariance, stale_reason
from fcsv_tracking.column.drift import Drift

_HOME_S = 0.1


@dataclass(frozen=True)
class OdometryCame:
    """A vehicle's odometry with its covariance (36,), row-major; ``frames`` are the names of parent
    and child."""

    vehicle: str
    frames: Tuple[str, str]
    stamp_s: float
    T_odom_body: np.ndarray
    covariance: Sequence[float]


@dataclass(frozen=True)
class BodyAt:
    """T_odom_body of a vehicle, at most so often as is wanted."""

    vehicle: str
    stamp_s: float
    T_odom_body: np.ndarray


@dataclass(frozen=True)
class OdomsInHome:
    """T_home_odom (4, 4) by vehicle."""

    T_home_odom: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class CameraAt:
    """T_home_cam of a vehicle; covariance (6, 6) of position (m) and rotation (rad) about home's
    axes."""

    vehicle: str
    stamp_s: float
    T_home_cam: np.ndarray
    covariance: np.ndarray


class FramesPort:
    """Only frames that are known are given; before home there is none above an odometry's.

    ``rate_hz``: of what is given of each vehicle. Gives BodyAt, CameraAt with its tm.Diagnosis,
    OdomsInHome ten times a second, tm.Dropped. Step it after each message.
    """

    def __init__(
        self,
        vehicles: Mapping[str, VehicleGeometry],
        tracker: TrackerProfile,
        rate_hz: float,
        age: AgeRules,
    ):
        self._T_body_cam = {n: v.T_body_cam for n, v in vehicles.items()}
        self._in_home, self._age = HomeFrames(alone=True), age
        self._calibrated_s: Optional[float] = None
        self._drifts = {n: Drift(tracker) for n in vehicles}
        self._gates = {n: RateGate(rate_hz) for n in vehicles}
        self._home_s = -math.inf
        self._out: List[object] = []
        self._take = Takers(
            {
                OdometryCame: self._odometry,
                tm.CalibrationFound: self._calibration,
                tm.HomeFound: lambda m: self._in_home.set_home(m.reference, m.T_odom_home),
            },
            "the frames take no",
        )

    def receive(self, _now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known."""
        self._take[type(message)](message)

    def step(self, now_s: float) -> Sequence[object]:
        """What is to be told now."""
        out, self._out = self._out, []
        if now_s - self._home_s >= _HOME_S - 1e-3:
            self._home_s = now_s
            out.append(OdomsInHome(self._in_home.T_home_odom))
        return out

    def _calibration(self, m: tm.CalibrationFound) -> None:
        self._in_home.calibrate(m.links)
        self._calibrated_s = m.stamp_s
        for drift in self._drifts.values():
            drift.begin(m.stamp_s)

    def _odometry(self, m: OdometryCame) -> None:
        if not self._gates[m.vehicle].passes(m.stamp_s):
            return
        expected = (frames.odom(m.vehicle), frames.base_link(m.vehicle))
        if m.frames != expected:
            why = f"{m.vehicle}: has frames {m.frames}, expected {expected}"
            self._out.append(tm.Dropped("odometry", why))
            return
        self._out.append(BodyAt(m.vehicle, m.stamp_s, m.T_odom_body))
        self._drifts[m.vehicle].add(m.stamp_s, m.T_odom_body[:3, 3])
        place = self._in_home.places.get(m.vehicle)
        if place is not None:
            self._camera(m, place)

    def _camera(self, m: OdometryCame, place: Place) -> None:
        name, tracker = m.vehicle, np.array(m.covariance, float).reshape(6, 6)
        if not np.isfinite(tracker).all() or (np.diag(tracker) < 0).any():
            self._out.append(tm.Dropped("odometry", f"{name}: its covariance is none"))
            return
        T_body_cam, drift = self._T_body_cam[name], self._drifts[name]
        covariance = camera_covariance(place, m.T_odom_body, T_body_cam, drift, tracker)
        T_home_cam = camera_in_home(place.T_a_b, m.T_odom_body, T_body_cam)
        self._out.append(CameraAt(name, m.stamp_s, T_home_cam, covariance))
        age_s = None if self._calibrated_s is None else m.stamp_s - self._calibrated_s
        sigma_m = float(np.sqrt(np.trace(covariance[:3, :3])))
        values = {
            f"{name} known to [m]": f"{sigma_m:.3f}",
            f"{name} yaw known to [deg]": f"{np.degrees(np.sqrt(covariance[5, 5])):.2f}",
            f"{name} flown since calibration [m]": f"{drift.path_m:.0f}",
        }
        stale = stale_reason(name, covariance, drift, age_s, self._age)
        self._out.append(tm.Diagnosis({name: stale}, values))

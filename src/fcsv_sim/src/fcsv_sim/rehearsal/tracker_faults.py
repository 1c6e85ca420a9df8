# SPDX-License-Identifier: Apache-2.0
"""Tracking cameras that fail, each in a way that a T265 is known for."""

import numpy as np

from fcsv_geometry import rotations, transforms
from fcsv_sim.rehearsal.fault import Fault
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle


class TrackerFault(Fault):
    """``_sample`` makes of a true sample (T_odom_t265, linear, angular) what the tracker gives."""

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        true, began_s = vehicle.tracker.odometry, flight.now_s
        self._draw()
        vehicle.tracker.odometry = lambda stamp_s, T: self._sample(
            flight.now_s - began_s, *true(stamp_s, T)
        )

    def _draw(self) -> None:
        """What differs from flight to flight."""

    def _sample(self, since_s: float, T: np.ndarray, linear: np.ndarray, angular: np.ndarray):
        raise NotImplementedError


class TrackerGone(Fault):
    """No sample any more; in one of two flights it comes back after 0.3 to 5 s."""

    name = "tracker gone"

    def begin(self, flight: Flight, vehicle: RehearsedVehicle) -> None:
        self._until_s = self._lasts_s(0.5, 0.3, 5.0)
        vehicle.tracker_on = False

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > self._until_s and not self.ended:
            self.vehicle.tracker_on = self.ended = True


class TrackerFrozen(TrackerFault):
    """The same pose again and again with fresh stamps, as a T265 that looks down is known for."""

    name = "tracker frozen"
    _noise_m = 0.0

    def _draw(self) -> None:
        self._kept = None

    def _sample(self, since_s, T, linear, angular):
        self._kept = T if self._kept is None else self._kept
        noise = self._noise_m * self._random.standard_normal(6)
        frozen = transforms.transform(self._kept[:3, :3], self._kept[:3, 3] + noise[:3])
        return frozen, noise[3:] * 10.0, np.zeros(3)


class TrackerFrozenWithNoise(TrackerFrozen):
    """Frozen but for noise of 0.3 mm: no two samples are equal."""

    name = "tracker frozen with noise"
    _noise_m = 0.0003


class TrackerRunsOff(TrackerFault):
    """The position runs away at 0.5 to 9 m/s at once; the velocity that it tells agrees."""

    name = "tracker runs off"

    def _draw(self) -> None:
        way = self._random.normal(size=3) * [1.0, 1.0, 0.3]
        self._way = way / np.linalg.norm(way)
        self._mps = float(np.exp(self._uniform(np.log(0.5), np.log(9.0))))

    def _gone_m(self, since_s: float) -> float:
        return self._mps * since_s

    def _speed_mps(self, _since_s: float) -> float:
        return self._mps

    def _sample(self, since_s, T, linear, angular):
        off_mps = T[:3, :3].T @ (self._way * self._speed_mps(since_s))
        return (
            transforms.transform(T[:3, :3], T[:3, 3] + self._way * self._gone_m(since_s)),
            linear + off_mps,
            angular,
        )


class TrackerDriftsSlowly(TrackerRunsOff):
    """The position drifts at 0.1 to 0.5 m/s, by 0.1 m/s faster every second, up to 5 m/s."""

    name = "tracker drifts slowly"
    _faster_mps2, _most_mps = 0.1, 5.0

    def _draw(self) -> None:
        super()._draw()
        self._mps = self._uniform(0.1, 0.5)

    def _speed_mps(self, since_s: float) -> float:
        return min(self._most_mps, self._mps + self._faster_mps2 * since_s)

    def _gone_m(self, since_s: float) -> float:
        grows_s = min(since_s, (self._most_mps - self._mps) / self._faster_mps2)
        rest_m = self._most_mps * (since_s - grows_s)
        return self._mps * grows_s + 0.5 * self._faster_mps2 * grows_s**2 + rest_m


class TrackerJumps(TrackerFault):
    """A step of 0.3 to 30 m."""

    name = "tracker jumps"

    def _draw(self) -> None:
        way = self._random.normal(size=3)
        self._step_m = way / np.linalg.norm(way) * np.exp(self._uniform(np.log(0.3), np.log(30.0)))

    def _sample(self, since_s, T, linear, angular):
        return transforms.transform(T[:3, :3], T[:3, 3] + self._step_m), linear, angular


class TrackerResets(TrackerFault):
    """A step of 30 m, as the thesis saw at take-off; 0.3 to 3 s later it begins anew, where it is,
    at zero."""

    name = "tracker resets"

    def _draw(self) -> None:
        way = self._random.normal(size=3) * [1.0, 1.0, 0.3]
        self._step_m = 30.0 * way / np.linalg.norm(way)
        self._resets_s = self._uniform(0.3, 3.0)
        self._T_new_old = None

    def _sample(self, since_s, T, linear, angular):
        if since_s < self._resets_s:
            return transforms.transform(T[:3, :3], T[:3, 3] + self._step_m), linear, angular
        if self._T_new_old is None:
            self._T_new_old = transforms.invert(transforms.level(T))
        return self._T_new_old @ T, linear, angular


class TrackerUnsure(TrackerFault):
    """Its confidence falls, and its poses get noisy (2 to 15 cm, 0.2 to 1 degree); in half of the
    flights for 1 to 8 s."""

    name = "tracker unsure"

    def _draw(self) -> None:
        self._until_s = self._lasts_s(0.5, 1.0, 8.0)
        self._noise_m, self._noise_rad = (
            self._uniform(0.02, 0.15),
            np.radians(self._uniform(0.2, 1.0)),
        )
        self.vehicle.tracker.confidence = int(self._random.integers(0, 2))

    def _sample(self, since_s, T, linear, angular):
        if self.ended:
            return T, linear, angular
        n = self._random.standard_normal(6)
        R = T[:3, :3] @ rotations.exp(self._noise_rad * n[3:])
        return transforms.transform(R, T[:3, 3] + self._noise_m * n[:3]), linear, angular

    def goes_on(self, flight: Flight, since_s: float) -> None:
        if since_s > self._until_s and not self.ended:
            self.vehicle.tracker.confidence, self.ended = 3, True


TRACKER_FAULTS = (
    TrackerGone,
    TrackerFrozen,
    TrackerFrozenWithNoise,
    TrackerRunsOff,
    TrackerDriftsSlowly,
    TrackerJumps,
    TrackerResets,
    TrackerUnsure,
)

# SPDX-License-Identifier: Apache-2.0
"""The control PC's node ``pair_check`` in a rehearsal: pictures of who records, held against the
trackers."""

from typing import Dict, Iterator, List, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.rehearsal.radio import Radio
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle
from fcsv_sim.sensors.pair_scene import FOCAL_PX, NOISE_PX, MatchedScene
from fcsv_stereo.in_flight import pair_check

_EVERY_S, _TAKES_S = 0.5, 0.5  # pictures on their way, and looked at


class PairCheck:
    """Every other vehicle beside the reference, as long as both record."""

    def __init__(
        self,
        fleet: Dict[str, RehearsedVehicle],
        radios: Dict[str, Radio],
        reference: str,
        seed: int,
    ):
        self._fleet, self._radios, self._reference = fleet, radios, reference
        scene, others = fleet[reference].scene, [n for n in fleet if n != reference]
        self._scenes = {
            n: MatchedScene(scene, fleet[n].scene, 100 * seed + k) for k, n in enumerate(others)
        }
        self._random = np.random.default_rng([seed, 25])
        self._due_s = 0.0
        # when it is known, of whom, whether it is off
        self._looks: List[Tuple[float, str, bool]] = []

    def step(self, now_s: float, T_home_odom: Dict[str, np.ndarray]) -> None:
        """Looks at what is due, by what both cameras truly see and where the trackers say that they
        are."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + _EVERY_S
        for name, scene in self._scenes.items():
            if all(n in T_home_odom and self._sends_pictures(n) for n in (self._reference, name)):
                (true_a, told_a), (true_b, told_b) = (
                    self._cameras(n, T_home_odom[n]) for n in (self._reference, name)
                )
                T_a_b = transforms.invert(told_a) @ told_b
                seen = pair_check.compare(T_a_b, *scene.rays(true_a, true_b), FOCAL_PX, NOISE_PX)
                self._looks.append((now_s + _TAKES_S, name, seen.off))

    def looks(self, now_s: float) -> Iterator[Tuple[str, bool]]:
        """Those that are known by now, once: of whom beside the reference, whether it is off."""
        while self._looks and self._looks[0][0] <= now_s:
            _, name, off = self._looks.pop(0)
            yield name, off

    def _sends_pictures(self, name: str) -> bool:
        vehicle, radio = self._fleet[name], self._radios[name]
        sends = vehicle.recording and vehicle.odometry is not None and not radio.cut
        return sends and self._random.random() >= radio.quality.loss

    def _cameras(self, name: str, T_home_odom: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Where a vehicle's camera truly is in the world, and in home by its tracker."""
        vehicle = self._fleet[name]
        T_body_cam = vehicle.geometry.T_body_cam
        return (
            vehicle.body.T_world_body @ T_body_cam,
            T_home_odom @ vehicle.T_odom_body @ T_body_cam,
        )

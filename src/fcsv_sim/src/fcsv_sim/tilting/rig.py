# SPDX-License-Identifier: Apache-2.0
"""A rig as it really is: a little other than its file says, with servos that stop and read in
ticks."""

from dataclasses import dataclass, field, replace
from typing import Callable, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.vehicle import Mount
from fcsv_sim.gimbal.gimbal import STEP_S, ServoErrors, SimulatedServo
from fcsv_tracking.tilting.rig import SIDES, TiltAngles, TiltAxis, TiltingRig

_MOST_S = 5.0  # for a turn
_MADE_DEG, _MADE_M = 0.5, 0.001  # how exactly a workshop makes it
#: A rig's servos turn slower than a gimbal's.
SLOW = ServoErrors(speed_degps=60.0, acceleration_degps2=500.0)


def as_built(rig: TiltingRig, random: np.random.Generator) -> TiltingRig:
    """The rig whose file was calibrated as well as its ``known`` says: the right camera is off by
    that much."""
    mount, known = rig.right.mount, rig.known
    xyz_m = tuple(float(v) for v in np.add(mount.xyz_m, random.normal(0.0, known.position_m, 3)))
    rpy_deg = tuple(
        float(v) for v in np.add(mount.rpy_deg, random.normal(0.0, known.rotation_deg, 3))
    )
    return replace(rig, right=replace(rig.right, mount=Mount(xyz_m, rpy_deg)))


def as_made(rig: TiltingRig, random: np.random.Generator) -> TiltingRig:
    """The rig whose file is its drawing: axes and the right camera are off by what a workshop
    leaves, per axis."""
    sides = []
    for camera in (rig.left, rig.right):
        tilt = transforms.Rotation.from_rotvec(np.radians(random.normal(0.0, _MADE_DEG, 3)))
        place = tuple(float(v) for v in np.add(camera.axis.xyz_m, random.normal(0.0, _MADE_M, 3)))
        sides.append(
            replace(
                camera, axis=TiltAxis(place, tuple(float(v) for v in tilt.apply(camera.axis.unit)))
            )
        )
    mount = sides[1].mount
    xyz_m = tuple(float(v) for v in np.add(mount.xyz_m, random.normal(0.0, _MADE_M, 3)))
    rpy_deg = tuple(float(v) for v in np.add(mount.rpy_deg, random.normal(0.0, _MADE_DEG, 3)))
    return replace(rig, left=sides[0], right=replace(sides[1], mount=Mount(xyz_m, rpy_deg)))


@dataclass
class SimulatedRig:
    """``told`` is the rig as its file has it, ``true`` as it stands; no clock: a turn takes as long
    as it takes."""

    told: TiltingRig
    seed: int = 1
    errors: ServoErrors = SLOW
    built: Callable[[TiltingRig, np.random.Generator], TiltingRig] = as_built
    true: TiltingRig = field(init=False)

    def __post_init__(self):
        random = np.random.default_rng([self.seed, 72])
        self.true = self.built(self.told, random)
        self._servos = [
            SimulatedServo(self.errors, random) for _ in SIDES[: 1 if self.told.coupled else 2]
        ]
        self._now_s = 0.0

    def turn(self, angles: TiltAngles) -> float:
        """Turn there and come to rest; how long it took (s)."""
        begun_s = self._now_s
        for servo, angle in zip(self._servos, self.told.clipped(angles)):
            servo.command(self._now_s, angle)
        still_s = 0.0
        while still_s < 0.1 and self._now_s - begun_s < _MOST_S:
            self._now_s += STEP_S
            for servo in self._servos:
                servo.step(self._now_s)
            still_s = still_s + STEP_S if all(s.rate_radps == 0.0 for s in self._servos) else 0.0
        return self._now_s - begun_s

    @property
    def angles(self) -> TiltAngles:
        """Gives the angles as the cameras truly stand."""
        return TiltAngles(self._servos[0].angle_rad, self._servos[-1].angle_rad)

    def read(self) -> TiltAngles:
        """Gives the angles as the encoders say."""
        first, last = self._servos[0], self._servos[-1]
        return TiltAngles(first.reading_rad(first.angle_rad), last.reading_rad(last.angle_rad))

    def T_rig_cams(self) -> Tuple[np.ndarray, np.ndarray]:
        """Where the left and the right camera truly are in the rig (4x4 each)."""
        left, right = (self.true.T_rig_cam(side, self.angles) for side in SIDES)
        return left, right

# SPDX-License-Identifier: Apache-2.0
"""A tilting rig as its file describes it (config/tilting/*.yaml), and where its cameras are at given angles.

Frame R, ``rig``: on the beam halfway between both tilt axes, x forward, y left, z up. Each camera turns about an axis
that is fixed in R; the axis's direction is such that positive angles turn inward.
"""

from dataclasses import dataclass, field
from typing import NamedTuple, Optional, Tuple

import numpy as np

from fcsv_geometry import config, transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.vehicles.vehicle import Mount, Vector3

SIDES = ("left", "right")
_LEAST_M, _MOST_M = 0.02, 2.0  # of a beam
_FLOOR_M, _FLOOR_RAD = 1e-5, 1e-5  # what nobody knows better: keeps covariances positive definite
_TICK_RAD = 2.0 * np.pi / 4096.0  # of an MX-12W


class TiltAngles(NamedTuple):
    """How both cameras are turned inward (rad)."""

    left_rad: float
    right_rad: float


@dataclass(frozen=True)
class TiltAxis:
    """A line in R: a point on it (m) and its direction, about which a positive angle turns inward."""

    xyz_m: Vector3  # a point on the axis, in the rig's frame
    direction: Vector3  # unit vector; a positive angle turns inward

    def __post_init__(self):
        length = float(np.linalg.norm(self.direction))
        if not 0.5 < length < 2.0:
            raise ValueError(
                f"direction: {list(self.direction)} has length {length:.3g}; give a unit vector"
            )

    @property
    def unit(self) -> np.ndarray:
        """The direction (3,), of length one."""
        return np.asarray(self.direction, float) / np.linalg.norm(self.direction)

    def turned(self, angle_rad: float) -> np.ndarray:
        """T that turns by an angle about the line (4x4, in R).

        >>> T = TiltAxis((0.0, 0.1, 0.0), (0.0, 0.0, -1.0)).turned(np.pi / 2)
        >>> np.round(T @ [1.0, 0.1, 0.0, 1.0], 6)[:3].tolist()  # ahead of the left camera, now to its right
        [0.0, -0.9, 0.0]
        """
        R = transforms.Rotation.from_rotvec(self.unit * angle_rad).as_matrix()
        p = np.asarray(self.xyz_m, float)
        return transforms.transform(R, p - R @ p)


@dataclass(frozen=True)
class TiltServo:
    """An MX-12W: its id on the bus, its reading (ticks of 360/4096 degrees) at angle zero, and which way it counts."""

    id: int  # on the bus
    zero: int = 2048  # reading (ticks of 360/4096 degrees) at angle 0
    sign: int = 1  # 1: counts up as the angle grows

    def __post_init__(self):
        if not 0 <= self.id <= 252:
            raise ValueError(f"id: {self.id} is not in 0..252")
        if not 0 <= self.zero <= 4095:
            raise ValueError(f"zero: {self.zero} is not in 0..4095")
        if self.sign not in (-1, 1):
            raise ValueError(f"sign: {self.sign} must be 1 or -1")


@dataclass(frozen=True)
class TiltingCamera:
    """One side: lens, where the camera is in R at angle zero (forward-left-up, x out of the lens), axis, servo.

    Without a servo the side is geared to the other one and has its angle.
    """

    camera: PinholeCamera  # lens
    mount: Mount  # at angle 0, in the rig's frame; x out of the lens
    axis: TiltAxis  # about which it turns
    servo: Optional[TiltServo] = None  # none: geared to the other side

    def T_rig_cam(self, angle_rad: float) -> np.ndarray:
        """The camera's optical frame in R (4x4)."""
        T_rig_cam0 = self.mount.T_body_part @ transforms.transform(
            transforms.R_FLU_OPTICAL, np.zeros(3)
        )
        return self.axis.turned(angle_rad) @ T_rig_cam0

    def motion(self, angle_rad: float) -> np.ndarray:
        """(6,): how the camera moves (m) and turns (rad), about R's axes, per rad of the angle."""
        p = self.T_rig_cam(angle_rad)[:3, 3]
        return np.concatenate(
            [np.cross(self.axis.unit, p - np.asarray(self.axis.xyz_m, float)), self.axis.unit]
        )


@dataclass(frozen=True)
class RigSigma:
    """Standard deviations per axis of what calibration leaves: the right camera against the left one, at exact angles,
    and of an angle as it is read (encoder and play), its resolution aside."""

    # standard deviation of the right camera's attitude against the left one's
    rotation_deg: float = 0.05
    position_m: float = 0.0003  # of its position
    reading_deg: float = 0.03  # of an angle as it is read: encoder and play

    def __post_init__(self):
        config.require_positive(self)


@dataclass(frozen=True)
class TiltingRig:
    """Both sides, the angles that they may have, and how well all of it is known."""

    name: str  # in topics and frames
    left: TiltingCamera
    right: TiltingCamera
    limits_deg: Tuple[float, float] = (0.0, 30.0)  # of both angles, inwards: least, most
    known: RigSigma = field(default_factory=RigSigma)

    def __post_init__(self):
        if not self.name.isidentifier():
            raise ValueError(f"name: '{self.name}' is not a ROS name; use letters, digits and _")
        low, high = self.limits_deg
        if not -10.0 <= low < high <= 60.0:
            raise ValueError(
                f"limits_deg: {low}, {high} must rise and lie within -10 to 60 degrees inward"
            )
        if self.left.servo is None:
            raise ValueError("left.servo: is missing; a rig with one servo has it on the left")
        if self.right.servo is not None and self.right.servo.id == self.left.servo.id:
            raise ValueError(
                f"right.servo.id: {self.right.servo.id} is also the left one's; leave out a geared side's"
            )
        across_m = self.left.mount.xyz_m[1] - self.right.mount.xyz_m[1]
        if not _LEAST_M <= across_m <= _MOST_M:
            raise ValueError(
                f"left.mount.xyz_m: the left camera is {across_m:.3f} m to the left of the right one, "
                f"not {_LEAST_M} to {_MOST_M} m"
            )

    @property
    def coupled(self) -> bool:
        """Whether one servo turns both."""
        return self.right.servo is None

    @property
    def baseline_m(self) -> float:
        """Between both cameras at angle zero."""
        return float(np.linalg.norm(self.T_left_right(TiltAngles(0.0, 0.0))[:3, 3]))

    @property
    def frame(self) -> str:
        """R's name in tf."""
        return f"{self.name}/rig"

    def camera_name(self, side: str) -> str:
        """What a side's camera is called where vehicles are named: topics and frames of its own."""
        return f"{self.name}_{side}"

    def clipped(self, angles: TiltAngles) -> TiltAngles:
        """The nearest angles inside the limits."""
        return TiltAngles(*(float(a) for a in np.clip(angles, *np.radians(self.limits_deg))))

    def T_rig_cam(self, side: str, angles: TiltAngles) -> np.ndarray:
        """T_rig_cam (4x4) of the ``left`` or the ``right`` camera."""
        return getattr(self, side).T_rig_cam(angles[SIDES.index(side)])

    def T_left_right(self, angles: TiltAngles) -> np.ndarray:
        """The right camera in the left one's optical frame (4x4)."""
        return transforms.invert(self.T_rig_cam("left", angles)) @ self.T_rig_cam("right", angles)

    @property
    def angle_std_rad(self) -> float:
        """Gives the standard deviation of a reading: resolution (a tick, evenly distributed), encoder and play."""
        return float(np.hypot(_TICK_RAD / np.sqrt(12.0), np.radians(self.known.reading_deg)))

    def covariance(self, side: str, angles: TiltAngles) -> np.ndarray:
        """(6, 6) of a camera's position (m) and small rotation (rad) about R's axes (REP 103).

        Errors of both sides are independent; the calibration's stands in the right one's alone.
        """
        motion = getattr(self, side).motion(angles[SIDES.index(side)])
        C = np.outer(motion, motion) * self.angle_std_rad**2 + np.diag(
            [_FLOOR_M**2] * 3 + [_FLOOR_RAD**2] * 3
        )
        if side == "right":
            C += np.diag(
                [self.known.position_m**2] * 3 + [np.radians(self.known.rotation_deg) ** 2] * 3
            )
        return C

    def relative_covariance(self, angles: TiltAngles) -> np.ndarray:
        """(6, 6) of the right camera where the left one is held: position (m), rotation (rad), about R's axes."""
        arm = self.T_rig_cam("right", angles)[:3, 3] - self.T_rig_cam("left", angles)[:3, 3]
        F = np.eye(6)
        F[:3, 3:] = [[0.0, arm[2], -arm[1]], [-arm[2], 0.0, arm[0]], [arm[1], -arm[0], 0.0]]
        if self.coupled:  # one reading moves both; what is left of it is the difference
            both = self.right.motion(angles.right_rad) - F @ self.left.motion(angles.left_rad)
            floor = np.diag([_FLOOR_M**2] * 3 + [_FLOOR_RAD**2] * 3)
            known = np.diag(
                [self.known.position_m**2] * 3 + [np.radians(self.known.rotation_deg) ** 2] * 3
            )
            return np.outer(both, both) * self.angle_std_rad**2 + known + floor + F @ floor @ F.T
        return self.covariance("right", angles) + F @ self.covariance("left", angles) @ F.T


def load_rig(path) -> TiltingRig:
    """Raises ConfigError naming file and field, GeometryError where a camera is none."""
    return config.load(path, TiltingRig)

# SPDX-License-Identifier: Apache-2.0
"""A pan-tilt gimbal on the ground robot: where its camera is, and how it must stand to look at a point.

Frames: G ground robot (x forward, y left, z up), B the gimbal's base (z is the pan axis), C the camera's optical frame.
Pan turns to the left, tilt upwards; at nought the camera looks along B's x.
"""

from dataclasses import dataclass
from typing import NamedTuple, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.vehicle import Mount, Vector3

_STEPS = 8  # of Newton's method; each squares an error that lever arms of centimetres leave
_NEAREST_M = 0.1


class Angles(NamedTuple):
    """How a gimbal stands (rad)."""

    pan_rad: float
    tilt_rad: float


@dataclass(frozen=True)
class GimbalGeometry:
    """One gimbal. ``base`` stands in G; ``tilt_axis_xyz_m`` from base to tilt axis, turning with pan; ``camera``
    (forward-left-up, x out of the lens) sits on what tilts."""

    base: Mount  # in the robot's frame
    tilt_axis_xyz_m: Vector3 = (0.0, 0.0, 0.05)  # from the base; it turns with pan
    camera: Mount = Mount((0.03, 0.0, 0.0))  # on what tilts; x out of the lens
    pan_limits_deg: Tuple[float, float] = (-150.0, 150.0)  # least, most; to the left
    tilt_limits_deg: Tuple[float, float] = (-30.0, 80.0)  # least, most; upwards

    def __post_init__(self):
        for name, most_deg in (("pan_limits_deg", 180.0), ("tilt_limits_deg", 85.0)):
            low, high = getattr(self, name)
            if not -most_deg <= low < high <= most_deg:
                raise ValueError(
                    f"{name}: {low}, {high} must rise and be within {most_deg:.0f} degrees of nought"
                )

    def T_ground_cam(self, angles: Angles) -> np.ndarray:
        """T_G_C = T_G_B Rz(pan) Trans(tilt axis) Ry(-tilt) T_tilt_camera.

        >>> gimbal = GimbalGeometry(Mount((0.0, 0.0, 0.4)), (0.0, 0.0, 0.0), Mount((0.0, 0.0, 0.0)))
        >>> np.round(gimbal.T_ground_cam(Angles(np.pi / 2, np.pi / 4))[:3, 2], 3).tolist()  # left and up
        [0.0, 0.707, 0.707]
        """
        T_tilt_cam = self.camera.T_body_part @ transforms.transform(
            transforms.R_FLU_OPTICAL, np.zeros(3)
        )
        return (
            self._T_ground_pan(angles)
            @ transforms.from_xyz_rpy(self.tilt_axis_xyz_m, [0.0, -angles.tilt_rad, 0.0])
            @ T_tilt_cam
        )

    def _T_ground_pan(self, angles: Angles) -> np.ndarray:
        return self.base.T_body_part @ transforms.from_xyz_yaw(np.zeros(3), angles.pan_rad)

    def motions(self, angles: Angles, p_ground_m: np.ndarray) -> np.ndarray:
        """(6, 2): how a body seen at a point (3,) moves and turns in G per rad of pan and of tilt read wrong."""
        T_G_pan = self._T_ground_pan(angles)
        columns = []
        for axis, through in (
            (T_G_pan[:3, 2], T_G_pan[:3, 3]),
            (-T_G_pan[:3, 1], transforms.apply(T_G_pan, np.array(self.tilt_axis_xyz_m))),
        ):
            columns.append(np.concatenate([np.cross(axis, p_ground_m - through), axis]))
        return np.stack(columns, axis=1)

    def aim(self, p_ground_m: np.ndarray) -> Angles:
        """The angles that bring a point (3,) to the middle of the picture, inside the limits as near as they come.

        >>> gimbal = GimbalGeometry(Mount((0.2, 0.1, 0.4), (0.0, 5.0, 30.0)))
        >>> T = gimbal.T_ground_cam(gimbal.aim(np.array([2.0, 2.5, 1.5])))
        >>> bool(np.abs(transforms.apply(transforms.invert(T), np.array([2.0, 2.5, 1.5]))[:2]).max() < 1e-9)
        True
        """
        p_B = transforms.apply(
            transforms.invert(self.base.T_body_part), np.asarray(p_ground_m, float)
        )
        angles = Angles(
            float(np.arctan2(p_B[1], p_B[0])), float(np.arctan2(p_B[2], np.hypot(p_B[0], p_B[1])))
        )
        for _ in range(_STEPS):
            x, y, z = transforms.apply(
                transforms.invert(self.T_ground_cam(angles)), np.asarray(p_ground_m, float)
            )
            ahead = max(float(np.hypot(x, z)), _NEAREST_M)
            pan = angles.pan_rad - np.arctan2(x, max(z, _NEAREST_M)) / max(
                np.cos(angles.tilt_rad), 0.1
            )
            angles = self.clipped(Angles(float(pan), angles.tilt_rad - float(np.arctan2(y, ahead))))
        return angles

    def clipped(self, angles: Angles) -> Angles:
        """The nearest angles inside the limits."""
        pan, tilt = np.radians(self.pan_limits_deg), np.radians(self.tilt_limits_deg)
        return Angles(float(np.clip(angles.pan_rad, *pan)), float(np.clip(angles.tilt_rad, *tilt)))

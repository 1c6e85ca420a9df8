# SPDX-License-Identifier: Apache-2.0
"""Two vehicles in a column with known truth, and the detections that one makes of the other."""

from dataclasses import dataclass

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.tracker import T265_PROFILE
from fcsv_geometry.vehicles.vehicle import Mount, VehicleGeometry
from fcsv_sim.sensors.t265 import T265
from fcsv_tracking.column.detection import Detection
from fcsv_tracking.tags import corner_points

FOCAL_PX = 601.8
END_S = 8.0


def vehicle(name, number):
    return VehicleGeometry(
        name,
        number,
        number,
        0.16,
        Mount((0.11, 0.0, 0.03)),
        Mount((0.06, 0.0, -0.05), (0.0, 90.0, 0.0)),
        Mount((-0.16, 0.0, 0.02), (0.0, 0.0, 180.0)),
    )


@dataclass
class Column:
    """Truth: T_world_odom of both, and noise of what is measured."""

    seed: int
    distance_m: float = 3.5
    sway_m: float = 0.8
    sway_period_s: float = 7.0
    corner_noise_px: float = 0.15
    attitude_noise_deg: float = 0.05
    position_noise_m: float = 0.003

    def __post_init__(self):
        self.random = np.random.default_rng(self.seed)
        self.front, self.back = vehicle("uav1", 1), vehicle("uav2", 2)
        odom = lambda: transforms.from_xyz_yaw(  # noqa: E731
            self.random.uniform(-20, 20, 3), self.random.uniform(-3, 3)
        )
        self.T_world_O1, self.T_world_O2 = odom(), odom()

    def bodies(self, t_s):
        """T_world_body of front and back at a time: the front one sways, both tilt and wander a
        little."""
        wobble = lambda s: 0.05 * np.sin(np.array([0.7, 0.9, 0.5]) * t_s + s)  # noqa: E731
        tilt = lambda s: 0.03 * np.sin(np.array([1.3, 1.1, 0.4]) * t_s + s)  # noqa: E731
        phase = 2 * np.pi * t_s / self.sway_period_s
        sway = self.sway_m * np.array([0.0, np.sin(phase), 0.2 * np.sin(2 * np.pi * t_s / 4.0)])
        front = transforms.from_xyz_rpy(np.array([0, 0, 5.0]) + sway + wobble(1), tilt(2))
        back = transforms.from_xyz_rpy(np.array([-self.distance_m, 0.1, 5.1]) + wobble(3), tilt(4))
        return front, back

    def noisy(self, T):
        p = self.random.normal(0, self.position_noise_m, 3)
        r = self.random.normal(0, np.radians(self.attitude_noise_deg), 3)
        return T @ transforms.from_xyz_rpy(p, r)

    def odometry(self, t_s):
        """T_O1_D1 and T_O2_D2 as measured, in order of time."""
        T_world_D1, T_world_D2 = self.bodies(t_s)
        T_O2_D2 = self.noisy(transforms.invert(self.T_world_O2) @ T_world_D2)
        return self.noisy(transforms.invert(self.T_world_O1) @ T_world_D1), T_O2_D2

    def detection(self, t_s):
        T_world_D1, T_world_D2 = self.bodies(t_s)
        T_world_tag, T_world_cam = (
            T_world_D1 @ self.front.T_body_tag,
            T_world_D2 @ self.back.T_body_cam,
        )
        p_cam = transforms.apply(transforms.invert(T_world_cam) @ T_world_tag, corner_points(0.16))
        corners = p_cam[:, :2] / p_cam[:, 2:] + self.random.normal(
            0, self.corner_noise_px / FOCAL_PX, (4, 2)
        )
        T_O1_D1, T_O2_D2 = self.odometry(t_s)
        return Detection(
            t_s,
            corners,
            0.16,
            FOCAL_PX,
            T_O2_D2 @ self.back.T_body_cam,
            T_O1_D1 @ self.front.T_body_tag,
        )

    def detections(self, seconds=END_S, rate_hz=5.0):
        return [self.detection(t) for t in np.arange(0, seconds, 1.0 / rate_hz)]

    def odometry_at_end(self):
        """T_O1_D1 and T_O2_D2 that a link of the end of the calibration is to agree with."""
        T_world_D1, T_world_D2 = self.bodies(END_S)
        return transforms.invert(self.T_world_O1) @ T_world_D1, transforms.invert(
            self.T_world_O2
        ) @ T_world_D2

    def true_link(self):
        """T_O1_O2 with which the odometries of the end give the true relative pose."""
        (T_world_D1, T_world_D2), (T_O1_D1, T_O2_D2) = self.bodies(END_S), self.odometry_at_end()
        return T_O1_D1 @ transforms.invert(T_world_D1) @ T_world_D2 @ transforms.invert(T_O2_D2)

    def relative_pose_error(self, T_O1_O2):
        """Error of the vehicles' relative pose at the end: metres and degrees."""
        T_O2_D2 = self.odometry_at_end()[1]
        estimated, true = T_O1_O2 @ T_O2_D2, self.true_link() @ T_O2_D2
        angle = transforms.rotation_angle(estimated, true)
        return float(np.linalg.norm(estimated[:3, 3] - true[:3, 3])), float(np.degrees(angle))


@dataclass
class DriftingColumn(Column):
    """The same column by the odometry of two simulated T265: walk, heading, scale and level go
    wrong as it moves."""

    def __post_init__(self):
        super().__post_init__()
        self._vehicles = [self.front, self.back]
        self._trackers = [
            T265(T265_PROFILE, v.T_body_t265, 2 * self.seed + i)
            for i, v in enumerate(self._vehicles)
        ]
        self._next_s = 0.0

    def odometry(self, t_s):
        while True:  # 200 Hz: drift depends on the path between the pictures
            step_s = min(self._next_s, t_s)
            now = [k.odometry(step_s, T)[0] for k, T in zip(self._trackers, self.bodies(step_s))]
            if step_s >= t_s:
                break
            self._next_s = step_s + 0.005
        return [T @ transforms.invert(v.T_body_t265) for T, v in zip(now, self._vehicles)]

    def odometry_at_end(self):
        return self.odometry(END_S)

# SPDX-License-Identifier: Apache-2.0
"""What is known of a tracking camera (config/trackers/NAME.yaml): its rate, how it goes wrong, how
it names its frames.

Tracking reads it as what it assumes; the simulated tracker reads one as what it does. By default
both read one file. Where the camera sits on the body is in the vehicle's file
(vehicle.VehicleGeometry.tracking_camera).
"""

import math
from dataclasses import dataclass, fields

from fcsv_geometry import config


@dataclass(frozen=True)
class TrackerProfile:
    """A T265-like visual-inertial odometry; errors are standard deviations, drift grows with the
    distance moved.

    The level frame begins where the tracker was switched on, with a yaw of its own (REP 103).
    Raises ValueError on what is negative or not finite.
    """

    name: str = "t265"  # in its frames' names: uav1/t265_odom_frame
    rate_hz: float = 200.0  # of its samples
    latency_s: float = 0.015  # from the middle of its sensing to the sample
    scale: float = 0.006  # share of the distance (thesis 6.1: 1 % in all), constant while it runs
    walk_m_per_sqrt_m: float = 0.012  # random walk of the position over the distance, each axis
    heading_deg_per_sqrt_m: float = 0.015  # random walk of the heading over the distance
    walk_m_per_sqrt_s: float = 0.0005  # of the position of a tracker that hovers; not simulated
    level_deg: float = 0.04  # constant error of the vertical, each axis
    position_noise_m: float = 0.0015  # of a sample, each axis, correlated over noise_correlation_s
    attitude_noise_deg: float = 0.03  # of a sample, each axis
    noise_correlation_s: float = 0.1  # of both noises

    def __post_init__(self):
        if not self.name.isidentifier():
            raise ValueError(f"name: '{self.name}' is not a ROS name; use letters, digits and _")
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name != "name" and not 0 <= value < math.inf:
                raise ValueError(f"{f.name}: {value} must not be negative")
        if not 1.0 <= self.rate_hz <= 400.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 1..400")
        if not self.noise_correlation_s > 0:
            raise ValueError(f"noise_correlation_s: {self.noise_correlation_s} must be positive")

    @property
    def period_s(self) -> float:
        """Between two samples.

        >>> TrackerProfile().period_s
        0.005
        """
        return 1.0 / self.rate_hz

    def odom_frame(self, vehicle: str) -> str:
        """Where the tracker began, level, as its driver names it.

        >>> TrackerProfile().odom_frame("uav1"), TrackerProfile().pose_frame("uav1")
        ('uav1/t265_odom_frame', 'uav1/t265_pose_frame')
        """
        return f"{vehicle}/{self.name}_odom_frame"

    def pose_frame(self, vehicle: str) -> str:
        """The tracker itself: x out of its lens side (REP 103)."""
        return f"{vehicle}/{self.name}_pose_frame"


#: What is assumed where no file says otherwise.
T265_PROFILE = TrackerProfile()


def load_profile(path: str = "") -> TrackerProfile:
    """A profile from its file; without a file the one of the defaults. Raises ConfigError naming
    file and field."""
    return config.load(path, TrackerProfile) if path else T265_PROFILE

# SPDX-License-Identifier: Apache-2.0
"""Names of the frames (docs/design/conventions.md); rviz's fixed frame is HOME."""

HOME = "home"
#: The ground robot that carries gimbals (thesis chapter 4); where it stood when home was set.
GROUND = "ground"
#: The same robot, where it is now.
GROUND_NOW = "ground_now"


def odom(vehicle: str) -> str:
    """O_n: where the vehicle's own odometry began, level."""
    return f"{vehicle}/odom"


def tello_odom(vehicle: str) -> str:
    """Where a Tello's own log begins; its tracker's poses are in ``odom``."""
    return f"{vehicle}/tello_odom"


def base_link(vehicle: str) -> str:
    """D_n: body, forward-left-up."""
    return f"{vehicle}/base_link"


def camera_optical(vehicle: str) -> str:
    """C_n: z forward, x right, y down."""
    return f"{vehicle}/camera_optical"


def tag(vehicle: str) -> str:
    """A_n: the AprilTag on the back."""
    return f"{vehicle}/tag"


def gimbal_base(vehicle: str) -> str:
    """B: the base of the gimbal that follows the vehicle; its z is the pan axis."""
    return f"{vehicle}/gimbal_base"


def gimbal_optical(vehicle: str) -> str:
    """C: the camera on that gimbal."""
    return f"{vehicle}/gimbal_optical"

# SPDX-License-Identifier: Apache-2.0
"""What each machine records for a session (docs/architecture.md, "Session")."""

from dataclasses import dataclass
from typing import List, Sequence, Tuple

PICTURES: Tuple[str, ...] = ("camera/color/image_raw", "camera/color/camera_info")
_VEHICLE: Tuple[str, ...] = ("odometry/body", "tags/detections", "mavros/state", "mavros/statustext/recv")
_HEARD: Tuple[str, ...] = (
    "odometry/state", "mavros/state", "mavros/local_position/pose", "mavros/battery", "mavros/statustext/recv",
    "camera_pose", "markers", "recorder/status",
)  # fmt: skip
_CONTROL: Tuple[str, ...] = ("/calibration", "/home", "/mission/state", "/mission/capture", "/tf", "/tf_static")


@dataclass(frozen=True)
class RecordingPlan:
    """Topics that are always written, and those written only while pictures are on."""

    always: List[str]
    pictures: List[str]


def plan(role: str, name: str, vehicles: Sequence[str]) -> RecordingPlan:
    """Of a machine: role "vehicle" (its own topics) or "control" (what it hears of all vehicles)."""
    if role == "vehicle":
        return RecordingPlan([f"/{name}/{t}" for t in _VEHICLE] + ["/tf_static"], [f"/{name}/{t}" for t in PICTURES])
    if role == "control":
        return RecordingPlan([*_CONTROL, *(f"/{v}/{t}" for v in vehicles for t in _HEARD)], [])
    raise ValueError(f"role: '{role}' is neither vehicle nor control")

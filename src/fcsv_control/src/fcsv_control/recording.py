# SPDX-License-Identifier: Apache-2.0
"""What each machine records for a session (docs/design/architecture.md, "Session")."""

from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import List, Optional, Tuple

from fcsv_geometry.bags.parts import part_number, parts_in
from fcsv_geometry.bags.repair import ACTIVE

DIAGNOSTICS = "/diagnostics"
PICTURES: Tuple[str, ...] = ("camera/color/image_raw", "camera/color/camera_info")
_VEHICLE: Tuple[str, ...] = (
    "odometry/body",
    "odometry/epoch",
    "tags/detections",
    "mavros/state",
    "mavros/statustext/recv",
    "agent/alive",
    "command",
    "command_ack",
    "guardian/state",
    "guardian/said",
    "flight_link/health",
    "flight_link/estimate_moved",
    "flight_link/parameters",
    "flight_link/refusal",
    "mavros/setpoint_position/local",
    "mavros/vision_pose/pose",
    "mavros/local_position/pose",
    "mavros/rc/in",
    "mavros/battery",
    "mavros/global_position/raw/fix",
    "recorder/status",
    "flight_check",
    "tello/odom",
    "tello/imu",
)
#: What a map needs of the control PC, as a vehicle hears it by radio: control.bag may be lost
#: (docs/user/maps.md).
_OF_CONTROL: Tuple[str, ...] = ("/calibration", "/home", "/mission/capture")
_HEARD: Tuple[str, ...] = (
    "odometry/state",
    "mavros/state",
    "mavros/local_position/pose",
    "mavros/battery",
    "mavros/statustext/recv",
    "camera_pose",
    "recorder/status",
    "odometry/epoch",
    "agent/alive",
    "command",
    "command_ack",
    "guardian/state",
    "guardian/said",
    "diagnostics/worst",
)
_CONTROL: Tuple[str, ...] = (
    "/calibration",
    "/calibration_epochs",
    "/home",
    "/home_epochs",
    "/stop_all",
    "/land_all",
    "/stop_all/report",
    "/pair_check",
    "/mission/state",
    "/mission/file",
    "/mission/capture",
    "/map/state",
    "/flight_check",
    DIAGNOSTICS,
    "/tf",
    "/tf_static",
)
_SAME_FLIGHT_S = 120.0
ROLES = ("vehicle", "control")


@dataclass(frozen=True)
class RecorderParameters:
    """Parameters of the recorder node. ``mission`` and ``seed`` are for session.yaml, which the
    control PC writes."""

    role: str
    name: str
    folder: str
    vehicles: List[str] = field(default_factory=list)
    mission: Optional[str] = None
    seed: Optional[int] = None
    topics: List[str] = field(default_factory=list)  # more topics to record always, absolute names
    pictures_on: bool = False  # before anybody said what is wanted
    no_picture_s: float = 2.0  # pictures are on, and none came for longer: said
    least_free_mib: int = 500
    part_mib: int = 2048  # a bag that grows beyond is closed, and the next part begins
    # of messages that wait for a slow disk; beyond they are dropped and counted
    most_waiting_mib: int = 96

    def __post_init__(self):
        if self.role not in ROLES:
            raise ValueError(f"role: '{self.role}' is not one of {', '.join(ROLES)}")
        if not self.name.isidentifier():
            raise ValueError(f"name: '{self.name}' is not a ROS name; use letters, digits and _")
        if self.role == "control" and not (self.vehicles and self.mission):
            raise ValueError(
                "vehicles, mission: the control PC's recorder needs both, for session.yaml"
            )
        if min(self.least_free_mib, self.most_waiting_mib, self.part_mib) < 1:
            raise ValueError("least_free_mib, most_waiting_mib, part_mib: must be at least 1")
        if not self.no_picture_s > 0.0:
            raise ValueError(f"no_picture_s: {self.no_picture_s} must be above 0")
        bad = [t for t in self.topics if not t.startswith("/")]
        if bad:
            raise ValueError(f"topics: '{bad[0]}' is not absolute; begin it with /")


@dataclass(frozen=True)
class RecordingPlan:
    """Topics that are always written, and those written only while pictures are on."""

    always: List[str]
    pictures: List[str]


def plan(p: RecorderParameters) -> RecordingPlan:
    """Plans the recording of a machine: role "vehicle" (its own topics, what a map needs of the
    control PC) or "control" (all heard)."""
    if p.role == "vehicle":
        always = [f"/{p.name}/{t}" for t in _VEHICLE] + [*_OF_CONTROL, "/tf_static"]
        return RecordingPlan(
            [*always, DIAGNOSTICS, *p.topics], [f"/{p.name}/{t}" for t in PICTURES]
        )
    heard = [f"/{v}/{t}" for v in p.vehicles for t in _HEARD] + [
        f"/mocap/{v}/pose" for v in p.vehicles
    ]
    return RecordingPlan([*_CONTROL, *heard, *p.topics], [])


def begin(folder: Path, first: str, now_s: float) -> Tuple[int, List[Path]]:
    """Number of the part to write now, and where the bags of an earlier flight were moved to.

    A bag that was not closed and was written a moment ago is of this flight: its recorder died.
    ``now_s``: time of day.
    """
    parts = parts_in(folder, first)
    unclosed = [p for p in (part.with_name(part.name + ACTIVE) for part in parts) if p.exists()]
    if any(abs(now_s - p.stat().st_mtime) < _SAME_FLIGHT_S for p in unclosed):
        return part_number(parts[-1].name, first) + 1, []
    kept = [keep_earlier(p) for part in parts for p in (part, part.with_name(part.name + ACTIVE))]
    return 0, [p for p in kept if p is not None]


def keep_earlier(path: Path) -> Optional[Path]:
    """Where a file that an earlier flight left was moved to, so that it is not written over; None
    where there is none.

    The new name carries the time at which the file was written last: uav1.20260102T030405Z.bag.
    """
    if not path.exists():
        return None
    written = datetime.fromtimestamp(path.stat().st_mtime, timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    stem, _, suffixes = path.name.partition(".")
    kept = path.with_name(f"{stem}.{written}.{suffixes}")
    number = 1
    while kept.exists():
        number += 1
        kept = path.with_name(f"{stem}.{written}-{number}.{suffixes}")
    path.rename(kept)
    return kept

# SPDX-License-Identifier: Apache-2.0
"""What the mission knows of its vehicles at one moment."""

from dataclasses import dataclass, field
from typing import Dict, Optional

import numpy as np


@dataclass(frozen=True)
class VehicleView:
    """One vehicle as heard over the radio; ages in s, infinite where nothing came yet."""

    pose_age_s: float = float("inf")
    T_odom_body: Optional[np.ndarray] = None
    speed_mps: float = float("inf")
    height_m: float = 0.0  # above where it stood disarmed
    state_age_s: float = float("inf")
    connected: bool = False
    armed: bool = False
    mode: str = ""
    sees_front_s: float = 0.0  # for how long it has seen the tag of the vehicle in front
    T_home_cam: Optional[np.ndarray] = None  # once calibration and home are known
    battery_share: float = float("nan")


@dataclass(frozen=True)
class Snapshot:
    """All vehicles, and T_home_odom and T_body_cam of each where known."""

    now_s: float
    vehicles: Dict[str, VehicleView]
    T_home_odom: Dict[str, np.ndarray] = field(default_factory=dict)
    T_body_cam: Dict[str, np.ndarray] = field(default_factory=dict)

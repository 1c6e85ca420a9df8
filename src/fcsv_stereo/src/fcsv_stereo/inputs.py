# SPDX-License-Identifier: Apache-2.0
"""What a mapping method starts from, whatever it was read from."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import List, Optional

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.result import Configuration


@dataclass(frozen=True)
class Picture:
    """An undistorted picture (HxWx3 uint8 RGB), its pinhole camera and the prior of its pose."""

    name: str
    vehicle: str
    stamp_s: float
    image: np.ndarray
    camera: PinholeCamera
    T_home_cam: np.ndarray


@dataclass(frozen=True)
class ConfigurationInput:
    """Pictures of one configuration, in order of time: of the reference camera and of the other one."""

    configuration: Configuration
    references: List[Picture]
    others: List[Picture]


@dataclass(frozen=True)
class MapInput:
    """``kind`` is "session" (home is level, cameras are nearly parallel) or "photographs" (any poses)."""

    kind: str
    configurations: List[ConfigurationInput]
    truth_folder: Optional[Path] = None
    warnings: List[str] = field(default_factory=list)

# SPDX-License-Identifier: Apache-2.0
"""Depth views out of the topics of a live map, whose parts come one by one with one stamp."""

from typing import Any, Dict, Optional

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_guidance.errors import GroundError
from fcsv_guidance.ground.views import DepthView

PARTS = ("depth", "sigma", "kind", "camera", "T_home_cam")
_KEPT = 8  # stamps: parts of one map come together


class LiveViews:
    """Puts together what belongs together; what stays incomplete is forgotten."""

    def __init__(self, name: str = "live map"):
        self._name = name
        self._parts: Dict[float, Dict[str, Any]] = {}

    def add(self, stamp_s: float, part: str, value: Any) -> Optional[DepthView]:
        """The view of a stamp once its last part is here. Raises GroundError where the parts do not
        belong together, ValueError on a part of another name."""
        if part not in PARTS:
            raise ValueError(f"a depth view has no part '{part}'; it has {', '.join(PARTS)}")
        parts = self._parts.setdefault(stamp_s, {})
        parts[part] = value
        if len(parts) < len(PARTS):
            for old in sorted(self._parts)[:-_KEPT]:
                del self._parts[old]
            return None
        del self._parts[stamp_s]
        camera: PinholeCamera = parts.pop("camera")
        height, width = np.shape(parts["depth"])[:2]
        if (camera.width, camera.height) != (width, height):
            raise GroundError(
                f"{self._name}: its camera_info is of a picture of {camera.width} x {camera.height} px, its depth "
                f"of {width} x {height}; publish both of one"
            )
        if any(camera.distortion):
            raise GroundError(
                f"{self._name}: its camera_info has a distortion; depth views have none: rectify"
            )
        return DepthView(self._name, stamp_s=stamp_s, K=camera.K, **parts)

# SPDX-License-Identifier: Apache-2.0
"""Depth views out of the topics of a live map, whose parts come one by one with one stamp."""

from typing import Any, Dict, Optional

from fcsv_guidance.ground.views import DepthView

PARTS = ("depth", "sigma", "kind", "K", "T_home_cam")
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
        return DepthView(self._name, stamp_s=stamp_s, **parts)

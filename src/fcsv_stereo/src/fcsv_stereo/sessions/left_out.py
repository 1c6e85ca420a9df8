# SPDX-License-Identifier: Apache-2.0
"""Single messages of a session that are left out, by topic, reason and stamp."""

import re
from typing import Dict, List, Tuple

_FIGURES = re.compile(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?")
_MOST = 3  # stamps that are named


class LeftOut:
    """Reasons that differ in their figures alone are one."""

    def __init__(self):
        self._found: Dict[Tuple[str, str], Tuple[str, List[float]]] = {}

    def add(self, topic: str, stamp_s: float, reason: str) -> None:
        """One message."""
        _, stamps_s = self._found.setdefault((topic, _FIGURES.sub("#", reason)), (reason, []))
        stamps_s.append(stamp_s)

    def only_reason(self, topic: str) -> str:
        """Why no message of a topic serves, where none does; empty: none was left out."""
        found = [
            (len(stamps_s), reason)
            for (t, _), (reason, stamps_s) in self._found.items()
            if t == topic
        ]
        if not found:
            return ""
        return f"none of its {sum(n for n, _ in found)} messages can be used: {max(found)[1]}"

    def warnings(self) -> List[str]:
        """A line for each topic and reason.

        >>> left_out = LeftOut()
        >>> left_out.add("/uav1/odometry/body", 1000.25, "pose is not finite")
        >>> left_out.warnings()
        ['topic /uav1/odometry/body: 1 message is left out: pose is not finite (stamp 1000.250)']
        """
        return [_line(topic, *said) for (topic, _), said in self._found.items()]


def _line(topic: str, reason: str, stamps_s: List[float]) -> str:
    named = ", ".join(f"{s:.3f}" for s in stamps_s[:_MOST]) + (
        ", ..." if len(stamps_s) > _MOST else ""
    )
    one = len(stamps_s) == 1
    many = "1 message is" if one else f"{len(stamps_s)} messages are"
    return f"topic {topic}: {many} left out: {reason} (stamp{'' if one else 's'} {named})"

# SPDX-License-Identifier: Apache-2.0
"""What the relay of this machine tells of its keys, once a second."""

from typing import Callable

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from fcsv_control.flight_check.keys import Keys


class RelayKeys:
    """``tell`` gets Keys with every report of the relay whose node is ``relay``."""

    def __init__(self, machine: str, relay: str, tell: Callable[[Keys], None]):
        self._status, self._tell = f"keys {machine}", tell
        self._has_keys, self._warning, self._exposed = False, "", ""
        rospy.Subscriber(f"{relay}/links", DiagnosticArray, self._on_links, queue_size=2)
        rospy.Subscriber("/diagnostics", rospy.AnyMsg, self._on_diagnostics, queue_size=20)

    def _on_links(self, message: DiagnosticArray) -> None:
        told = any(_says(status, "encrypted") for status in message.status)
        self._tell(Keys(told or self._has_keys, self._warning, self._exposed))

    def _on_diagnostics(self, message: rospy.AnyMsg) -> None:
        """Every node speaks here: only what the relay says is read."""
        if self._status.encode() not in message._buff and b"relay: health" not in message._buff:
            return
        for status in DiagnosticArray().deserialize(message._buff).status:
            if status.name == self._status:
                self._has_keys = True
                self._warning = "" if status.level == DiagnosticStatus.OK else status.message
            elif status.name.endswith("relay: health"):
                self._exposed = status.message if _says(status, "exposed") else ""


def _says(status: DiagnosticStatus, key: str) -> bool:
    return any(v.key == key and v.value == str(True) for v in status.values)

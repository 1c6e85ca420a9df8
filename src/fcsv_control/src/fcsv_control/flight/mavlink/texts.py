# SPDX-License-Identifier: Apache-2.0
"""What the autopilot says: STATUSTEXT in pieces of 50 characters put together, and the reasons
among them."""

from dataclasses import dataclass, field
from typing import Dict, List, Optional, Tuple

# MAV_SEVERITY
_SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
PIECE = 50  # characters in a STATUSTEXT; a shorter piece is the last of its text
ALERT, CRITICAL = 1, 2  # MAV_SEVERITY
WARNING = 4  # this and more serious ones may be the reason of a refusal
_PATIENCE_S = 1.0
_GAP = "..."

Text = Tuple[int, str]  # severity, text


def severity_name(severity: int) -> str:
    """A MAV_SEVERITY in a word.

    >>> severity_name(2), severity_name(6), severity_name(200)
    ('critical', 'info', 'severity 200')
    """
    return _SEVERITIES[severity] if 0 <= severity < len(_SEVERITIES) else f"severity {severity}"


@dataclass
class _PartialText:
    severity: int
    since_s: float
    pieces: Dict[int, str] = field(default_factory=dict)

    def joined(self, whole: bool) -> Text:
        last = max(self.pieces)
        text = "".join(self.pieces.get(i, _GAP) for i in range(last + 1))
        return self.severity, text if whole else text + _GAP


class TextJoiner:
    """Joins the pieces of a text; one without an id is whole at once. A lost piece leaves a
    mark."""

    def __init__(self):
        self._open: Dict[int, _PartialText] = {}

    def add(
        self, now_s: float, severity: int, text: str, text_id: int = 0, piece: int = 0
    ) -> Optional[Text]:
        """Severity and text once it is whole, else None."""
        if text_id == 0:
            return severity, text
        if piece == 0:
            self._open.pop(text_id, None)  # the id is used again: its last text lost its end
        growing = self._open.setdefault(text_id, _PartialText(severity, now_s))
        growing.pieces[piece] = text
        if len(text) >= PIECE:
            return None
        return self._open.pop(text_id).joined(whole=True)

    def overdue(self, now_s: float) -> List[Text]:
        """Texts whose end never came: as far as they are known."""
        if not self._open:
            return []
        late = [i for i, growing in self._open.items() if now_s - growing.since_s > _PATIENCE_S]
        return [self._open.pop(i).joined(whole=False) for i in late]


class Reasons:
    """Remembers the last texts, to answer why something was refused."""

    def __init__(self, most: int = 20):
        self._most = most
        self._texts: List[Tuple[float, str]] = []

    def add(self, now_s: float, severity: int, text: str) -> None:
        """Informative texts are no reasons and are passed over."""
        if severity <= WARNING:
            self._texts = [*self._texts[1 - self._most :], (now_s, text)]

    def since(self, asked_s: float) -> str:
        """What was said from ``asked_s`` on, each text once, in order; empty where nothing was."""
        return "; ".join(dict.fromkeys(text for at_s, text in self._texts if at_s >= asked_s))

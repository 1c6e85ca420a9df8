# SPDX-License-Identifier: Apache-2.0
"""What goes on, in one line with figures, and the one button that is to be pressed next."""

from dataclasses import dataclass

AFTER, ACCEPT = "after", "accept"  # buttons besides those of actions.TABLE
PLAIN, WAITS, WELL, CARE, LOST = "plain", "waits", "well", "care", "lost"  # what the line tells


@dataclass(frozen=True)
class Guide:
    """``next``: the name of the button that stands out, "" where none is to be pressed; ``sort``:
    one of the above."""

    headline: str
    next: str = ""
    sort: str = PLAIN

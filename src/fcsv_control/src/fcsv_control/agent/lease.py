# SPDX-License-Identifier: Apache-2.0
"""One commander at a time: who may send commands that move the vehicle."""

import math

LEASE_S = 2.0
#: how the name begins under which a mission commands; each of its processes has one of its own
MISSIONS = "mission-"


def is_mission(commander: str) -> bool:
    """Whether who commands is a mission, by his name.

    >>> is_mission("mission-12-34"), is_mission("/console")
    (True, False)
    """
    return commander.startswith(MISSIONS)


class Lease:
    """The first who sends a moving command holds it, until nothing was heard of him for
    ``lease_s``.

    >>> lease = Lease()
    >>> lease.request(10.0, "mission-1"), lease.request(11.0, "mission-2")
    ('', 'mission-1')
    >>> lease.sender_lives(11.5, "mission-1"), lease.request(13.0, "mission-2"), lease.request(14.0, "mission-2")
    (None, 'mission-1', '')
    """

    def __init__(self, lease_s: float = LEASE_S):
        self._lease_s = lease_s
        self._holder, self._heard_s = "", -math.inf

    def holder(self, now_s: float) -> str:
        """Who commands now; empty: nobody."""
        return self._holder if now_s - self._heard_s < self._lease_s else ""

    def sender_lives(self, now_s: float, sender: str) -> None:
        """A sign of life of a sender."""
        if sender and sender == self.holder(now_s):  # no name renews no lease that has run out
            self._heard_s = now_s

    def request(self, now_s: float, sender: str) -> str:
        """A moving command came of ``sender``: "" where he holds the lease now, else who does."""
        holder = self.holder(now_s)
        if holder and holder != sender:
            return holder
        self._holder, self._heard_s = sender, now_s
        return ""

# SPDX-License-Identifier: Apache-2.0
"""Says from when the age of a state counts that came over the radio: from when it was sent, as the relay measured
it."""

from typing import Dict, Sequence, Set

# what a relay lets through is no older: max_age_s of the class `state` in config/links
UNMEASURED_S = 1.0
RELAY = "relay"  # how launch files name the relay's node


class Arrivals:
    """Times are of this machine's monotonic clock. Several threads may use it.

    A relay tells of a topic a moment before or after its message comes here. So times are compared when an age is
    asked for, not when the message comes: until the relay has told of the newest message, the one before it counts.

    >>> a = Arrivals()
    >>> a.came("/uav2/odometry/state", "/uav1/relay"), a.came("/uav1/mavros/state", "/uav1/flight_link")
    (None, None)
    >>> a.since_s("/uav1/mavros/state", 10.0), a.since_s("/uav2/odometry/state", 10.0)  # here; nothing measured yet
    (10.0, 9.0)
    >>> a.on_sent(["/uav2/odometry/state"], [9.4]); a.since_s("/uav2/odometry/state", 10.0)
    9.4
    """

    def __init__(self):
        self._sent_s: Dict[str, float] = {}
        self._relayed: Set[str] = set()

    def came(self, topic: str, publisher: str) -> None:
        """A message came from the node named ``publisher`` (empty: not known)."""
        (self._relayed.add if publisher.rsplit("/", 1)[-1] == RELAY else self._relayed.discard)(
            topic
        )

    def on_sent(self, topics: Sequence[str], sent_s: Sequence[float]) -> None:
        """A relay measured when the newest messages of topics were sent."""
        self._sent_s.update(zip(topics, sent_s))

    def since_s(self, topic: str, came_s: float) -> float:
        """Says from when the newest message of a topic counts, which came at ``came_s``: then, where no relay was
        between. What no relay has measured yet is as old as a relay lets through."""
        if topic not in self._relayed:
            return came_s
        oldest_s = came_s - UNMEASURED_S
        return min(came_s, max(self._sent_s.get(topic, oldest_s), oldest_s))

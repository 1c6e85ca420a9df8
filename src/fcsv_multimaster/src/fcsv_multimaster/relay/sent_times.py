# SPDX-License-Identifier: Apache-2.0
"""When the states that came were sent, for those on this machine who count ages."""

import threading
from typing import Dict

from fcsv_geometry.streams.arrivals import UNMEASURED_S
from fcsv_multimaster.relay.parcel import Parcel


class SentTimes:
    """``came`` notes each parcel that is published here; ``drain`` gives what is new. Several
    threads may call."""

    def __init__(self):
        self._lock, self._new = threading.Lock(), {}

    def came(self, parcel: Parcel) -> None:
        """Only states count: what is repeated until it arrives is no stream whose silence says
        anything."""
        traffic = parcel.rule.traffic
        if traffic.reliable or traffic.link == "bulk":
            return
        most_s = UNMEASURED_S if traffic.max_age_s is None else traffic.max_age_s
        age_s = most_s if parcel.age_s is None else parcel.age_s + parcel.unsure_s
        with self._lock:
            self._new[parcel.topic] = parcel.came_s - age_s

    def drain(self) -> Dict[str, float]:
        """Topic to the monotonic time (s) of this machine at which its newest message was sent at
        the latest."""
        with self._lock:
            new, self._new = self._new, {}
        return new

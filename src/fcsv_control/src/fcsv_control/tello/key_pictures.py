# SPDX-License-Identifier: Apache-2.0
"""When a Tello is asked for a key picture: at once where what comes cannot be shown; no I/O, time
is given.

tellopy asks every 2 s. A key picture is some ten times as many packets as another one, so that it
is lost far more often, and each time that costs the pictures of 2 s.
"""

from fcsv_geometry.streams.flow import RateGate

# an answer takes 0.1 to 0.5 s; faster requests only fill the radio with key pictures
_APART_S = 0.5


class KeyPictures:
    """``due`` after each datagram. ``asked``: how often. One thread.

    >>> keys = KeyPictures()
    >>> [keys.due(now_s, broken) for now_s, broken in ((0.0, 0), (0.1, 1), (0.2, 1), (0.6, 1), (0.7, 0))]
    [False, True, False, True, False]
    >>> keys.asked
    2
    """

    def __init__(self, apart_s: float = _APART_S):
        self._gate = RateGate(1.0 / apart_s, early=0.0)
        self.asked = 0

    def due(self, now_s: float, broken: bool) -> bool:
        """Whether to ask now. ``broken``: datagrams come, and what they build on does not
        (Video.broken)."""
        if not broken or not self._gate.passes(now_s):
            return False
        self.asked += 1
        return True

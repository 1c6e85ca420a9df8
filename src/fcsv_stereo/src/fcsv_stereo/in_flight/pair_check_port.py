# SPDX-License-Identifier: Apache-2.0
"""The pair check's process without its transport: pictures, calibration and home in, pairs to look
at and what they show out."""

import math
from dataclasses import dataclass
from typing import List, Sequence

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.home import HomeFrames
from fcsv_geometry.streams.dispatch import Takers
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_stereo.in_flight.pair_check import PairLook, PairsToLookAt
from fcsv_stereo.model import LivePicture, Picture


@dataclass(frozen=True)
class LookAt:
    """This pair is to be looked at (``pair_check.look``), which takes a while; then PairSeen is
    waited for."""

    a: Picture
    b: Picture


@dataclass(frozen=True)
class PairSeen:
    """What the pictures of the reference and of another vehicle show; ``stamp_s`` of the other's
    picture."""

    reference: str
    vehicle: str
    stamp_s: float
    look: PairLook

    @property
    def problem(self) -> str:
        """What is wrong, in words; "" where nothing is."""
        pair = f"{self.reference} and {self.vehicle}"
        said = f"the pictures of {pair} show another place than their trackers"
        return said if self.look.off else ""


class PairCheckPort:
    """``vehicles`` with the reference first. At most ``rate_hz`` looks a second at a pair, and
    fewer where looking would take more than ``most_share`` of the time.

    Gives LookAt, then PairSeen once it was received; tm.Dropped.
    """

    def __init__(self, vehicles: Sequence[str], rate_hz: float, most_share: float):
        self._pairs = PairsToLookAt(vehicles, 0.9 / rate_hz)
        self._rests = 1.0 / most_share - 1.0  # times as long as it looked
        self._in_home = HomeFrames()
        self._looks, self._began_s, self._rests_until_s = False, 0.0, -math.inf
        self._out: List[object] = []
        self._take = Takers(
            {
                LivePicture: lambda _now_s, m: self._pairs.add(m),
                tm.CalibrationFound: lambda _now_s, m: self._in_home.calibrate(m.links),
                tm.HomeFound: lambda _now_s, m: self._in_home.set_home(m.reference, m.T_odom_home),
                PairSeen: self._seen,
            },
            "a pair check takes no",
        )

    def receive(self, now_s: float, message: object) -> None:
        """A message came. Raises TypeError where its type is not known."""
        self._take[type(message)](now_s, message)

    def _seen(self, now_s: float, m: PairSeen) -> None:
        self._looks = False
        self._rests_until_s = now_s + self._rests * (now_s - self._began_s)
        self._out.append(m)

    def step(self, now_s: float) -> Sequence[object]:
        """What was seen, and the next pair where nobody looks or rests."""
        T_home_odom = self._in_home.T_home_odom
        if T_home_odom and not self._looks and now_s >= self._rests_until_s:
            pair = self._pairs.next_pair()
            if pair is not None:
                self._begin(now_s, pair, T_home_odom)
        out, self._out = self._out, []
        return out

    def _begin(self, now_s: float, pair: Sequence[LivePicture], T_home_odom) -> None:
        unknown = [p.vehicle for p in pair if p.vehicle not in T_home_odom]
        if unknown:
            why = f"where {unknown[0]} is in home is not known: calibrate, then set home"
            self._out.append(tm.Dropped("picture", why))
            return
        try:
            a, b = (p.picture(T_home_odom[p.vehicle]) for p in pair)
        except FcsvError as error:
            self._out.append(tm.Dropped("picture", str(error)))
            return
        self._looks, self._began_s = True, now_s
        self._out.append(LookAt(a, b))

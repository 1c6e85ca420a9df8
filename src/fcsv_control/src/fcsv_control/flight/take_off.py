# SPDX-License-Identifier: Apache-2.0
"""A take-off: the autopilot counts its altitude from its home, which it may have set where it was
armed."""

import logging
from typing import Optional

from pymavlink import mavutil

from fcsv_control.flight.mavlink import commands
from fcsv_control.flight.mavlink.listener import Listener
from fcsv_control.flight.mavlink.requests import Outcome, Request, Requests

_LOG = logging.getLogger(__name__)
_CLIMBS_S = 1.0


class TakeOff:
    """First hears where home is (asked for by who makes this), then commands. Has a Request's
    outcome."""

    def __init__(
        self,
        now_s: float,
        altitude_m: float,
        heard: Listener,
        requests: Requests,
        patience_s: float,
    ):
        self._altitude_m, self._heard, self._requests = altitude_m, heard, requests
        self._until_s = now_s + patience_s
        self._request: Optional[Request] = None
        self._climbs_until_s = float("inf")
        self.over = False
        heard.altitudes_mm.clear()

    def require_done(self) -> None:
        """Raises CommandRefused or LinkError like a Request. Only when over."""
        self._request.require_done()

    def step(self, now_s: float) -> None:
        """Time passed or something was heard."""
        if self._request is None:
            self._command(now_s)
        elif self._request.over:
            self._end(now_s)

    def _command(self, now_s: float) -> None:
        told = self._heard.altitudes_mm
        if len(told) < 2 and now_s < self._until_s:
            return
        above_origin_m = 0.0
        if len(told) == 2:
            above_origin_m = (told["home"] - told["origin"]) / 1000.0
        else:
            _LOG.warning(
                "the autopilot does not tell its home: taken to be at the height of the origin"
            )
        values = (0, 0, 0, 0, 0, 0, self._altitude_m - above_origin_m)
        self._request = self._requests.ask(
            now_s, mavutil.mavlink.MAV_CMD_NAV_TAKEOFF, values, "take-off"
        )

    def _end(self, now_s: float) -> None:
        """A refusal of a repeated command may mean that the first one's acknowledgement was lost:
        does it climb?"""
        request = self._request
        doubtful = request.outcome is Outcome.REFUSED and request.pending.result == commands.FAILED
        if not doubtful or request.pending.sent < 2:
            self.over = True
        elif self._heard.state.landed is False:
            request.outcome, self.over = Outcome.DONE, True
        elif self._climbs_until_s == float("inf"):
            self._climbs_until_s = now_s + _CLIMBS_S
        else:
            self.over = now_s >= self._climbs_until_s

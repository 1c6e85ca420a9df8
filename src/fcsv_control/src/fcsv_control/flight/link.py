# SPDX-License-Identifier: Apache-2.0
"""One flight controller behind MAVLink 2: a thread and a connection around the link's core.

One thread reads, lets time pass and calls back; any thread may send and ask.
"""

import logging
import threading
import time
from typing import Callable, Optional, Tuple, Union

import numpy as np

from fcsv_control.errors import LinkError
from fcsv_control.flight.core import LinkCore, LinkParameters
from fcsv_control.flight.firmware import COPTER
from fcsv_control.flight.messages import (
    BarometerHeard,
    BatteryHeard,
    EstimateMoved,
    Event,
    HomeHeard,
    PoseHeard,
    RcHeard,
    Refused,
    StateHeard,
    TextHeard,
)
from fcsv_control.flight.parameters import ParameterCheck
from fcsv_control.flight.profile import NOTHING, Profile
from fcsv_control.flight.requests import Request
from fcsv_control.flight.state import FlightState
from fcsv_control.flight.take_off import TakeOff
from fcsv_control.flight.timesync import TimeSync
from fcsv_control.flight.transport import Transport

__all__ = ["FlightLink", "LinkParameters"]

_LOG = logging.getLogger(__name__)
_POLL_S = 0.05


class FlightLink:
    """Callbacks, from the reading thread: on_state(), on_pose(T_odom_body, v_odom_mps), on_barometer(height_m),
    on_battery(), on_rc(), on_text(severity, text), on_estimate_moved(step_m), on_refused(reason),
    on_home(above_origin_m).

    ``line`` is an address as Transport has it, or what has Transport's ``receive``, ``send`` and ``close``. ``core``
    is made of ``parameters`` and ``profile`` where there is none. Raises LinkError where the address cannot be opened.
    """

    def __init__(
        self, line: Union[str, Transport], parameters: LinkParameters, profile: Profile = NOTHING,
        core: Optional[LinkCore] = None, **callbacks: Callable,
    ):  # fmt: skip
        self._callbacks = callbacks
        self._core = core or LinkCore(parameters, profile)
        self._changed = threading.Condition()  # guards the core
        self._transport = Transport(line) if isinstance(line, str) else line
        self._running = True
        self._thread = threading.Thread(target=self._read, name="mavlink", daemon=True)
        self._thread.start()

    @property
    def state(self) -> FlightState:
        """What the autopilot says of itself, as of now."""
        return self._core.state

    @property
    def connected(self) -> bool:
        """Whether a heartbeat came within the last 3 s."""
        return self._core.connected(time.monotonic())

    def snapshot(self) -> Tuple[bool, FlightState]:
        """Whether it is connected, and the state, of one moment."""
        with self._changed:
            return self.connected, self._core.state

    @property
    def mode_is_ours(self) -> bool:
        """Whether the mode is one that was commanded here."""
        return self._core.mode_is_ours

    @property
    def origin_set(self) -> bool:
        """Whether the autopilot goes on reporting an origin that lasts."""
        return self._core.origin_set(time.monotonic())

    @property
    def origin_at_zero(self) -> bool:
        """Whether its origin's altitude is 0, with which the height runs away: it has to be restarted."""
        return self._core.heard.origin_at_zero

    @property
    def parameters(self) -> ParameterCheck:
        """The autopilot's parameters against the profile, as far as they were read."""
        return self._core.heard.parameters

    @property
    def firmware(self) -> str:
        """As "ArduCopter 4.6.2"; empty before it was told."""
        return f"{COPTER} {self._core.heard.version}" if self._core.heard.version else ""

    @property
    def foreigner(self) -> str:
        """Which firmware speaks in place of an ArduCopter, in a sentence; empty where none does."""
        return self._core.heard.foreigner

    @property
    def imitated(self) -> str:
        """Which other program sends heartbeats as this autopilot, in a sentence; empty where none does."""
        return self._core.heard.identities.imitated(time.monotonic(), self._core.heard.target)

    @property
    def timesync(self) -> TimeSync:
        """How the autopilot's clock stands to ours, and how long the line takes."""
        return self._core.heard.timesync

    @property
    def strangers(self) -> Tuple[int, ...]:
        """System ids of other autopilots on this line."""
        return self._core.heard.strangers

    def feed_figures(self) -> Tuple[float, float, float]:
        """Rate (Hz) and age (s) of the feed as it goes to the autopilot, distance (m) of estimate and feed."""
        with self._changed:
            now_s = time.monotonic()
            return self._core.feed_rate_hz(now_s), self._core.feed_age_s(now_s), self._core.estimate_apart_m(now_s)

    def send_pose(self, stamp_s: float, T_odom_body: np.ndarray) -> None:
        """External navigation: body pose in the odometry frame (ENU/FLU); ``stamp_s`` monotonic."""
        self._do(lambda: self._core.send_pose(stamp_s, T_odom_body, time.monotonic()))

    def note_reset(self) -> None:
        """The odometry frame was begun anew: see LinkCore.note_reset."""
        self._do(self._core.note_reset)

    def send_set_point(self, T_odom_body: np.ndarray) -> None:
        """Position and yaw target of the body in the odometry frame; heard only in GUIDED."""
        self._do(lambda: self._core.send_set_point(T_odom_body))

    def command(self, number: int, *values: float, what: str = "") -> None:
        """A COMMAND_LONG, repeated until acknowledged. Raises CommandRefused with the reason, or LinkError."""
        self._finish(lambda now_s: self._core.command(now_s, number, *values, what=what))

    def set_mode(self, name: str) -> None:
        """Change mode and see it in the heartbeat. Raises like command."""
        self._finish(lambda now_s: self._core.set_mode(now_s, name))

    def arm(self, value: bool) -> None:
        """Arm or disarm and see it in the heartbeat. Raises like command."""
        self._finish(lambda now_s: self._core.arm(now_s, value))

    def take_off(self, altitude_m: float) -> None:
        """Climb to an altitude above the zero of the odometry frame. Raises like command."""
        self._finish(lambda now_s: self._core.take_off(now_s, altitude_m))

    def close(self) -> None:
        """End the thread, close the connection."""
        self._running = False
        self._thread.join(3.0)
        self._transport.close()

    # ---- the core and the line -------------------------------------------------------------------------------

    def _do(self, action: Callable[[], None]) -> None:
        with self._changed:
            action()
            self._flush()

    def _finish(self, ask: Callable[[float], Union[Request, TakeOff]]) -> None:
        """Ask, and wait until it is over. Raises CommandRefused or LinkError."""
        with self._changed:
            asked = ask(time.monotonic())
            self._core.step(time.monotonic())
            self._flush()
            while not asked.over and self._running:
                self._changed.wait(_POLL_S)
                self._core.step(time.monotonic())
                self._flush()
        if not asked.over:
            raise LinkError("the flight link was closed")
        asked.require_done()

    def _flush(self) -> None:
        for message in self._core.outgoing():
            self._transport.send(message)

    def _read(self) -> None:
        while self._running:
            message = None
            try:
                message = self._transport.receive(_POLL_S)
                with self._changed:
                    now_s = time.monotonic()
                    if message is not None:
                        self._core.take(now_s, message)
                    self._core.step(now_s)
                    self._flush()
                    events = self._core.events()
                    self._changed.notify_all()
                for event in events:
                    self._tell(event)
            except Exception:  # one odd message must not end the link of a flying vehicle
                _LOG.exception("while handling %s", message)

    def _tell(self, event: Event) -> None:
        if isinstance(event, PoseHeard):
            self._call("on_pose", event.T_odom_body, event.v_odom_mps)
        elif isinstance(event, BarometerHeard):
            self._call("on_barometer", event.height_m)
        elif isinstance(event, TextHeard):
            self._call("on_text", event.severity, event.text)
        elif isinstance(event, EstimateMoved):
            self._call("on_estimate_moved", event.step_m)
        elif isinstance(event, Refused):
            self._call("on_refused", event.reason)
        elif isinstance(event, HomeHeard):
            self._call("on_home", event.above_origin_m)
        else:
            self._call({StateHeard: "on_state", BatteryHeard: "on_battery", RcHeard: "on_rc"}[type(event)])

    def _call(self, name: str, *args) -> None:
        try:
            if name in self._callbacks:
                self._callbacks[name](*args)
        except Exception:  # a node that is going down must not end the link of a flying vehicle
            if self._running:
                _LOG.exception("in %s", name)

# SPDX-License-Identifier: Apache-2.0
"""The flight link's core flying an autopilot: the simulated one faster than real time, or one at an
address.

With FCSV_AUTOPILOT (as tcp:127.0.0.1:5760) the tests fly that one, in real time. It must be a
simulation that tells its true pose as SIM_STATE at FCSV_AUTOPILOT_TRUTH (the port two further on,
by default): the feed is made of it. With FCSV_AUTOPILOT_KEY, a key file, both lines are signed.
"""

import math
import os
import threading
import time

os.environ.setdefault("MAVLINK20", "1")

import numpy as np
from pymavlink import mavutil

from fcsv_control.errors import CommandRefused
from fcsv_control.flight.core import LinkCore, LinkParameters
from fcsv_control.flight.mavlink.signing import read_key
from fcsv_control.flight.mavlink.transport import Transport
from fcsv_control.flight.messages import EstimateMoved, PoseReceived, TextReceived
from fcsv_control.flight.pose_feed.feed_check import PoseCheck
from fcsv_control.flight.state import MODES
from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.elsewhere import rounded_pose
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.vehicles.dynamics import Airframe, Quadrotor
from fcsv_sim.vehicles.vehicle import PASS_S, Piloted
from support.autopilots import PROFILE

M = mavutil.mavlink
_SLICE_S = 0.01  # two loops take turns
_FEED_Z_M = 0.05  # the tracker's zero is a little under the vehicle that stands


def flown_link(number=1):
    """A closed loop with the autopilot of FCSV_AUTOPILOT, the simulated one by default. ``number``
    2: one more, of system id 2, at FCSV_AUTOPILOT_SECOND; None where only the first is given."""
    url = os.environ.get("FCSV_AUTOPILOT", "")
    second = os.environ.get("FCSV_AUTOPILOT_SECOND", "")
    if not url:
        return SimulatedLoop(target_system=number)
    if number == 1 or second:
        return AddressLoop(url if number == 1 else second, target_system=number)
    return None


class Loop:
    """``run`` lets time pass; ``offset_m`` jumps the feed, ``feed_hz`` 0 cuts it, ``target`` is
    streamed at 10 Hz and moves along with the estimate."""

    def __init__(self, **parameters):
        self._parameters = LinkParameters(**parameters)
        self.system, self.check = self._parameters.target_system or 1, None
        self.restart()
        self.t, self.offset_m, self.feed_hz, self.target = 0.0, np.zeros(3), 30.0, None
        self.beside = None  # a loop for which time passes as well
        self.moved, self.texts, self.estimate = [], [], None
        # and ``check``, a PoseCheck, between the tracker's poses and the core
        self.tracker = lambda T, _s: T
        self._random = np.random.default_rng(5)
        self._feed_s = self._aimed_s = -math.inf

    def restart(self):
        """As a link that was killed and started again: it knows nothing of before."""
        self.core = LinkCore(self._parameters, PROFILE)
        self.check = None if self.check is None else PoseCheck()

    def pilot_sets(self, mode):
        """A mode that somebody else asks for: the ground station, which is heard whatever
        SYSID_ENFORCE says."""
        self._say(_command(self.system, M.MAV_CMD_DO_SET_MODE, 1.0, MODES[mode], source=(255, 190)))

    @property
    def p_true_m(self):
        return self.T_true[:3, 3]

    def run(self, seconds):
        """Let time pass."""
        end_s = self.t + seconds
        while self.beside is not None and self.t < end_s - 0.5 * _SLICE_S:
            self._run(_SLICE_S)
            self.beside._run(_SLICE_S)
        return self if self.beside is not None else self._run(seconds)

    def minded(self):
        """The core's events."""
        for event in self.core.events():
            if isinstance(event, EstimateMoved):
                self.moved.append(event.step_m)
                if self.target is not None:
                    self.target[:3, 3] += event.step_m
            elif isinstance(event, PoseReceived):
                self.estimate = event.T_odom_body
                if self.check is not None:
                    self.check.estimate(self.t, event.T_odom_body, event.v_odom_mps)
            elif isinstance(event, TextReceived):
                self.texts.append(event.text)

    def fed(self):
        """What is due towards the core."""
        if self.feed_hz and self.t >= self._feed_s and self.T_true is not None:
            # as evenly as passes allow
            self._feed_s = max(self._feed_s + 1.0 / self.feed_hz, self.t - PASS_S)
            T = self.T_true.copy()
            T[:3, 3] += self.offset_m + [0, 0, _FEED_Z_M]
            T = self.tracker(T, self.t)
            if self._believed(T):
                self.core.send_pose(self.t, T)
        if self.target is not None and self.t >= self._aimed_s + 0.1 - 1e-6:
            self._aimed_s = self.t
            self.core.send_set_point(self.target)

    def _believed(self, T):
        if self.check is None:
            return True
        state = self.core.state
        believed = self.check.passes(self.t, self.t, T, state.armed, state.in_the_air)
        if believed and self.check.came_back:
            self.core.note_reset()
        return believed

    def checked(self):
        """With the feed check in the loop, as the flight link has it, and a tracker with a T265's
        noise."""
        self.check, self.tracker = PoseCheck(), lambda T, _s: self.noisy(T)
        return self

    @property
    def doubt(self):
        return "" if self.check is None else self.check.doubt

    def doubt_awaited(self):
        """A doubt, which a test waited for; what comes after is not judged."""
        doubt, self.check = self.check.doubt, None
        return doubt

    def announce_reset(self):
        """As the flight link's service ``odometry_reset``."""
        self.core.note_reset()
        if self.check is not None:
            self.check.begin_again()

    def noisy(self, T):
        """As a T265 that hovers: 1.5 mm and 0.03 deg."""
        noise = transforms.from_xyz_rpy(
            self._random.normal(0, 0.0015, 3), np.radians(self._random.normal(0, 0.03, 3))
        )
        return T @ noise

    def until(self, condition, timeout_s):
        """Whether it came true in time."""
        end_s = self.t + timeout_s
        while not condition() and self.t < end_s:
            self.run(0.05)
        return condition()

    def done(self, request, timeout_s=10.0):
        """Waits for a request; raises what it ended with."""
        assert self.until(lambda: request.over, timeout_s)
        request.require_done()

    def guided(self):
        """As the agent asks: again where the link says so, because this process stood still on a
        busy machine."""
        end_s = self.t + 5.0
        while True:
            try:
                return self.done(self.core.set_mode(self.t, Mode.GUIDED))
            except CommandRefused as refused:
                if "ask again" not in str(refused) or self.t > end_s:
                    raise
            self.run(0.5)

    def ready(self):
        """May be armed, estimate and feed together: an autopilot at an address remembers the place
        of the last test."""
        together = lambda: self.core.estimate_apart_m(self.t) < 0.15  # noqa: E731
        assert self.until(
            lambda: self.core.origin_set(self.t) and self.core.state.prearm_ok and together(), 60.0
        )
        return self

    def hover(self):
        """Holds at 3 m, its target streamed."""
        self.ready()
        self.guided()
        self.done(self.core.arm(self.t, True))
        self.done(self.core.take_off(self.t, 3.0))
        assert self.until(lambda: self.estimate[2, 3] > 2.8, 20.0)
        self.target = transforms.from_xyz_yaw(
            [*self.estimate[:2, 3], 3.0], transforms.yaw(self.estimate)
        )
        self.run(5.0)
        assert abs(self.p_true_m[2] + _FEED_Z_M - 3.0) < 0.3
        self.moved.clear()
        return self

    def furthest_m(self, seconds):
        """How far it was from where it is now, at most."""
        start, most = self.p_true_m.copy(), 0.0
        for _ in range(int(seconds * 10)):
            self.run(0.1)
            most = max(most, float(np.linalg.norm(self.p_true_m - start)))
        return most


class SimulatedLoop(Loop):
    """Core, simulated autopilot and airframe on one clock."""

    def __init__(self, **parameters):
        super().__init__(**parameters)
        self.body = Quadrotor(Airframe(), np.eye(4), 3, 0.3)
        self.pilot = Autopilot(self.body.hover_thrust, 3, ready_s=2.0)  # 20 s in a real one
        self.server, self._piloted = (
            MavlinkServer(self.pilot, self.system),
            Piloted(self.body, self.pilot),
        )
        self.line_up, self._command = True, (0.0,) * 4

    @property
    def T_true(self):
        return self.body.T_world_body

    def reboot(self):
        self.pilot.reboot()

    def _say(self, message):
        self.server.receive(self.t, _received(message))

    def _run(self, seconds):
        for _ in range(int(round(seconds / PASS_S))):
            self.t += PASS_S
            state = self.body.advance(self._command, 4)[-1]
            self._piloted.sense(self.t, state)
            self.server.step(self.t, self._piloted.rpy_rad)
            for message in self.server.outgoing():
                if self.line_up:
                    self.core.receive(self.t, _received(message))
            self.minded()
            self.fed()
            self.core.step(self.t)
            for message in self.core.outgoing():
                if self.line_up:
                    self.server.receive(self.t, _received(message))
            self._command = self._piloted.decide(self.t)
        return self

    def close(self):
        pass


class AddressLoop(Loop):
    """The same in real time, with the autopilot at an address."""

    def __init__(self, url, **parameters):
        super().__init__(**parameters)
        host, port = url.rpartition(":")[0], int(url.rpartition(":")[2])
        file = os.environ.get("FCSV_AUTOPILOT_KEY", "")
        key = read_key(file) if file else None
        self._line = Transport(url, key)
        self._truth = Transport(os.environ.get("FCSV_AUTOPILOT_TRUTH", f"{host}:{port + 2}"), key)
        self.line_up, self.T_true, self._first, self.t = True, None, None, time.monotonic()
        self._running = True
        self._thread = threading.Thread(target=self._hear_truth, daemon=True)
        self._thread.start()

    def reboot(self):
        self._say(_command(self.system, M.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1.0))

    def _say(self, message):
        """On the other line, as a ground station has its own: a UDP line says nothing in the name
        of another system."""
        self._truth.send(message)

    def _run(self, seconds):
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            message = self._line.receive(0.005)
            self.t = time.monotonic()
            if message is not None and self.line_up:
                self.core.receive(self.t, message)
            self.minded()
            self.fed()
            self.core.step(self.t)
            for message in self.core.outgoing():
                if self.line_up:
                    self._line.send(message)
        return self

    def close(self):
        self._running = False
        self._thread.join(3.0)
        self._line.close()
        self._truth.close()

    def _hear_truth(self):
        asked_s = -math.inf
        while self._running:
            if time.monotonic() > asked_s + 2.0:
                asked_s = time.monotonic()
                interval = (M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAVLINK_MSG_ID_SIM_STATE, 10000.0)
                self._truth.send(_command(self.system, *interval))
            m = self._truth.receive(0.05)
            if m is not None and m.get_type() == "SIM_STATE":
                self.T_true = self._pose(m)

    def _pose(self, m):
        self._first = self._first or m
        return rounded_pose(m, self._first)


def _command(system, number, *values, source=None):
    message = M.MAVLink(None).command_long_encode(
        system, 1, number, 0, *values, *[0.0] * (7 - len(values))
    )
    message.get_header().srcSystem, message.get_header().srcComponent = source or (system, 195)
    return message


def _received(message):
    """A message as the other side reads it: texts are strings, not bytes."""
    for name in ("text", "param_id"):
        value = getattr(message, name, None)
        if isinstance(value, bytes):
            setattr(message, name, value.rstrip(b"\0").decode("ascii", "replace"))
    return message

# SPDX-License-Identifier: Apache-2.0
"""A flight link on a real line without ROS: what a test tells it by hand, and looks at."""

import time

from fcsv_control.agent.messages import Kind
from fcsv_control.flight.link import FlightLink
from fcsv_control.flight.port import ExternalNavigationRules, FlightLinkPort
from fcsv_control.flight.settings.link_parameters import LinkParameters
from fcsv_control.flight.settings.profile import NOTHING


class LinkByHand(FlightLink):
    """``told`` has what its port gave; poses and set-points go to its core as they are, past the
    check of the feed."""

    def __init__(self, line, parameters=None, profile=NOTHING):
        self.told = []
        port = FlightLinkPort(
            "uav1",
            parameters or LinkParameters(),
            profile,
            ExternalNavigationRules(),
            1,
            time.monotonic(),
        )
        self.core = port.core
        super().__init__(line, port, lambda output: self.tell(output))

    def tell(self, output):
        self.told.append(output)

    def of(self, kind):
        return [o for o in list(self.told) if isinstance(o, kind)]

    @property
    def state(self):
        return self.core.state

    @property
    def connected(self):
        return self.core.connected(time.monotonic())

    @property
    def origin_set(self):
        return self.core.origin_set(time.monotonic())

    @property
    def parameters(self):
        return self.core.listener.parameters

    @property
    def strangers(self):
        return self.core.listener.strangers

    @property
    def imitated(self):
        return self.core.listener.identities.imitated(time.monotonic(), self.core.listener.target)

    @property
    def firmware(self):
        return self._port._firmware

    def send_pose(self, stamp_s, T_odom_body):
        self._do(lambda: self.core.send_pose(stamp_s, T_odom_body, time.monotonic()))

    def send_set_point(self, T_odom_body):
        self._do(lambda: self.core.send_set_point(T_odom_body))

    def note_reset(self):
        self._do(self.core.note_reset)

    def _do(self, action):
        with self._changed:
            action()
            self._step(time.monotonic())

    def set_mode(self, name):
        self.ask(Kind.SET_MODE, mode=name)

    def arm(self, value):
        self.ask(Kind.ARM, flag=value)

    def take_off(self, altitude_m):
        self.ask(Kind.TAKEOFF, altitude_m=altitude_m)

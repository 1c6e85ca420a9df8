# SPDX-License-Identifier: Apache-2.0
"""The parameter profile that vehicles fly with, and a simulated autopilot on a port."""

import socket
import threading
import time
from pathlib import Path

from fcsv_control.flight.settings.profile import load_profile
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.autopilot.udp import AutopilotUdp
from fcsv_sim.machines.machines import free_port

PROFILE_FILE = Path(__file__).resolve().parents[2] / "config/autopilot/arducopter-4.3-t265.param"
PROFILE = load_profile(PROFILE_FILE)
MUST = {rule.name: rule.value for rule in PROFILE if rule.must}


class Served:
    """A simulated autopilot that speaks to a port, in a thread; ``line``: of its UdpLine."""

    def __init__(self, **line):
        self.port = free_port(socket.SOCK_DGRAM)
        self.url = f"udpin:127.0.0.1:{self.port}"
        self.pilot = Autopilot(0.3, 1)
        self.server = MavlinkServer(self.pilot, 4)
        self.parameters = self.server._parameters
        self.running, self._line = True, line
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        line = AutopilotUdp(self.server, f"127.0.0.1:{self.port}", 4, **self._line)
        while self.running:
            line.step(time.monotonic(), (0.0, 0.0, 0.0))
            time.sleep(0.005)
        line.close()

    def close(self):
        self.running = False
        self.thread.join(3.0)

# SPDX-License-Identifier: Apache-2.0
"""A program in the place of ArduCopter's own simulation: MAVLink on two TCP ports, sticks over UDP,
its true pose.

It flies the simulated autopilot. As ArduCopter's, its SIM_STATE has no stamp, and a position in
1e-7 degrees.
"""

import math
import os
import socket
import threading
import time

os.environ.setdefault("MAVLINK20", "1")

import numpy as np
from pymavlink import mavutil

from fcsv_geometry import rotations, transforms
from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.mavlink_server import MavlinkServer
from fcsv_sim.demo.autopilots import rc_port
from fcsv_sim.machines.machines import free_port
from fcsv_sim.people.rc import RcReceiver
from fcsv_sim.vehicles.dynamics import STEP_S, Airframe, Quadrotor
from fcsv_sim.vehicles.vehicle import PASS_S, Piloted

M = mavutil.mavlink
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 47.4, 8.5, 400.1
METRES_PER_DEG = 111319.49


def sim_state(p_enu_m, rpy_rad, v_enu_mps):
    """SIM_STATE of a pose in east, north, up from where the simulation began."""
    x, y, z = p_enu_m
    lat_deg = LATITUDE_DEG + y / METRES_PER_DEG
    lon_deg = LONGITUDE_DEG + x / METRES_PER_DEG / math.cos(math.radians(LATITUDE_DEG))
    roll, pitch, yaw = rpy_rad
    heading = math.pi / 2 - yaw
    vx, vy, vz = v_enu_mps
    return M.MAVLink_sim_state_message(
        1,
        0,
        0,
        0,
        roll,
        -pitch,
        heading,
        0,
        0,
        0,
        0,
        0,
        0,
        lat_deg,
        lon_deg,
        ALTITUDE_M + z,
        0,
        0,
        vy,
        vx,
        -vz,
        int(lat_deg * 1e7),
        int(lon_deg * 1e7),
    )


class _Port:
    """A listening port; one client at a time, as ArduCopter's."""

    def __init__(self, port, system):
        self._mav = M.MAVLink(None, srcSystem=system, srcComponent=1)
        self._server = socket.create_server(("127.0.0.1", port))
        self._server.settimeout(0.0)
        self._client = None

    def received(self):
        if self._client is None:
            try:
                self._client, _ = self._server.accept()
                self._client.settimeout(0.0)
            except BlockingIOError:
                return []
        try:
            data = self._client.recv(65536)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._client.close()
            self._client = None
            return []
        return [m for m in self._mav.parse_buffer(data) or [] if m.get_type() != "BAD_DATA"]

    def send(self, message):
        if self._client is not None:
            try:
                self._client.send(message.pack(self._mav))
            except OSError:
                pass

    def close(self):
        for each in filter(None, (self._client, self._server)):
            each.close()


class CopterElsewhere:
    """Runs in a thread of its own until ``close``. ``truth``: whether it tells its true pose."""

    def __init__(
        self,
        system=1,
        ready_s=2.0,
        truth=True,
        speed=1.0,
        vehicle=M.MAV_TYPE_QUADROTOR,
        armed=False,
    ):
        self.port = free_port()
        self.url = f"tcp:127.0.0.1:{self.port}"
        self.system, self.speed, self._truth, self._vehicle = system, speed, truth, vehicle
        self._armed = armed
        self._body = Quadrotor(Airframe(), transforms.from_xyz_yaw([0.0, 0.0, 0.0], 0.3), 1, 0.0)
        self.autopilot = Autopilot(self._body.hover_thrust, 1, ready_s)
        self._server = MavlinkServer(self.autopilot, system)
        self._piloted = Piloted(self._body, self.autopilot)
        self._line, self._beside = _Port(self.port, system), _Port(self.port + 2, system)
        self._sticks = RcReceiver(rc_port(self.url))
        self.p_enu_m, self._rate_hz, self.running = np.zeros(3), 0.0, True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        command, due_s, told_s = (0.0, 0.0, 0.0, 0.0), time.monotonic(), -math.inf
        while self.running:
            due_s = max(due_s + PASS_S, time.monotonic() - 0.2)
            time.sleep(max(0.0, due_s - time.monotonic()))
            now_s = time.monotonic()
            state = self._body.advance(command, int(round(PASS_S / STEP_S)))[-1]
            self._piloted.sense(now_s, state)
            frame = self._sticks.newest()
            if frame is not None:
                self.autopilot.rc_frame(now_s, frame)
            for message in self._line.received():
                self._server.receive(now_s, message)
            self._server.step(now_s, self._piloted.rpy_rad)
            for message in self._server.outgoing():
                self._line.send(message)
            command = self._piloted.decide(now_s)
            self._answer()
            self.p_enu_m = state[:3].copy()
            if self._rate_hz and self._truth:
                self._beside.send(
                    sim_state(state[:3], rotations.rpy(state[6:10].tolist()), state[3:6])
                )
            if now_s > told_s + 0.2:
                told_s = now_s
                armed = M.MAV_MODE_FLAG_SAFETY_ARMED if self._armed or self.autopilot.armed else 0
                self._beside.send(M.MAVLink_heartbeat_message(self._vehicle, 3, 1 | armed, 0, 3, 3))

    def _answer(self):
        for m in self._beside.received():
            if m.get_type() == "COMMAND_LONG" and m.command == M.MAV_CMD_SET_MESSAGE_INTERVAL:
                if int(m.param1) == M.MAVLINK_MSG_ID_SIM_STATE:
                    self._rate_hz = 1e6 / m.param2
            elif m.get_type() == "PARAM_REQUEST_READ" and m.param_id == "SIM_SPEEDUP":
                self._beside.send(
                    M.MAVLink_param_value_message(b"SIM_SPEEDUP", self.speed, 9, 1, 0)
                )

    @property
    def fed(self):
        """Whether poses have come."""
        return self.autopilot.estimator._vision_s is not None

    def close(self):
        self.running = False
        self._thread.join(3.0)
        for each in (self._line, self._beside, self._sticks):
            each.close()

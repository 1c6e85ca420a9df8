# SPDX-License-Identifier: Apache-2.0
"""Unmodified tellopy against a simulated Tello: one in each of two network namespaces, or both on
loopback.

tellopy's threads catch every exception and only log it, so whatever it logs as an error is kept in
``errors``. Its dispatcher is one for the whole process, and every Tello in it obeys what another
one hears: one client at a time.
"""

import contextlib
import itertools
import os
import socket
import threading
import time
from typing import List

import tellopy
from tellopy._internal import dispatcher
from tellopy._internal import tello as tello_module

from fcsv_geometry.programs import netns
from fcsv_sim.tello.program import ProgramParameters, switched_on
from fcsv_sim.tello.udp import run
from support.waiting import within

_numbers = itertools.count(1)


until = within(10.0)


class SwitchedOn:
    """A simulated Tello in a thread, and the shell with its core for the test to look at."""

    def __init__(self, parameters: ProgramParameters):
        self._over = threading.Event()
        self._open = switched_on(parameters)
        self.shell = self._open.__enter__()
        self.drone = self.shell.drone
        self._thread = threading.Thread(
            target=run, args=(self.shell, self._over.is_set), name="simulated Tello"
        )
        self._thread.start()

    @property
    def position_m(self):
        return self.drone.body.T_world_body[:3, 3].copy()

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self._open.__exit__(None, None, None)


class Client:
    """A tellopy.Tello as its users make it; its events by name, each with the time at which it
    came."""

    def __init__(self, namespace: str = "", address=None, **ports):
        self.errors: List[str] = []
        self.events = {
            name: []
            for name in (
                "flight_data",
                "log_data",
                "wifi",
                "sample_mvo",
                "sample_imu",
                "disconnected",
                "connected",
                "video_data",
                "sample_raw",
            )
        }
        self._log_error, tello_module.log.error = tello_module.log.error, self.errors.append
        self._before = set(threading.enumerate())
        with netns.inside(namespace):
            self.tello = tellopy.Tello(**ports)
        # its own are no daemons; the camera of a Tello may begin to be read at this moment
        self._threads = {t for t in set(threading.enumerate()) - self._before if not t.daemon}
        self.tello.set_loglevel(tellopy.Tello.LOG_ERROR)
        if address is not None:
            self.tello.tello_addr = address
        for name in self.events:
            self.tello.subscribe(getattr(self.tello, f"EVENT_{name.upper()}"), self._handler(name))

    def _handler(self, name: str):
        kept = self.events[name]
        return lambda event, sender, data, **_: kept.append((time.monotonic(), data))

    def connect(self, timeout_s: float = 10.0) -> "Client":
        self.tello.connect()
        self.tello.wait_for_connection(timeout_s)
        return self

    def newest(self, name: str):
        return self.events[name][-1][1] if self.events[name] else None

    def close(self) -> None:
        self.tello.quit()
        try:
            for thread in self._threads:
                thread.join(5.0)
            assert not [t.name for t in self._threads if t.is_alive()]
        finally:
            self.tello.sock.close()
            tello_module.log.error = self._log_error
            dispatcher.signals.clear()


class Air:
    """Makes Tellos and clients; close() ends them all."""

    def __init__(self, folder):
        self._folder, self._things = folder, []

    def network(self) -> str:
        """A name for two namespaces that are not there yet."""
        return f"fcsv-{os.getpid()}-air{next(_numbers)}-tello1"

    def drone(self, network: str, vehicle: str = "tello1", **parameters) -> SwitchedOn:
        on = SwitchedOn(
            ProgramParameters(vehicle, str(self._folder), network=network, **parameters)
        )
        self._things.append(on)
        return on

    def client(self, network: str = "", **given) -> Client:
        client = Client(f"{network}-pilot" if network else "", **given)
        self._things.append(client)
        return client

    def close(self) -> None:
        """All of them, also where one does not end as it should."""
        with contextlib.ExitStack() as closing:
            for thing in self._things:
                closing.callback(thing.close)
            self._things = []


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("", 0))
        return sock.getsockname()[1]

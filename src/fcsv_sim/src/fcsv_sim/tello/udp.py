# SPDX-License-Identifier: Apache-2.0
"""The simulated Tello's sockets: a thin shell that moves datagrams and lets time pass."""

import socket
import time
from typing import Callable, Optional

from fcsv_sim.errors import SimulationError
from fcsv_sim.tello.camera import Camera
from fcsv_sim.tello.vehicle import TelloDrone

PORT = 8889
ADDRESS = "192.168.10.1"
_MOST = 2048  # bytes of a datagram
_AT_ONCE = 200  # datagrams of a pass: more are lost, as in a full receive buffer


class AddressError(SimulationError):
    """The address cannot be had; the message says what to do."""


def open_socket(address: str, port: int) -> socket.socket:
    """A bound, non-blocking UDP socket in the network namespace of this thread. Raises
    AddressError."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.bind((address, port))
    except OSError as error:
        sock.close()
        raise AddressError(
            f"simulated Tello: cannot bind {address}:{port} ({error.strerror}); start it in a network namespace that "
            f"has this address, or give another address"
        ) from error
    sock.setblocking(False)
    return sock


class Shell:
    """Carries datagrams between two sockets, which stay its maker's, and a TelloDrone."""

    def __init__(
        self,
        drone: TelloDrone,
        control: socket.socket,
        video: socket.socket,
        camera: Optional[Camera] = None,
    ):
        self.drone, self.camera = drone, camera
        self._control, self._video = control, video

    def step(self, now_s: float) -> None:
        """Everything that came goes in, everything that is due goes out."""
        for _ in range(_AT_ONCE):
            try:
                data, sender = self._control.recvfrom(_MOST)
            except BlockingIOError:
                break
            except ConnectionError:
                continue  # nobody listened where something was sent to
            self.drone.received(now_s, data, sender)
        self.drone.advance_to(now_s)
        if self.camera is not None:
            self.camera.step(now_s, self.drone)
        for data, to, is_video in self.drone.datagrams(now_s):
            try:
                (self._video if is_video else self._control).sendto(data, to)
            except OSError:
                continue  # lost, as in the air


def run(shell: Shell, over: Callable[[], bool]) -> None:
    """Real time, until ``over()``."""
    while not over():
        shell.step(time.time())
        time.sleep(max(0.001, shell.drone.next_pass_s - time.time()))

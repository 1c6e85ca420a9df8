# SPDX-License-Identifier: Apache-2.0
"""Where the simulated Tellos of one computer are, and how their flight links reach them: the launch
files' arguments.

In network namespaces, so that unmodified tellopy finds each at its usual address; where these are
not permitted, on loopback at ports of their own, which the links are told.
"""

import contextlib
import itertools
import os
import socket
from dataclasses import dataclass
from typing import Dict, Iterator, Sequence, Tuple

from fcsv_sim.machines import namespaces
from fcsv_sim.machines.machines import free_port
from fcsv_sim.tello.program import PILOT_ADDRESS
from fcsv_sim.tello.udp import ADDRESS, PORT

_CLIENT_PORT, _VIDEO_PORT = 9000, 6038  # tellopy's own
_numbers = itertools.count(1)


@dataclass(frozen=True)
class TelloPlace:
    """Names the place of one Tello. ``network``: empty on loopback; ``port``: its own,
    ``client_port`` that of who flies it."""

    network: str = ""
    address: str = ADDRESS
    port: int = PORT
    client_port: int = _CLIENT_PORT
    video_port: int = _VIDEO_PORT

    @property
    def drone(self) -> Dict[str, object]:
        """Arguments of sim_tello_drone.launch."""
        return {
            "network": self.network,
            "address": self.address,
            "port": self.port,
            "video_port": self.video_port,
        }

    @property
    def link(self) -> Dict[str, object]:
        """What its flight link is told: RadioParameters of fcsv_control/tello/library.py."""
        network = f"{self.network}-pilot" if self.network else ""
        return {
            "network": network,
            "address": self.address,
            "tello_port": self.port,
            "port": self.client_port,
            "video_port": self.video_port,
        }


@contextlib.contextmanager
def places(vehicles: Sequence[str]) -> Iterator[Tuple[Dict[str, TelloPlace], str]]:
    """A place for each, as long as the block runs; and what is to be said of them, empty where all
    is as it should be.

    The namespaces outlive a Tello that is switched off and on again.
    """
    why = namespaces.permitted()
    if why:
        yield (
            {v: _on_loopback() for v in vehicles},
            f"{why}; so they are on loopback, each at ports of its own",
        )
        return
    with contextlib.ExitStack() as made:
        stems = {v: f"fcsv-{os.getpid()}-place{next(_numbers)}-{v}" for v in vehicles}
        for stem in stems.values():
            made.enter_context(namespaces.named(stem, ADDRESS, PILOT_ADDRESS))
        yield {v: TelloPlace(stem) for v, stem in stems.items()}, ""


def _on_loopback() -> TelloPlace:
    port, client, video = (free_port(socket.SOCK_DGRAM) for _ in range(3))
    return TelloPlace("", "127.0.0.1", port, client, video)

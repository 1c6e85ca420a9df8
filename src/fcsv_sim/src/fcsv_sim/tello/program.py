# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello that is switched on: its network, its sockets, its core; both programs around
it use this."""

import contextlib
import time
from dataclasses import dataclass, field
from typing import Iterator

from fcsv_geometry.programs import netns
from fcsv_sim.machines import namespaces
from fcsv_sim.tello.camera import Camera
from fcsv_sim.tello.pictures import SimulatedVideoParameters, VideoTask
from fcsv_sim.tello.udp import ADDRESS, PORT, Shell, open_socket
from fcsv_sim.tello.vehicle import TelloDrone, TelloDroneParameters

PILOT_ADDRESS = "192.168.10.2"  # what a Tello gives to the first who joins its Wi-Fi


@dataclass(frozen=True)
class ProgramParameters(TelloDroneParameters):
    """``network``: it has its address in the network namespace NETWORK-device, who flies it is in
    NETWORK-pilot; both are made where they are not there. Empty: the address is one of this
    machine.

    ``video_port``: where pictures go; 0: to the port that the client names, which is 6038 in
    tellopy.
    """

    network: str = ""
    address: str = ADDRESS
    port: int = PORT
    video_port: int = 0
    video: SimulatedVideoParameters = field(default_factory=SimulatedVideoParameters)

    def __post_init__(self):
        for name, least in (("port", 1), ("video_port", 0)):
            if not least <= getattr(self, name) <= 65535:
                raise ValueError(f"{name}: {getattr(self, name)} must be {least} to 65535")


@contextlib.contextmanager
def switched_on(parameters: ProgramParameters) -> Iterator[Shell]:
    """Its shell, to be run. Raises NamespaceError and AddressError."""
    p = parameters
    with contextlib.ExitStack() as open_things:
        device = ""
        if p.network:
            device = open_things.enter_context(
                namespaces.named(p.network, p.address, PILOT_ADDRESS)
            ).device
        with netns.inside(device):
            control = open_things.enter_context(open_socket(p.address, p.port))
            video = open_things.enter_context(open_socket(p.address, 0))
        drone = TelloDrone(p, time.time() - 0.1)
        # compiles what is compiled at its first use, before anybody waits for it
        drone.advance_to(time.time())
        drone.link.video_port_instead = p.video_port
        camera = None
        if p.video.world:
            camera = open_things.enter_context(
                contextlib.closing(Camera(VideoTask(p.vehicle, p.sim_dir, p.video)))
            )
        yield Shell(drone, control, video, camera)


def words(parameters: ProgramParameters) -> str:
    """Where it is to be reached, as one line."""
    p = parameters
    where = f"; fly it from network namespace {p.network}-pilot" if p.network else ""
    return f"{p.vehicle}: a Tello at {p.address}:{p.port}{where}"

# SPDX-License-Identifier: Apache-2.0
"""The Tello's camera as a process of its own: a picture takes longer than a pass of the flight
controller.

It gets lines of JSON on its input (Orders) and writes pictures to its output: a head, then H.264.
It ends with its input, so also when who started it is killed.
"""

import json
import os
import select
import struct
import sys
import time
from dataclasses import asdict, dataclass, field
from typing import BinaryIO, List, Optional

from fcsv_geometry import config
from fcsv_geometry.errors import FcsvError, PoseUnavailable
from fcsv_sim.render.renderer import require_samples
from fcsv_sim.sensors.camera import CameraParameters
from fcsv_sim.sensors.photographer import Photographer
from fcsv_sim.tello.encoder import Encoder
from fcsv_sim.world.town import Town

HEAD = struct.Struct("<dI")  # stamp (s, wall clock), bytes of H.264
_LATENCY_S = 0.02  # pictures are of a moment that just passed
_LONGEST_S = 0.2  # without a look at the input


def _tello_camera() -> CameraParameters:
    return CameraParameters(width=960, height=720, horizontal_fov_deg=70.1)  # thesis table 4.1


@dataclass(frozen=True)
class SimulatedVideoParameters:
    """``world``: none, no video. ``delay_s``: until a picture is sent, of exposure and encoder; ?
    of the real one.

    A real one sends 30 pictures a second; one of 960 x 720 takes 0.2 s of a core here. ``samples``
    as in Renderer.
    """

    world: str = ""
    world_seed: int = 1
    vehicles: List[str] = field(default_factory=list)
    vehicles_dir: str = ""
    rate_hz: float = 3.0
    samples: int = 1
    delay_s: float = 0.1
    camera: CameraParameters = field(default_factory=_tello_camera)

    def __post_init__(self):
        if not 0.0 < self.rate_hz <= 30.0:
            raise ValueError(f"rate_hz: {self.rate_hz} must be above 0 and at most 30")
        if self.delay_s < 0.0:
            raise ValueError(f"delay_s: {self.delay_s} must not be negative")
        if self.world and not self.vehicles_dir:
            raise ValueError("vehicles_dir: a camera needs the folder with the vehicles' files")
        require_samples(self.samples)


@dataclass(frozen=True)
class Orders:
    """What the Tello wants of its camera; a ``key`` higher than before asks for a key picture."""

    on: bool = False
    bit_per_s: float = 2e6
    key: int = 0


@dataclass(frozen=True)
class VideoTask:
    """What the process is started with."""

    vehicle: str
    sim_dir: str
    video: SimulatedVideoParameters

    def command(self) -> List[str]:
        return [sys.executable, "-m", "fcsv_sim.tello.pictures", json.dumps(asdict(self))]


class _Input:
    """The newest orders; ``over`` once there will be no more."""

    def __init__(self, descriptor: int):
        self._descriptor, self._rest = descriptor, b""
        self.orders, self.over = Orders(), False

    def wait(self, longest_s: float) -> None:
        while select.select([self._descriptor], [], [], max(0.0, longest_s))[0]:
            read = os.read(self._descriptor, 4096)
            self.over = not read
            if self.over:
                return
            *lines, self._rest = (self._rest + read).split(b"\n")
            if lines:
                self.orders = Orders(**json.loads(lines[-1].decode()))
                longest_s = 0.0


def send_pictures(task: VideoTask, given: _Input, out: BinaryIO) -> None:
    """Pictures at their rate as long as they are wanted, until the input ends."""
    p, key = task.video, 0
    town = Town.generate(p.world_seed, p.world)
    camera = Photographer(
        task.vehicle, p.vehicles, p.vehicles_dir, task.sim_dir, town, p.world_seed, p.camera
    )
    encoder, due_s = Encoder(camera.model.width, camera.model.height, p.rate_hz), 0.0
    while not given.over:
        now_s = time.time()
        if not given.orders.on or now_s < due_s:
            given.wait(min(_LONGEST_S, due_s - now_s) if given.orders.on else _LONGEST_S)
            continue
        due_s = max(due_s + 1.0 / p.rate_hz, now_s)
        given.wait(0.0)
        orders = given.orders
        try:
            shot = camera.photograph(now_s - _LATENCY_S, p.samples)
        except PoseUnavailable:
            continue  # not switched on yet
        data = encoder.encode(shot.rgb, orders.bit_per_s, orders.key > key)
        key = orders.key
        out.write(HEAD.pack(shot.stamp_s, len(data)) + data)
        out.flush()


def main(argv: Optional[List[str]] = None) -> int:
    """Run the process; its one argument is a Task as JSON."""
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    # the flight controller may have more, pictures have not
    os.setpriority(os.PRIO_PROCESS, 0, max(0, nice))
    try:
        task = config.from_mapping(json.loads((argv or sys.argv[1:])[0]), VideoTask, "pictures")
        send_pictures(task, _Input(sys.stdin.fileno()), sys.stdout.buffer)
    except FcsvError as error:
        print(f"camera of the simulated Tello: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main())

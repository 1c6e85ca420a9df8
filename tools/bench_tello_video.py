#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What the simulated Tello's video costs: processor time to render and to encode a picture, and its bytes, by size.

.venv/bin/python tools/bench_tello_video.py        # after: . devel/setup.sh; without ROS
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.vehicle import load_vehicles
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.tello.encoder import Encoder
from fcsv_sim.tello.video import BIT_RATES
from fcsv_sim.world.town import Town

ROOT = Path(__file__).resolve().parents[1]
RATE_HZ, AT_M, TURNS_RAD = 3.0, (3.0, 0.5, 1.2), 0.02
MEASURED = "render: {:5.3f} s  encode: {:5.3f} s  key picture: {:6.1f} kB  others: {:6.1f} kB"


def measure(town: Town, width: int, count: int) -> str:
    """One size: means over ``count`` pictures, of which the first is not counted and each turns a little on."""
    lens = CameraParameters(width=width, height=width * 3 // 4, horizontal_fov_deg=70.1)
    T_body_cam = load_vehicles(ROOT / "config/vehicles", ["tello1"])["tello1"].T_body_cam
    camera = SimulatedCamera(Renderer(town), T_body_cam, lens, 1)
    encoder = Encoder(lens.width, lens.height, RATE_HZ)
    rendered, encoded, keys, others = [], [], [], []
    for k in range(count + 1):
        begun_s = time.process_time()
        shot = camera.shoot(k / RATE_HZ, transforms.from_xyz_yaw(AT_M, TURNS_RAD * k), (), 1)
        made_s = time.process_time()
        stream = encoder.encode(shot.rgb, BIT_RATES[0], k % 6 == 0)
        if k:
            rendered.append(made_s - begun_s)
            encoded.append(time.process_time() - made_s)
            (others if k % 6 else keys).append(len(stream) / 1000.0)
    return MEASURED.format(*(float(np.mean(v)) for v in (rendered, encoded, keys, others)))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--world", default="street")
    parser.add_argument("--pictures", type=int, default=24, help="of each size")
    args = parser.parse_args()
    town = Town.generate(1, args.world)
    for width in (960, 640, 480):
        print(f"{width} x {width * 3 // 4}  {measure(town, width, args.pictures)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

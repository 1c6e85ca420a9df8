# SPDX-License-Identifier: Apache-2.0
"""`rosrun fcsv_sim world`: the town of a seed as a mesh or a picture; compiles the renderer's
kernels on the way."""

import argparse
import sys
import time
from pathlib import Path
from typing import List, Optional

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.programs.writing import in_words
from fcsv_geometry.vehicles.vehicle import Mount, VehicleGeometry
from fcsv_sim.errors import SimulationError
from fcsv_sim.render.bodies import RenderedBody
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world.export import write_ply
from fcsv_sim.world.town import PLACES, WORLDS, Town


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status 2 with one line where a file cannot be written or an argument is wrong."""
    args = _parse(argv)
    try:
        return _run(args)
    except FcsvError as error:
        print(f"world: {error}", file=sys.stderr)
        return 2


def _run(args) -> int:
    if args.seed < 0:
        raise SimulationError(f"--seed {args.seed}: must not be negative")
    started = time.monotonic()
    town = Town.generate(args.seed, args.world)
    print(
        f"{args.world}, seed {args.seed}: {len(town.triangles)} triangles in {time.monotonic() - started:.1f} s"
    )
    if args.ply:
        _write(args.ply, lambda path: write_ply(town, path))
    shot = _photograph(town, args)
    if args.picture:
        _write(args.picture, lambda path: _write_picture(path, shot.rgb))
        known = np.isfinite(shot.depth)
        print(
            f"depth {np.nanmin(shot.depth):.1f} to {np.nanmax(shot.depth):.1f} m, sky {100 * (1 - known.mean()):.0f} %"
        )
    return 0


def _photograph(town: Town, args):
    """A picture as the cameras take it, a vehicle in front: whatever they need is compiled then."""
    forward = Mount((0.0, 0.0, 0.0))
    stand_in = VehicleGeometry(
        "front", 1, 1, 0.16, forward, forward, Mount((-0.16, 0.0, 0.02), (0.0, 0.0, 180.0))
    )
    camera = SimulatedCamera(Renderer(town), forward_camera(), CameraParameters(), args.seed)
    T_world_body = transforms.from_xyz_rpy(
        args.xyz, np.radians([0.0, args.pitch_deg, args.yaw_deg])
    )
    ahead = T_world_body @ transforms.from_xyz_yaw([3.5, 0.0, -0.5], 0.0)
    camera.shoot(0.0, T_world_body, [RenderedBody(stand_in, ahead)])
    return camera.shoot(5.0, T_world_body, [RenderedBody(stand_in, ahead)] if args.vehicle else [])


def forward_camera() -> np.ndarray:
    """T_body_cam of a camera in the body's origin that looks along x."""
    return transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))


def _write(path: str, write) -> None:
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        write(path)
    except OSError as error:
        raise SimulationError(in_words(error, path)) from error
    print(f"wrote {path}")


def _write_picture(path: str, rgb: np.ndarray) -> None:
    suffix = Path(path).suffix
    if suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise SimulationError(f"{path}: a picture ends in .png or .jpg")
    _, data = cv2.imencode(suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    Path(path).write_bytes(data.tobytes())


def _parse(argv):
    parser = argparse.ArgumentParser(prog="world", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--world", choices=[*WORLDS, *PLACES], default="street", help="kind of world"
    )
    parser.add_argument("--ply", help="write the town as a binary PLY mesh")
    parser.add_argument(
        "--picture", help="write a picture (.png, .jpg) as the simulated camera takes it"
    )
    parser.add_argument(
        "--xyz", type=float, nargs=3, default=[1.0, 0.0, 8.0], help="camera's place (m)"
    )
    parser.add_argument("--yaw-deg", type=float, default=0.0)
    parser.add_argument("--pitch-deg", type=float, default=0.0, help="positive looks down")
    parser.add_argument("--vehicle", action="store_true", help="with a vehicle 3.5 m ahead")
    return parser.parse_args(argv)

# SPDX-License-Identifier: Apache-2.0
"""A drawn site: folders of photographs from several views of one world, as trackers with errors
pose them.

Each is what a flight would leave: an own home, pictures with the errors of its tracker,
``priors.csv`` and ``station.yaml`` that state their sizes, and ``truth.json`` beside, which no
reader of photographs opens.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import List, Sequence, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.world.town import Town
from fcsv_stereo.posed.priors import write_priors

TRUTH = "truth.json"
_T_BODY_CAM = transforms.transform(transforms.R_FLU_OPTICAL, np.zeros(3))
_PLACE_SIGMA_M, _ATTITUDE_SIGMA_RAD = 0.03, np.radians(1.0)  # how steadily vehicles hover


@dataclass(frozen=True)
class SiteErrors:
    """Standard deviations of what trackers say: scale of a flight (share), yaw of its home (rad),
    place of its home per axis (m); of each other picture against the reference, per axis: rotation
    (rad), place (share of the baseline)."""

    scale: float = 0.01
    yaw_rad: float = float(np.radians(0.1))
    place_m: float = 0.5
    rotation_rad: float = float(np.radians(0.15))
    share: float = 0.005


@dataclass(frozen=True)
class Stand:
    """Where the reference camera of a view is (x, y, z m, world), its heading, and how far it looks
    down (rad)."""

    xyz_m: Tuple[float, float, float]
    heading_rad: float
    down_rad: float = 0.0


def ring(
    count: int, middle_m: Sequence[float], radius_m: float, step_rad: float, height_m: float
) -> List[Stand]:
    """Stands on a circle, ``step_rad`` from each to the next, all looking at its middle (x, y
    m)."""
    stands = []
    for i in range(count):
        a = np.pi + (i - 0.5 * (count - 1)) * step_rad
        x, y = middle_m[0] + radius_m * np.cos(a), middle_m[1] + radius_m * np.sin(a)
        stands.append(Stand((float(x), float(y), height_m), float(a - np.pi), 0.12))
    return stands


def panoramas(places: Sequence[Tuple[float, float, float]], headings: int = 4) -> List[Stand]:
    """Stands at ``places`` (x, y, z m), each with ``headings`` all round, from x on."""
    turns = [2.0 * np.pi * k / headings for k in range(headings)]
    return [Stand((x, y, z), float(turn), 0.12) for x, y, z in places for turn in turns]


def draw_site(
    town: Town,
    stands: Sequence[Stand],
    out: Path,
    seed: int = 1,
    errors: SiteErrors = SiteErrors(),
    size: Tuple[int, int] = (640, 480),
    baselines_m: Sequence[float] = (2.0, 4.0, 6.0, 8.0),
) -> List[Path]:
    """A folder view01, view02, ... for each stand; their paths. The same for the same seed. A view
    that is there, and whole, is left as it is: a stopped drawing goes on."""
    renderer, folders = Renderer(town), []
    for number, stand in enumerate(stands, 1):
        folders.append(Path(out) / f"view{number:02d}")
        if (folders[-1] / TRUTH).exists():  # written last
            continue
        random = np.random.default_rng([seed, number])
        _draw(renderer, stand, folders[-1], random, errors, size, baselines_m)
    return folders


def _draw(
    renderer, stand: Stand, folder: Path, random, errors: SiteErrors, size, baselines_m
) -> None:
    parameters = CameraParameters(
        width=size[0], height=size[1], distortion=(0.0,) * 5, mount_deg=0.0
    )
    camera = SimulatedCamera(renderer, _T_BODY_CAM, parameters, int(random.integers(1 << 30)))
    T_world_stand = transforms.from_xyz_rpy(stand.xyz_m, [0.0, stand.down_rad, stand.heading_rad])
    scale = float(np.exp(errors.scale * random.standard_normal()))
    (folder / "images").mkdir(parents=True, exist_ok=True)
    names, posed = [], []
    for i, baseline_m in enumerate((0.0, *baselines_m)):
        off = np.array([0.0, -baseline_m, 0.0]) + random.normal(0.0, _PLACE_SIGMA_M, 3)
        T = transforms.from_xyz_rpy(off, random.normal(0.0, _ATTITUDE_SIGMA_RAD, 3))
        shot = camera.shoot(float(i), T_world_stand @ T)
        names.append(f"{i:02d}.png")
        cv2.imwrite(str(folder / "images" / names[-1]), cv2.cvtColor(shot.rgb, cv2.COLOR_RGB2BGR))
        posed.append(shot.T_world_cam)
        if i == 0:
            np.save(folder / "true_depth.npy", shot.depth.astype(np.float32))
    T_world_home = transforms.level(posed[0] @ transforms.invert(_T_BODY_CAM))
    told = _with_errors([transforms.invert(T_world_home) @ T for T in posed], random, scale, errors)
    _write_model(folder, camera.model, names, told)
    apart = [max(b, 1.0) for b in (0.0, *baselines_m)]
    turn = [float(np.degrees(errors.rotation_rad))] * 3
    sigmas = {n: [*[errors.share * b] * 3, *turn] for n, b in zip(names, apart)}
    write_priors(folder / "priors.csv", sigmas, errors.scale)
    place = np.array(posed[0][:3, 3]) + random.normal(0.0, errors.place_m, 3)
    heading = transforms.yaw(T_world_home) + random.normal(0.0, errors.yaw_rad)
    (folder / "station.yaml").write_text(
        f"place_m: [{', '.join(f'{v:.4f}' for v in place)}]\nheading_deg: {np.degrees(heading):.5f}\n"
        f"place_sigma_m: {errors.place_m}\nheading_sigma_deg: {np.degrees(errors.yaw_rad):.5f}\n"
        f"scale_sigma: {errors.scale}\n"
    )
    truth = {"T_world_cam": posed[0].tolist(), "scale": 1.0 / scale}
    (folder / TRUTH).write_text(json.dumps(truth))


def _with_errors(posed, random, scale: float, errors: SiteErrors):
    """Poses in home as the tracker says them: the reference's is home's, the others' have errors of
    their own and the flight's scale."""
    told = [posed[0]]
    for T in posed[1:]:
        arm = T[:3, 3] - posed[0][:3, 3]
        away = errors.share * float(np.linalg.norm(arm)) * random.standard_normal(3)
        turned = transforms.from_xyz_rpy(
            np.zeros(3), errors.rotation_rad * random.standard_normal(3)
        )[:3, :3]
        told.append(transforms.transform(T[:3, :3] @ turned, posed[0][:3, 3] + scale * arm + away))
    return told


def _write_model(folder: Path, camera, names, posed) -> None:
    """COLMAP's text model."""
    numbers = (camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5)
    words = " ".join(f"{v:.8g}" for v in numbers)
    (folder / "cameras.txt").write_text(f"1 PINHOLE {camera.width} {camera.height} {words}\n")
    lines = []
    for i, (name, T_home_cam) in enumerate(zip(names, posed), 1):
        T = transforms.invert(T_home_cam)
        x, y, z, w = transforms.quaternion_xyzw(T)
        numbers = (w, x, y, z, *T[:3, 3])
        lines.append(f"{i} {' '.join(f'{v:.12g}' for v in numbers)} 1 {name}\n\n")
    (folder / "images.txt").write_text("".join(lines))

# SPDX-License-Identifier: Apache-2.0
"""COLMAP's structure from motion on the bench's pictures, beside our refinement; COLMAP as a
process of its own.

Both get the same pictures and the camera's true intrinsics, which stay; ours gets priors with noise
besides, from which it has its scale. Rotations are compared relative to the reference, places after
the similarity that fits all best.

python -m bench.colmap_poses FOLDER     FOLDER/images/*.png and FOLDER/camera.json; prints poses as
JSON
"""

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional, Union

import cv2
import numpy as np

from bench.measure import relative_rotations_deg
from bench.scenes import NOISES, Scene
from fcsv_stereo.refinement import refine


@dataclass(frozen=True)
class PosesFound:
    """Rotation errors (deg) of the pictures placed, the error of their places (m, rms) with turn,
    shift and scale taken off, and the seconds that it took: on the wall, and of the processor."""

    errors_deg: List[float]
    places_rms_m: float
    placed: int
    pictures: int
    seconds: float
    cpu_seconds: float


def missing() -> Optional[str]:
    """Why COLMAP cannot be run; None where it can."""
    code = "import pycolmap; assert hasattr(pycolmap, 'incremental_mapping')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if done.returncode == 0:
        return None
    last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    return f"pycolmap cannot be imported ({last}); pip install -r tools/bench/requirements.txt"


def ours_on(scene: Scene) -> PosesFound:
    """Refinement alone, with the bench's smaller noise on the priors."""
    others = [c.others[0] for c in scene.given(scene.baselines, NOISES[0]).configurations]
    started, started_cpu = time.perf_counter(), time.process_time()
    found = refine(scene.reference, others)
    seconds, cpu_seconds = time.perf_counter() - started, time.process_time() - started_cpu
    poses = {r.picture.name: r.picture.T_home_cam for r in found.others if r.refined}
    poses[scene.reference.name] = scene.reference.T_home_cam
    return _judged(scene, poses, seconds, cpu_seconds)


def _judged(
    scene: Scene, poses: Dict[str, np.ndarray], seconds: float, cpu_seconds: float
) -> PosesFound:
    true = scene.true_poses()
    errors = relative_rotations_deg(poses, scene.reference.name, true)
    places = np.array([(poses[n][:3, 3], true[n][:3, 3]) for n in poses])
    return PosesFound(
        errors,
        similarity_rms(places[:, 0], places[:, 1]),
        len(poses),
        len(true),
        seconds,
        cpu_seconds,
    )


def similarity_rms(found: np.ndarray, true: np.ndarray) -> float:
    """Rms distance of points (N,3) after the turn, shift and scale that fit best (Umeyama 1991)."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    U, S, Vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))])
    scale = float((S * sign).sum() / max(np.square(a).sum(), 1e-12))
    return float(np.sqrt(np.square(b - scale * a @ (U @ np.diag(sign) @ Vt).T).sum(axis=1).mean()))


def colmap_on(scene: Scene) -> Union[PosesFound, str]:
    """Poses of all pictures of a scene from the pictures alone; a text that says why where it
    failed."""
    pictures = [scene.reference, *scene.others]
    names = {f"{i:02d}.png": p.name for i, p in enumerate(pictures)}
    with tempfile.TemporaryDirectory() as folder:
        images = Path(folder) / "images"
        images.mkdir()
        for file, picture in zip(names, pictures):
            cv2.imwrite(str(images / file), cv2.cvtColor(picture.image, cv2.COLOR_RGB2BGR))
        c = scene.reference.camera
        (Path(folder) / "camera.json").write_text(json.dumps([c.fx, c.fy, c.cx + 0.5, c.cy + 0.5]))
        done = subprocess.run(
            [sys.executable, "-m", "bench.colmap_poses", folder], capture_output=True, text=True
        )
    if done.returncode != 0:
        return f"COLMAP failed: {(done.stderr.strip().splitlines() or ['no reason given'])[-1]}"
    found = json.loads(done.stdout.strip().splitlines()[-1])
    poses = {names[n]: np.array(T) for n, T in found["poses"].items()}
    if scene.reference.name not in poses:
        return "COLMAP did not place the reference picture"
    return _judged(scene, poses, found["seconds"], found["cpu_seconds"])


def _reconstruct(folder: Path) -> Dict:
    import pycolmap

    pycolmap.logging.minloglevel = 2
    pycolmap.set_random_seed(1)
    fx, fy, cx, cy = json.loads((folder / "camera.json").read_text())
    database = folder / "database.db"
    started, started_cpu = time.perf_counter(), time.process_time()
    reader = pycolmap.ImageReaderOptions(
        camera_model="PINHOLE", camera_params=f"{fx},{fy},{cx},{cy}"
    )
    pycolmap.extract_features(
        database, folder / "images", camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader
    )
    pycolmap.match_exhaustive(database)
    options = pycolmap.IncrementalPipelineOptions()
    for name in ("ba_refine_focal_length", "ba_refine_principal_point", "ba_refine_extra_params"):
        setattr(options, name, False)
    # a few metres of baseline before hundreds of distance: COLMAP's own bounds (16 and 1.5 degrees)
    # find no first pair
    options.mapper.init_min_tri_angle, options.mapper.init_min_num_inliers = 1.0, 50
    options.mapper.filter_min_tri_angle = options.triangulation.min_angle = 0.2
    maps = pycolmap.incremental_mapping(database, folder / "images", folder, options)
    if not maps:
        raise SystemExit("no model came out")
    best = max(maps.values(), key=lambda m: m.num_reg_images())
    poses = {}
    for image in best.images.values():
        if image.has_pose:
            T_cam_world = np.vstack([image.cam_from_world().matrix(), [0.0, 0.0, 0.0, 1.0]])
            poses[image.name] = np.linalg.inv(T_cam_world).tolist()
    seconds, cpu_seconds = time.perf_counter() - started, time.process_time() - started_cpu
    return {"seconds": seconds, "cpu_seconds": cpu_seconds, "poses": poses}


if __name__ == "__main__":
    print(json.dumps(_reconstruct(Path(sys.argv[1]))))

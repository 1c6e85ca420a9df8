# SPDX-License-Identifier: Apache-2.0
"""COLMAP's structure from motion on the bench's pictures, for comparison; runs as a process of its own.

python -m bench.colmap_poses FOLDER     FOLDER/images/*.png and FOLDER/camera.json; prints poses as JSON
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
from bench.scenes import Scene


@dataclass(frozen=True)
class ColmapResult:
    """Rotation errors (deg) of the pictures that it placed, and the seconds that it took."""

    errors_deg: List[float]
    placed: int
    pictures: int
    seconds: float


def missing() -> Optional[str]:
    """Why COLMAP cannot be run; None where it can."""
    code = "import pycolmap; assert hasattr(pycolmap, 'incremental_mapping')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    if done.returncode == 0:
        return None
    last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    return f"pycolmap cannot be imported ({last}); pip install -r tools/bench/requirements.txt"


def colmap_on(scene: Scene) -> Union[ColmapResult, str]:
    """Poses of all pictures of a scene from the pictures alone; a text that says why where it failed."""
    pictures = [scene.reference, *scene.others]
    names = {f"{i:02d}.png": p.name for i, p in enumerate(pictures)}
    with tempfile.TemporaryDirectory() as folder:
        images = Path(folder) / "images"
        images.mkdir()
        for file, picture in zip(names, pictures):
            cv2.imwrite(str(images / file), cv2.cvtColor(picture.image, cv2.COLOR_RGB2BGR))
        c = scene.reference.camera
        (Path(folder) / "camera.json").write_text(json.dumps([c.fx, c.fy, c.cx + 0.5, c.cy + 0.5]))
        done = subprocess.run([sys.executable, "-m", "bench.colmap_poses", folder], capture_output=True, text=True)
    if done.returncode != 0:
        return f"COLMAP failed: {(done.stderr.strip().splitlines() or ['no reason given'])[-1]}"
    found = json.loads(done.stdout.strip().splitlines()[-1])
    poses = {names[n]: np.array(T) for n, T in found["poses"].items()}
    if scene.reference.name not in poses:
        return "COLMAP did not place the reference picture"
    errors = relative_rotations_deg(poses, scene.reference.name, scene.true_poses())
    return ColmapResult(errors, len(poses), len(pictures), found["seconds"])


def _reconstruct(folder: Path) -> Dict:
    import pycolmap

    pycolmap.logging.minloglevel = 2
    fx, fy, cx, cy = json.loads((folder / "camera.json").read_text())
    database = folder / "database.db"
    started = time.perf_counter()
    reader = pycolmap.ImageReaderOptions(camera_model="PINHOLE", camera_params=f"{fx},{fy},{cx},{cy}")
    pycolmap.extract_features(
        database, folder / "images", camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader
    )
    pycolmap.match_exhaustive(database)
    options = pycolmap.IncrementalPipelineOptions()
    for name in ("ba_refine_focal_length", "ba_refine_principal_point", "ba_refine_extra_params"):
        setattr(options, name, False)
    # a few metres of baseline before hundreds of distance: COLMAP's own bounds (16 and 1.5 degrees) find no first pair
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
    return {"seconds": time.perf_counter() - started, "poses": poses}


if __name__ == "__main__":
    print(json.dumps(_reconstruct(Path(sys.argv[1]))))

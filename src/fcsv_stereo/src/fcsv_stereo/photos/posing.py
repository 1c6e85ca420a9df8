# SPDX-License-Identifier: Apache-2.0
"""Poses from the photographs alone, by COLMAP (pycolmap), which is optional."""

import tempfile
from pathlib import Path
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import InputError
from fcsv_stereo.posed.colmap_images import PosedImage

INSTALL = "pip install pycolmap"
# photographs up to which every pair is compared; above, those that follow each other by name
_EXHAUSTIVE = 60
_MODEL = "RADIAL"
# of the longer side: a focal length to begin with where the file says none (as COLMAP has it)
_FACTOR = 1.2

#: (width, height, focal length in px or None): photographs that are alike here are of one camera
CameraKey = Tuple[int, int, Optional[float], str]


def require_pycolmap():
    """The module. Raises InputError, with the command that installs it, where it is not there."""
    try:
        import pycolmap
    except ImportError as error:
        raise InputError(
            f"poses are found by COLMAP, and pycolmap is not installed: {INSTALL}; or pose the photographs with COLMAP "
            "yourself, and give the folder of its model with --model"
        ) from error
    return pycolmap


def pose(
    images: Path, cameras: Dict[CameraKey, List[str]]
) -> Tuple[Dict[int, PinholeCamera], List[PosedImage]]:
    """Cameras and poses (of a scale and world of its own) of the largest model; names in
    ``cameras`` by camera.

    Raises InputError where no model with three photographs came out.
    """
    pycolmap = require_pycolmap()
    pycolmap.logging.minloglevel = 2
    pycolmap.set_random_seed(1)
    names = [n for group in cameras.values() for n in group]
    with tempfile.TemporaryDirectory() as folder:
        database = Path(folder) / "database.db"
        for (width, height, focal_px, _), group in cameras.items():
            f = focal_px or _FACTOR * max(width, height)
            reader = pycolmap.ImageReaderOptions(
                camera_model=_MODEL, camera_params=f"{f},{width / 2},{height / 2},0,0"
            )
            pycolmap.extract_features(
                database,
                images,
                group,
                camera_mode=pycolmap.CameraMode.SINGLE,
                reader_options=reader,
                device=pycolmap.Device.cpu,
            )
        match = (
            pycolmap.match_exhaustive if len(names) <= _EXHAUSTIVE else pycolmap.match_sequential
        )
        match(database, device=pycolmap.Device.cpu)
        for near in (False, True):
            maps = pycolmap.incremental_mapping(
                database, images, Path(folder), _options(pycolmap, near)
            )
            best = max(maps.values(), key=lambda m: m.num_reg_images(), default=None)
            if best is not None and best.num_reg_images() >= 3:
                return _taken(best)
    raise InputError(
        "COLMAP found no model of three photographs: they overlap too little, or were taken from places too near each "
        "other for what they show"
    )


def _options(pycolmap, near: bool):
    """``near``: a short baseline before a far scene, for which COLMAP's own bounds (16, 1.5
    degrees) are too wide."""
    options = pycolmap.IncrementalPipelineOptions()
    if near:
        options.mapper.init_min_tri_angle, options.mapper.init_min_num_inliers = 1.0, 50
        options.mapper.filter_min_tri_angle = options.triangulation.min_angle = 0.2
    return options


def _taken(model) -> Tuple[Dict[int, PinholeCamera], List[PosedImage]]:
    cameras = {}
    for number, c in model.cameras.items():
        f, cx, cy, k1, k2 = map(float, c.params)
        cameras[number] = PinholeCamera(
            c.width, c.height, f, f, cx - 0.5, cy - 0.5, (k1, k2, 0.0, 0.0, 0.0)
        )
    posed = []
    for image in model.images.values():
        if image.has_pose:
            T_cam_model = np.vstack([image.cam_from_world().matrix(), [0.0, 0.0, 0.0, 1.0]])
            posed.append(PosedImage(image.name, image.camera_id, transforms.invert(T_cam_model)))
    return cameras, sorted(posed, key=lambda p: p.name)

# SPDX-License-Identifier: Apache-2.0
"""Undistorted pictures, refined poses and points as COLMAP's text model; what colmap.py reads."""

from dataclasses import replace
from pathlib import Path
from typing import Dict, List

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Cloud, MapInput, MapResult, Picture
from fcsv_stereo.posed.local_origin import moved
from fcsv_stereo.products.pictures import file_names, refined_pictures

_MOST_POINTS = 200000  # as text; map.ply has them all


def write_colmap(result: MapResult, given: MapInput, cloud: Cloud, folder: Path) -> None:
    """cameras.txt, images.txt, points3D.txt, images/; the world is home, the reference picture
    comes first.

    COLMAP has pixel centres at 0.5: its cx and cy are ours plus 0.5. Points carry no tracks and so
    no error (-1).
    """
    pictures = {
        name: replace(p, T_home_cam=moved(p.T_home_cam, result.origin_m))
        for name, p in refined_pictures(result, given).items()
    }
    files = file_names(list(pictures))
    (folder / "images").mkdir(parents=True)
    for name, picture in pictures.items():
        path = folder / "images" / files[name]
        if not cv2.imwrite(str(path), cv2.cvtColor(picture.image, cv2.COLOR_RGB2BGR)):
            raise OSError(f"{path.name} was refused")
    cameras: List[PinholeCamera] = []
    for picture in pictures.values():
        if picture.camera not in cameras:
            cameras.append(picture.camera)
    (folder / "cameras.txt").write_text(
        "\n".join([_CAMERAS, *map(_camera, range(1, len(cameras) + 1), cameras), ""])
    )
    (folder / "images.txt").write_text(_images(pictures, files, cameras))
    (folder / "points3D.txt").write_text(_points(cloud, result.origin_m))


_CAMERAS = "# CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy (pixel centres at 0.5)"
_IMAGES = (
    "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME (T_cam_home, m), then a line of 2D points: none"
)
_POINTS = "# POINT3D_ID X Y Z (home, m) R G B ERROR (-1: none) TRACK (none)"


def _camera(number: int, c: PinholeCamera) -> str:
    return f"{number} PINHOLE {c.width} {c.height} {c.fx!r} {c.fy!r} {c.cx + 0.5!r} {c.cy + 0.5!r}"


def _images(
    pictures: Dict[str, Picture], files: Dict[str, str], cameras: List[PinholeCamera]
) -> str:
    lines = [_IMAGES]
    for number, (name, picture) in enumerate(pictures.items(), 1):
        T_cam_home = transforms.invert(picture.T_home_cam)
        x, y, z, w = transforms.quaternion_xyzw(T_cam_home)
        pose = " ".join(repr(float(v)) for v in (w, x, y, z, *T_cam_home[:3, 3]))
        lines += [f"{number} {pose} {cameras.index(picture.camera) + 1} {files[name]}", ""]
    return "\n".join(lines) + "\n"


def _points(cloud: Cloud, origin_m: np.ndarray) -> str:
    index = np.arange(len(cloud))
    if len(cloud) > _MOST_POINTS:
        index = np.sort(np.random.default_rng(0).choice(len(cloud), _MOST_POINTS, replace=False))
    places = cloud.points_home_m[index].astype(float) + origin_m
    rows = (
        f"{n} {x:.4f} {y:.4f} {z:.4f} {r} {g} {b} -1"
        for n, (x, y, z), (r, g, b) in zip(range(1, len(index) + 1), places, cloud.colors[index])
    )
    return "\n".join([_POINTS, *rows, ""])

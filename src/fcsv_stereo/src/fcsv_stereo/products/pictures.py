# SPDX-License-Identifier: Apache-2.0
"""The pictures that a map rests on, with the poses and the focal length that it ended with."""

import re
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Dict, List

from fcsv_stereo.errors import OutputError
from fcsv_stereo.model import MapInput, MapResult, Picture

_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}


def refined_pictures(result: MapResult, given: MapInput) -> Dict[str, Picture]:
    """Gives pictures by name, the reference first. Raises OutputError where the input lacks a
    picture of the map."""
    known = {p.name: p for c in given.configurations for p in (*c.references, *c.others)}
    entries = sorted(result.images, key=lambda e: e.name != result.reference.name)
    missing = [e.name for e in entries if e.name not in known]
    if missing:
        raise OutputError(
            f"picture '{missing[0]}' of the map is not among the pictures of its input"
        )
    prior_camera = known[result.reference.name].camera if result.reference.name in known else None
    pictures = {}
    for e in entries:
        p = known[e.name]
        camera = result.reference.camera if p.camera == prior_camera else p.camera
        pictures[e.name] = replace(p, T_home_cam=e.T_home_cam, camera=camera)
    return pictures


def file_names(names: List[str]) -> Dict[str, str]:
    """A plain .png name for each: no folders, no blanks, no two alike.

    >>> file_names(["uav1/12.500", "a b.jpg", "a_b.png"])
    {'uav1/12.500': 'uav1_12.500.png', 'a b.jpg': 'a_b.png', 'a_b.png': 'a_b_2.png'}
    """
    taken: Dict[str, str] = {}
    for name in names:
        stem = (
            str(PurePosixPath(name).with_suffix(""))
            if PurePosixPath(name).suffix.lower() in _SUFFIXES
            else name
        )
        stem = re.sub(r"[^\w.+-]+", "_", stem)
        file, number = f"{stem}.png", 2
        while file in taken.values():
            file, number = f"{stem}_{number}.png", number + 1
        taken[name] = file
    return taken

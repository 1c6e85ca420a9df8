# SPDX-License-Identifier: Apache-2.0
"""Posed photographs: a folder ``images/`` with COLMAP's text model; poses are priors, ``home`` is
the model's world.

``priors.csv`` may say how good they are (``priors``).
"""

from dataclasses import replace
from pathlib import Path
from typing import Optional, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.errors import InputError
from fcsv_stereo.model import (
    Configuration,
    ConfigurationInput,
    InputKind,
    MapInput,
    Picture,
    PosePrior,
)
from fcsv_stereo.photos.models import read_model
from fcsv_stereo.posed.colmap_cameras import read_cameras
from fcsv_stereo.posed.colmap_images import PosedImage, read_images, same_name
from fcsv_stereo.posed.posed_pictures import find_files, load_pictures
from fcsv_stereo.posed.priors import FILE as PRIORS
from fcsv_stereo.posed.priors import read_priors
from fcsv_stereo.posed.rig import stated_rig

__all__ = ["PosedImage", "is_model", "read_cameras", "read_images", "read_photographs"]

#: A binary model that differs from the text by more is another one: rad, and a share of the
#: cameras' distances.
_OLD_RAD, _OLD_SHARE = 1e-3, 1e-2
_ROUNDING = 1e-9  # of the largest number in two poses: what may be left of one place


def is_model(folder: Path) -> bool:
    """Whether a folder looks like posed photographs."""
    return any((folder / f).exists() for f in ("images.txt", "cameras.txt", "images"))


def read_photographs(folder: Path, reference: Optional[str] = None) -> MapInput:
    """Every other picture paired with the reference (default: the first in images.txt). Raises
    InputError.

    Pictures that cannot be read whole are left out, and the input's warnings name them.
    """
    cameras, warnings = read_cameras(folder / "cameras.txt"), []  # type: ignore[var-annotated]
    posed = read_images(folder / "images.txt", cameras, warnings)
    _require_one_model(folder, posed)
    first = posed[0] if reference is None else _named(posed, reference, folder)
    if len(posed) < 2:
        raise InputError(f"{folder / 'images.txt'}: holds {len(posed)} picture; a pair needs two")
    files = find_files(folder / "images", [p.name for p in posed])
    pictures, prior = load_pictures(files, posed, cameras, first.name, warnings), None
    if (folder / PRIORS).is_file():
        known, scale_sigma = read_priors(folder / PRIORS, [p.name for p in posed])
        prior = PosePrior(scale_sigma=scale_sigma)
        # errors of one vehicle's poses would count as one drift
        pictures = {n: replace(p, covariance=known[n], vehicle=n) for n, p in pictures.items()}
    view = pictures[first.name]
    configurations = [
        ConfigurationInput(_configuration(view, picture), [view], [picture])
        for name, picture in pictures.items()
        if name != first.name
    ]
    rig = stated_rig(folder, [p for p in posed if p.name in pictures], list(pictures.values()))
    return MapInput(InputKind.PHOTOGRAPHS, configurations, prior=prior, warnings=warnings, rig=rig)


def _named(posed: Sequence[PosedImage], name: str, folder: Path) -> PosedImage:
    """The picture of this name, or the only one in any folder whose file is named so. Raises
    InputError."""
    alike = [p for p in posed if same_name(p.name) == same_name(name)]
    alike = alike or [p for p in posed if same_name(p.name).rpartition("/")[2] == same_name(name)]
    if len(alike) != 1:
        many = f"{len(alike)} pictures are named" if alike else "no picture"
        raise InputError(f"{folder / 'images.txt'}: {many} '{name}'; the first is {posed[0].name}")
    return alike[0]


def _require_one_model(folder: Path, posed: Sequence[PosedImage]) -> None:
    """Raises InputError where a binary model beside the text says other poses: one of them is
    old."""
    if not ((folder / "images.bin").is_file() and (folder / "cameras.bin").is_file()):
        return
    try:
        binary = {same_name(p.name): p.T_home_cam for p in read_model(folder)[1]}
    except InputError:  # it is the text that is mapped
        return
    places = np.array([p.T_home_cam[:3, 3] for p in posed])
    most = _OLD_SHARE * float(np.linalg.norm(places - places[0], axis=1).max())
    for name, T in ((p.name, p.T_home_cam) for p in posed):
        other = binary.get(same_name(name))
        moved = np.inf if other is None else np.linalg.norm(other[:3, 3] - T[:3, 3])
        if other is None or moved > most or transforms.rotation_angle(other, T) > _OLD_RAD:
            words = f"lacks {name} of" if other is None else f"has another pose of {name} than"
            raise InputError(
                f"{folder / 'images.bin'}: {words} images.txt; one of the two is old: take it away"
            )


def _configuration(reference: Picture, other: Picture) -> Configuration:
    """Raises InputError where the two cannot be a pair."""
    if (reference.camera.width, reference.camera.height) != (
        other.camera.width,
        other.camera.height,
    ):
        raise InputError(
            f"{other.name} and {reference.name} have two sizes; one reference needs pictures of one size"
        )
    configuration = Configuration.between(reference.T_home_cam, other.T_home_cam)
    places = np.stack([p.T_home_cam[:3, 3] for p in (reference, other)])
    if configuration.baseline_m <= _ROUNDING * float(np.abs(places).max()):
        raise InputError(
            f"{other.name} and {reference.name} were taken from one place: no baseline"
        )
    return replace(configuration, name=f"{reference.name} with {other.name}")

# SPDX-License-Identifier: Apache-2.0
"""GPS-tagged photographs as a folder that ``map`` reads: the story from files to metres."""

import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Optional

import numpy as np

from fcsv_geometry.writing import require_folder
from fcsv_stereo import priors
from fcsv_stereo.colmap import PosedImage
from fcsv_stereo.errors import InputError, OutputError
from fcsv_stereo.photos import pictures
from fcsv_stereo.photos.earth import east_north_up_m
from fcsv_stereo.photos.models import read_model, write_model
from fcsv_stereo.photos.posing import CameraKey, pose, require_pycolmap
from fcsv_stereo.photos.similarity import Similarity, fit
from fcsv_stereo.photos.tags import Gps, Tags

#: How good structure from motion is, apart from its scale (one standard deviation). Measured: docs/photographs.md.
ROTATION_SIGMA_DEG, POSITION_SHARE = 0.1, 0.003


@dataclass(frozen=True)
class ImportOptions:
    """``model``: a folder with COLMAP's model of these photographs; without it pycolmap makes one. ``longest_px``: the
    copies' longer side, 0 as it is (with ``model`` always: the model is of these pixels)."""

    model: Optional[Path] = None
    longest_px: int = 2000

    def __post_init__(self):
        if self.longest_px and self.longest_px < 200:
            raise InputError(f"pictures of {self.longest_px} px show too little: give 200 or more, or 0")


@dataclass(frozen=True)
class Imported:
    """What was written, and how it lies to GPS; ``names`` are those with a pose, ``tagged`` those that had GPS too."""

    names: List[str]
    tagged: List[str]
    similarity: Similarity
    origin: Gps
    left_out: Dict[str, str] = field(default_factory=dict)


def import_photos(photographs: Path, out: Path, options: Optional[ImportOptions] = None) -> Imported:
    """``out`` with images/, cameras.txt, images.txt, priors.csv; home is east, north, up of the first photograph that
    has GPS. Nothing is left where it fails.

    Raises InputError for what is wrong with the photographs, OutputError where ``out`` is not empty.
    """
    options = options or ImportOptions()
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise OutputError(f"{out}: is not empty; name a new folder")
    tags = {t.path.name: t for t in pictures.find(photographs)}
    _require_gps(photographs, tags)
    if options.model is None:
        require_pycolmap()
    require_folder(out)
    parent = out.absolute().parent
    parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=parent) as work:
        made = Path(work) / "made"
        (made / "images").mkdir(parents=True)
        cameras, posed = _posed(tags, made / "images", options)
        similarity, tagged, origin = _placed(tags, posed, upright=options.model is None)
        at_home = [PosedImage(p.name, p.camera_id, similarity.pose(p.T_home_cam)) for p in posed]
        write_model(made, cameras, at_home)
        (made / priors.FILE).write_text(_priors(at_home, similarity))
        names = [p.name for p in at_home]
        left_out = _left_out(tags, names, made / "images")
        if out.exists():
            out.rmdir()
        shutil.move(str(made), str(out))
    return Imported(names, tagged, similarity, origin, left_out)


def _require_gps(folder: Path, tags: Dict[str, Tags]) -> None:
    with_gps = sum(t.gps is not None for t in tags.values())
    if with_gps < 3:
        raise InputError(
            f"{folder}: {with_gps} of {len(tags)} photographs have a GPS position (latitude, longitude and height in "
            "EXIF); scale and turn need three"
        )


def _posed(tags: Dict[str, Tags], images: Path, options: ImportOptions):
    """Cameras and poses in the model's own world and scale; the pictures that they are of stand in ``images``."""
    if options.model is not None:
        cameras, posed = read_model(options.model)
        lacking = [p.name for p in posed if p.name not in tags]
        if lacking:
            raise InputError(f"{options.model}: has a pose of {lacking[0]}, which is not among the photographs")
        for p in posed:
            shutil.copyfile(tags[p.name].path, images / p.name)
        return cameras, posed
    groups: Dict[CameraKey, List[str]] = {}
    for name, t in tags.items():
        pictures.copy_upright(t, images, options.longest_px)
        width, height = pictures.upright_size(t, options.longest_px)
        groups.setdefault((width, height, pictures.focal_px(t, options.longest_px), t.camera), []).append(name)
    return pose(images, groups)


def _placed(tags: Dict[str, Tags], posed: List[PosedImage], upright: bool):
    """The similarity, the names of the photographs that it is from, and where home is."""
    known = [p for p in posed if tags[p.name].gps is not None]
    if not known:
        raise InputError("none of the photographs with a pose has a GPS position")
    places = [tags[p.name].gps for p in known]
    origin = places[0]
    sigmas_m = np.array([[g.sigma_m, g.sigma_m, g.height_sigma_m] for g in places])
    turns = [np.eye(3) if upright else pictures.R_stored_upright(tags[p.name]) for p in known]
    R_model_cam = np.array([p.T_home_cam[:3, :3] @ R for p, R in zip(known, turns)])
    p_model = np.array([p.T_home_cam[:3, 3] for p in known])
    gimbals = [tags[p.name].R_enu_cam for p in known]
    found = fit(p_model, east_north_up_m(places, origin), sigmas_m, R_model_cam, gimbals)
    return found, [p.name for p in known], origin


def _priors(posed: List[PosedImage], similarity: Similarity) -> str:
    """priors.csv: of each position a share of the distance from the first photograph, and the scale that all share."""
    lines = [",".join([*priors.COLUMNS, priors.SCALE])]
    places = np.array([p.T_home_cam[:3, 3] for p in posed])
    nearest_m = min(np.linalg.norm(places[1:] - places[0], axis=1), default=1.0)
    for p, place in zip(posed, places):
        sigma_m = POSITION_SHARE * max(float(np.linalg.norm(place - places[0])), float(nearest_m))
        sigmas = [*[f"{sigma_m:.6g}"] * 3, *[f"{ROTATION_SIGMA_DEG:g}"] * 3, f"{similarity.scale_sigma:.6g}"]
        lines.append(",".join([p.name, *sigmas]))
    return "\n".join(lines) + "\n"


def _left_out(tags: Dict[str, Tags], names: List[str], images: Path) -> Dict[str, str]:
    """Photographs without a pose: ``map`` refuses a folder that holds them."""
    found = {}
    for name in tags:
        if name not in names:
            (images / name).unlink(missing_ok=True)
            found[name] = "no pose: it shares too little with the others"
    return found

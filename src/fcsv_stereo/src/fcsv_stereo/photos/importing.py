# SPDX-License-Identifier: Apache-2.0
"""GPS-tagged photographs as a folder that ``map`` reads: the story from files to metres."""

import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Set, Tuple

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.programs.writing import require_folder
from fcsv_stereo.errors import InputError
from fcsv_stereo.map_files.staging import StagedFolder, check_new
from fcsv_stereo.photos import pictures
from fcsv_stereo.photos.finding import by_model, find_photographs
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.photos.models import Model, read_model, write_model
from fcsv_stereo.photos.placing import Photograph, place
from fcsv_stereo.photos.posing import CameraKey, pose, require_pycolmap
from fcsv_stereo.photos.similarity import FEWEST, SAME_COST, Similarity
from fcsv_stereo.photos.tags import Tags, read_tags
from fcsv_stereo.posed import priors
from fcsv_stereo.posed.colmap_images import PosedImage

#: How good structure from motion is, apart from its scale (one standard deviation). Measured:
#: docs/lab/photographs.md.
ROTATION_SIGMA_DEG, POSITION_SHARE = 0.1, 0.003


@dataclass(frozen=True)
class ImportOptions:
    """``model``: a folder with COLMAP's model of these photographs; without it pycolmap makes one.
    ``longest_px``: the copies' longer side, 0 as it is (with ``model`` always: the model is of
    these pixels)."""

    model: Optional[Path] = None
    longest_px: int = 2000

    def __post_init__(self):
        if self.longest_px and self.longest_px < 200:
            raise InputError(
                f"pictures of {self.longest_px} px show too little: give 200 or more, or 0"
            )


@dataclass(frozen=True)
class Imported:
    """What was written, and how it lies to GPS.

    ``names``: those with a pose, in the order of the similarity's arrays. ``remarks``: what of
    these was not used, and why. ``left_out``: why other photographs have no pose.
    """

    names: List[str]
    similarity: Similarity
    origin: Gps
    remarks: Dict[str, str] = field(default_factory=dict)
    left_out: Dict[str, str] = field(default_factory=dict)


def import_photos(
    photographs: Path, out: Path, options: Optional[ImportOptions] = None
) -> Imported:
    """``out`` with images/, cameras.txt, images.txt, priors.csv; home is east, north, up of the
    first photograph whose GPS agrees with the others'. Nothing is left where it fails.

    Raises InputError for what is wrong with the photographs, OutputError where ``out`` is not
    empty.
    """
    options = options or ImportOptions()
    check_new(out)
    files, unreadable = _read(find_photographs(photographs))
    _require_gps(photographs, files)
    if options.model is None:
        require_pycolmap()
        model, tags = None, files
    else:
        model = read_model(options.model)
        tags = _of_model(photographs, files, unreadable, model)
    require_folder(out)
    with StagedFolder(out) as staged:
        made = staged.folder
        (made / "images").mkdir()
        cameras, posed = (
            _posed(tags, made / "images", options)
            if model is None
            else _copied(tags, made / "images", model)
        )
        placed, turned = (
            _placed(tags, cameras, posed)
            if model
            else (place(_upright(tags, posed, set(tags))), [])
        )
        for name in turned:
            _turn(tags[name], made / "images" / name)
        at_home = [
            PosedImage(p.name, p.camera_id, placed.similarity.pose(p.T_home_cam)) for p in posed
        ]
        write_model(made, cameras, at_home)
        priors.write_priors(made / priors.FILE, _sigmas(at_home), placed.similarity.scale_sigma)
        names = [p.name for p in at_home]
        left_out = {**unreadable, **_left_out(tags, files, names, made / "images")}
    return Imported(names, placed.similarity, placed.origin, placed.remarks, left_out)


def _read(paths: Dict[str, Path]) -> Tuple[Dict[str, Tags], Dict[str, str]]:
    """Tags by name; and of files that are no pictures, why."""
    tags: Dict[str, Tags] = {}
    unreadable: Dict[str, str] = {}
    for name, path in paths.items():
        try:
            tags[name] = read_tags(path)
        except InputError as error:
            unreadable[name] = str(error).split(": ", 1)[-1]
    return tags, unreadable


def _of_model(
    folder: Path, files: Dict[str, Tags], unreadable: Dict[str, str], model: Model
) -> Dict[str, Tags]:
    """Tags by the model's names. Raises InputError where it needs a photograph that cannot be read,
    or is not there."""
    keys = by_model(folder, [*files, *unreadable], [p.name for p in model[1]])
    for key in keys.values():
        if key in unreadable:
            raise InputError(f"{folder / key}: {unreadable[key]}")
    return {name: files[key] for name, key in keys.items()}


def _require_gps(folder: Path, tags: Dict[str, Tags]) -> None:
    without = {name: t.no_gps for name, t in tags.items() if t.gps is None}
    if len(tags) - len(without) < FEWEST:
        why = "".join(f"; {name}: {no_gps}" for name, no_gps in list(without.items())[:3])
        raise InputError(
            f"{folder}: {len(tags) - len(without)} of {len(tags)} photographs have a GPS position (latitude, longitude "
            f"and height); scale and turn need {FEWEST}{why}"
        )


def _copied(tags: Dict[str, Tags], images: Path, model: Model) -> Model:
    """The model as it is, with the photographs that it is of."""
    for p in model[1]:
        (images / p.name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(tags[p.name].path, images / p.name)
    return model


def _posed(tags: Dict[str, Tags], images: Path, options: ImportOptions) -> Model:
    """Cameras and poses in the model's own world and scale, by COLMAP, of upright copies."""
    groups: Dict[CameraKey, List[str]] = {}
    for name, t in tags.items():
        (images / name).parent.mkdir(parents=True, exist_ok=True)
        pictures.copy_upright(t, (images / name).parent, options.longest_px)
        width, height = pictures.upright_size(t, options.longest_px)
        groups.setdefault(
            (width, height, pictures.focal_px(t, options.longest_px), t.camera), []
        ).append(name)
    return pose(images, groups)


def _placed(tags: Dict[str, Tags], cameras: Dict[int, PinholeCamera], posed: List[PosedImage]):
    """(Placed, names of photographs whose pixels are to be turned): of pictures that are as wide
    turned as stored, the model is of their stored pixels unless GPS and angles clearly agree better
    with those that are shown."""
    shown = {p.name for p in posed if _is_of_turned_pixels(p, tags[p.name], cameras[p.camera_id])}
    unclear = [
        n
        for n in tags
        if tags[n].orientation != 1 and tags[n].size == pictures.upright_size(tags[n], 0)
    ]
    if not unclear:
        return place(_upright(tags, posed, shown)), []
    try:
        turned = place(_upright(tags, posed, shown | set(unclear)))
    except InputError:
        return place(_upright(tags, posed, shown)), []
    try:
        stored = place(_upright(tags, posed, shown))
    except InputError:
        return turned, unclear
    return (
        (turned, unclear)
        if turned.similarity.cost + SAME_COST < stored.similarity.cost
        else (stored, [])
    )


def _upright(tags: Dict[str, Tags], posed: List[PosedImage], shown: Set[str]) -> List[Photograph]:
    """``shown``: those of whose shown pixels the model is; of the others it is of the stored
    ones."""
    found = []
    for p in posed:
        t, R = tags[p.name], p.T_home_cam[:3, :3]
        R_model_cam = R if p.name in shown else R @ pictures.R_stored_upright(t)
        found.append(
            Photograph(
                p.name,
                t.camera,
                p.T_home_cam[:3, 3],
                R_model_cam,
                t.gps,
                t.R_enu_cam,
                t.no_gps,
                t.no_angles,
            )
        )
    return found


def _turn(tags: Tags, target: Path) -> None:
    """The photograph's copy with its pixels as they are shown."""
    target.unlink()
    pictures.copy_upright(tags, target.parent, 0)
    (target.parent / tags.path.name).rename(target)


def _is_of_turned_pixels(p: PosedImage, tags: Tags, camera: PinholeCamera) -> bool:
    """Whether a model is of the picture as it is shown, not as it is stored, by its camera's size.

    Raises InputError where it is of neither.
    """
    size, stored, shown = (camera.width, camera.height), tags.size, pictures.upright_size(tags, 0)
    if size not in (stored, shown):
        raise InputError(
            f"{tags.path}: is {stored[0]}x{stored[1]}, and the model's camera of {p.name} {size[0]}x{size[1]}: give "
            "the photographs that the model was made of"
        )
    return size != stored


def _sigmas(posed: List[PosedImage]) -> Dict[str, Sequence[float]]:
    """Gives standard deviations for priors.csv: of each position a share of the distance from the
    first photograph."""
    places = np.array([p.T_home_cam[:3, 3] for p in posed])
    away_m = np.linalg.norm(places - places[0], axis=1)
    nearest_m = float(min(away_m[1:], default=1.0))
    sigmas_m = POSITION_SHARE * np.maximum(away_m, nearest_m)
    return {p.name: [*[s] * 3, *[ROTATION_SIGMA_DEG] * 3] for p, s in zip(posed, sigmas_m)}


def _left_out(
    tags: Dict[str, Tags], files: Dict[str, Tags], names: List[str], images: Path
) -> Dict[str, str]:
    """Photographs without a pose: ``map`` refuses a folder that holds them."""
    for name in set(tags) - set(names):
        (images / name).unlink()
    used = {tags[name].path for name in names}
    return {
        name: "no pose: it shares too little with the others"
        for name, t in files.items()
        if t.path not in used
    }

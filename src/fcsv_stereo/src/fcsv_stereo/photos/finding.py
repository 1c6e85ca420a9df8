# SPDX-License-Identifier: Apache-2.0
"""Photographs in a folder and in those beneath it, as cameras fill cards (DCIM/100MEDIA)."""

from pathlib import Path, PurePosixPath
from typing import Dict, List, Sequence

from fcsv_stereo.errors import InputError
from fcsv_stereo.photos.tags import SUFFIXES
from fcsv_stereo.posed.colmap_images import same_name

_NOT_PHOTOGRAPHS = ("__MACOSX", "@eaDir", "Thumbs")  # what computers keep beside pictures


def find_photographs(folder: Path) -> Dict[str, Path]:
    """Finds pictures by name relative to ``folder``, sorted. Raises InputError where there are
    none."""
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder of photographs")
    found = {
        p.relative_to(folder).as_posix(): p
        for p in sorted(folder.rglob("*"))
        if p.suffix.lower() in SUFFIXES
    }
    found = {name: p for name, p in found.items() if not _is_hidden(name) and p.is_file()}
    if not found:
        raise InputError(
            f"{folder}: holds no photographs ({', '.join(SUFFIXES)}), nor do the folders in it"
        )
    return found


def by_model(folder: Path, photographs: Sequence[str], names: List[str]) -> Dict[str, str]:
    """The photograph (its key) that each of a model's names means: of that name, however its
    letters are composed; else the only one of that file name in any folder. Raises InputError."""
    composed: Dict[str, List[str]] = {}
    for key in photographs:
        for name in {same_name(key), same_name(PurePosixPath(key).name)}:
            composed.setdefault(name, []).append(key)
    found: Dict[str, str] = {}
    for name in names:
        _require_inside(folder, name)
        wanted = same_name(name)
        exact = [k for k in photographs if k == name] or [
            k for k in photographs if same_name(k) == wanted
        ]
        keys = exact or composed.get(wanted) or composed.get(PurePosixPath(wanted).name, [])
        if not keys:
            raise InputError(
                f"the model has a pose of {name}, which is not among the photographs in {folder}"
            )
        if len(keys) > 1:
            raise InputError(
                f"the model has a pose of {name}, which may be {keys[0]} or {keys[1]} in {folder}"
            )
        if keys[0] in found.values():
            raise InputError(f"the model has two poses of {keys[0]} in {folder}")
        found[name] = keys[0]
    return found


def _is_hidden(name: str) -> bool:
    return any(
        part.startswith(".") or part in _NOT_PHOTOGRAPHS for part in PurePosixPath(name).parts
    )


def _require_inside(folder: Path, name: str) -> None:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts:
        raise InputError(
            f"the model has a pose of {name}, which lies outside {folder}; give names relative to it"
        )

# SPDX-License-Identifier: Apache-2.0
"""Points of a view on the disk: zarr in one file, with the key of what went into them."""

import zipfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Dict, Iterable, Optional, Tuple

import numpy as np
import zarr
from numcodecs import Zstd

from fcsv_geometry.programs.writing import whole_file
from fcsv_stereo.model import Cloud

_CHUNK = 1 << 16  # points, or all rows of a tile
_PACKED = Zstd(1)  # zarr's own packs by threads, whose blocks are in any order
_EMPTY = (((0, 3), np.float32), ((0, 3), np.uint8), (0, np.float32), (0, np.uint8))


@dataclass(frozen=True)
class ViewPoints:
    """What became of a view's points, and the file of those that the site keeps: how many there
    are, between which corners (3,) m less the site's origin, how many a surer view tells, how many
    others see through, how many two views see. ``key``: of what went into them. No file: they could
    not be joined."""

    path: Optional[Path] = None
    key: str = ""
    count: int = 0
    low_m: Tuple[float, ...] = ()
    high_m: Tuple[float, ...] = ()
    duplicates: int = 0
    seen_through: int = 0
    agreed: int = 0

    def load(self) -> Cloud:
        """The points (m, less the site's origin). Raises OSError."""
        if self.path is None:
            return Cloud(*(np.zeros(shape, kind) for shape, kind in _EMPTY))
        return Cloud(**read_arrays(self.path, [f.name for f in fields(Cloud)]))


def write_points(cloud: Cloud, counts: Dict[str, int], path: Path, key: str) -> None:
    """Points and ``counts`` of ``ViewPoints``, whole or not at all. Raises OSError."""
    told: Dict[str, Any] = {"count": len(cloud), **counts}
    if len(cloud):
        p = cloud.points_home_m.astype(float)
        told.update(low_m=p.min(axis=0).tolist(), high_m=p.max(axis=0).tolist())
    arrays = {f.name: getattr(cloud, f.name) for f in fields(Cloud)}
    write_arrays(arrays, {"key": key, "points": told}, path)


def read_points(path: Path, key: str) -> Optional[ViewPoints]:
    """What ``write_points`` left; None where it is of another key, or not whole."""
    told = kept_attributes(path, key)
    return None if told is None else ViewPoints(path, key, **told["points"])


def write_arrays(arrays: Dict[str, np.ndarray], attributes: Dict[str, Any], path: Path) -> None:
    """Arrays and what is told of them as zarr in one file, whole or not at all. Raises OSError."""
    with whole_file(path) as partial, zarr.ZipStore(str(partial), mode="w") as store:
        group = zarr.group(store)
        for name, values in arrays.items():
            rows = min(_CHUNK, max(len(values), 1))  # zarr fills a chunk up
            group.array(name, values, chunks=(rows, *values.shape[1:]), compressor=_PACKED)
        group.attrs.put(attributes)


def read_arrays(path: Path, names: Iterable[str]) -> Dict[str, np.ndarray]:
    """Arrays by name out of what ``write_arrays`` wrote. Raises OSError."""
    with zarr.ZipStore(str(path), mode="r") as store:
        group = zarr.open_group(store, mode="r")
        return {name: group[name][:] for name in names}


def kept_attributes(path: Path, key: str) -> Optional[Dict[str, Any]]:
    """What ``write_arrays`` was told, its ``key`` among it; None where it is of another key, or not
    whole."""
    try:
        with zarr.ZipStore(str(path), mode="r") as store:
            told = dict(zarr.open_group(store, mode="r").attrs)
            return told if told["key"] == key and store.zf.testzip() is None else None
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, zipfile.BadZipFile):
        return None

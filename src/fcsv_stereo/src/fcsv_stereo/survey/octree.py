# SPDX-License-Identifier: Apache-2.0
"""The cloud as COPC: a LAZ file whose points lie in an octree, the coarse ones first, so that
viewers load what they show (copclib).

copclib names no extra dimensions: intensity holds sigma (mm, at most 65.5 m), user data the number
of views. The same in full is in the plain LAZ.
"""

from pathlib import Path
from typing import Iterator, Tuple

import numpy as np

from fcsv_stereo.model import Cloud

_STEP_M = 0.001
_CELLS = 128  # along a node's side: of each cell its first point is the node's
_MOST_LEFT, _DEEPEST = 20_000, 9
_MM, _MOST_16 = 1000.0, 65535

Key = Tuple[int, int, int, int]


def levels(points: np.ndarray, low: np.ndarray, side_m: float) -> Iterator[Tuple[Key, np.ndarray]]:
    """Nodes (level, x, y, z) with the indices of their points, of points (N,3) in the cube from
    ``low`` (3,) m; every point is in one node, and each node's points are thinned evenly."""
    order = np.random.default_rng(0).permutation(len(points))
    for level in range(_DEEPEST + 1):
        if not len(order):
            return
        node_m = side_m / 2**level
        at = points[order] - low
        if level == _DEEPEST or len(order) <= _MOST_LEFT:
            chosen = np.arange(len(order))
        else:
            cells = np.floor(at / (node_m / _CELLS)).astype(np.int64)
            chosen = np.sort(np.unique(cells, axis=0, return_index=True)[1])
        nodes = np.clip(np.floor(at[chosen] / node_m).astype(np.int64), 0, 2**level - 1)
        keys, which = np.unique(nodes, axis=0, return_inverse=True)
        by_node = np.argsort(which.ravel(), kind="stable")
        ends = np.cumsum(np.bincount(which.ravel(), minlength=len(keys)))
        for key, of in zip(keys, np.split(by_node, ends[:-1])):
            yield (level, *map(int, key)), np.sort(order[chosen[of]])
        order = np.delete(order, chosen)


def write_copc(cloud: Cloud, path: Path, origin_m: np.ndarray, crs: str = "") -> None:
    """LAZ 1.4 (point format 7) with COPC's octree; ``crs`` as of ``write_laz``."""
    import copclib

    points = cloud.points_home_m.astype(float) + origin_m
    low, high = points.min(axis=0), points.max(axis=0)
    offset = np.floor(low)
    side_m = float((high - low).max()) + 10 * _STEP_M
    config = copclib.CopcConfigWriter(
        7, copclib.Vector3(*[_STEP_M] * 3), copclib.Vector3(*offset), _wkt(crs)
    )
    info, header = config.copc_info, config.las_header
    info.center_x, info.center_y, info.center_z = low + side_m / 2.0
    info.halfsize, info.spacing = side_m / 2.0, side_m / _CELLS
    header.min, header.max = copclib.Vector3(*low), copclib.Vector3(*high)
    records = _records(cloud, points, offset)
    writer = copclib.FileWriter(str(path), config)
    for key, of in levels(points, low, side_m):
        data = np.frombuffer(records[of].tobytes(), np.int8)
        writer.AddNode(copclib.VoxelKey(*key), copclib.VectorChar(data))
    writer.Close()


def _wkt(crs: str) -> str:
    if not crs:
        return ""
    from pyproj import CRS

    return str(CRS.from_user_input(crs).to_wkt())


def _records(cloud: Cloud, points: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """(N,) records of point format 7."""
    import laspy

    las = laspy.ScaleAwarePointRecord.zeros(len(cloud), header=_header(offset))
    las.x, las.y, las.z = points.T
    las.red, las.green, las.blue = cloud.colors.T.astype(np.uint16) * 257
    las.intensity = np.minimum(np.rint(cloud.sigma_m * _MM), _MOST_16).astype(np.uint16)
    las.user_data = cloud.baseline_index
    las.return_number[:] = 1
    las.number_of_returns[:] = 1
    return np.asarray(las.array)


def _header(offset: np.ndarray):
    import laspy

    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = np.full(3, _STEP_M), offset
    return header

# SPDX-License-Identifier: Apache-2.0
"""The cloud as COPC: a LAZ file whose points lie in an octree, the coarse ones first, so that
viewers load what they show (copclib).

copclib names no extra dimensions: intensity holds sigma (mm, at most 65.5 m), user data the number
of views. The same in full is in the plain LAZ.
"""

import ctypes
from pathlib import Path
from typing import Callable, Dict, Iterable, Iterator, List, Tuple

import numpy as np

from fcsv_stereo.model import Cloud, concatenate

_STEP_M = 0.001
_CELLS = 128  # along a node's side: of each cell its first point is the node's
_MOST_LEFT, _DEEPEST = 20_000, 9
_MOST_AT_ONCE = 1 << 20  # points in memory: 200 MB
_CUBES = _CELLS  # at most along the side: those that are made by themselves
_MM, _MOST_16 = 1000.0, 65535
#: Makes one number of a row (x, y, z), which sorts as rows do; numpy takes ten times as long for rows.
_IN_ONE = np.array([1 << 40, 1 << 20, 1])

Key = Tuple[int, int, int, int]


def levels(
    points: np.ndarray, low: np.ndarray, side_m: float, least: int = 0
) -> Iterator[Tuple[Key, np.ndarray]]:
    """Nodes (level, x, y, z) with the indices of their points, of points (N,3) in the cube from
    ``low`` (3,) m; every point is in one node, and each node's points are thinned evenly. Few points
    are one node from the level ``least`` on."""
    order = np.random.default_rng(0).permutation(len(points))
    for level in range(_DEEPEST + 1):
        if not len(order):
            return
        node_m = side_m / 2**level
        at = points[order] - low
        if level == _DEEPEST or (level >= least and len(order) <= _MOST_LEFT):
            chosen = np.arange(len(order))
        else:
            cells = np.floor(at / (node_m / _CELLS)).astype(np.int64)
            chosen = np.sort(np.unique(cells @ _IN_ONE, return_index=True)[1])
        nodes = np.clip(np.floor(at[chosen] / node_m).astype(np.int64), 0, 2**level - 1)
        _, first, which = np.unique(nodes @ _IN_ONE, return_index=True, return_inverse=True)
        by_node = np.argsort(which, kind="stable")
        ends = np.cumsum(np.bincount(which, minlength=len(first)))
        for key, of in zip(nodes[first], np.split(by_node, ends[:-1])):
            yield (level, *map(int, key)), np.sort(order[chosen[of]])
        order = np.delete(order, chosen)


def write_copc(
    clouds: Callable[[], Iterable[Cloud]],
    box_m: np.ndarray,
    path: Path,
    origin_m: np.ndarray,
    crs: str = "",
) -> None:
    """LAZ 1.4 (point format 7) with COPC's octree, of clouds between the corners ``box_m`` (2,3),
    which are gone through for each of the cubes that hold not too many points to be in memory;
    ``crs`` as of ``LazFile``. Raises OSError."""
    import copclib

    low, high = box_m + origin_m
    side_m = float((high - low).max()) + 10 * _STEP_M
    config = copclib.CopcConfigWriter(
        7, copclib.Vector3(*[_STEP_M] * 3), copclib.Vector3(*np.floor(low)), _wkt(crs)
    )
    info, header = config.copc_info, config.las_header
    info.center_x, info.center_y, info.center_z = low + side_m / 2.0
    info.halfsize, info.spacing = side_m / 2.0, side_m / _CELLS
    header.min, header.max = copclib.Vector3(*low), copclib.Vector3(*high)
    writer = copclib.FileWriter(str(path), config)
    try:
        for key, records in _nodes(clouds, low, side_m, origin_m):
            data = np.frombuffer(records.tobytes(), np.int8)
            writer.AddNode(copclib.VoxelKey(*key), copclib.VectorChar(data))
        writer.Close()
    except RuntimeError as error:
        # never freed: it would try to write again, and end the process
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(writer))
        raise OSError(f"{path}: {error}; is the disk full?") from error


def _nodes(
    clouds: Callable[[], Iterable[Cloud]], low: np.ndarray, side_m: float, origin_m: np.ndarray
) -> Iterator[Tuple[Key, np.ndarray]]:
    """Each node once, and its records."""

    def cubes(cloud: Cloud) -> np.ndarray:
        at = cloud.points_home_m.astype(float) + origin_m - low
        return np.clip(np.floor(at / (side_m / _CUBES)).astype(int), 0, _CUBES - 1)

    depth, held = _cubes_at_once(map(cubes, clouds()))
    coarse: Dict[Key, List[np.ndarray]] = {}  # nodes that several of the cubes have points of
    for cube in held:
        parts = (c[(cubes(c) // (_CUBES >> depth) == cube).all(axis=1)] for c in clouds())
        cloud = concatenate(list(parts))
        points = cloud.points_home_m.astype(float) + origin_m
        records = _records(cloud, points, np.floor(low))
        for key, of in levels(points, low, side_m, depth):
            if key[0] < depth:
                coarse.setdefault(key, []).append(records[of])
            else:
                yield key, records[of]
    for key in sorted(coarse):
        yield key, np.concatenate(coarse[key])


def _cubes_at_once(cubes: Iterable[np.ndarray]) -> Tuple[int, np.ndarray]:
    """The level of the octree whose cubes hold not too many points each, and those (M,3) that hold
    any, by each point's cube (N,3) of the finest level that there may be."""
    counts = np.zeros(_CUBES**3, int)
    for of in cubes:
        counts += np.bincount(np.ravel_multi_index(of.T, (_CUBES,) * 3), minlength=_CUBES**3)
    for depth in range(int(np.log2(_CUBES)) + 1):
        n = 1 << depth
        by_cube = counts.reshape(n, _CUBES // n, n, _CUBES // n, n, _CUBES // n).sum(axis=(1, 3, 5))
        if by_cube.max() <= _MOST_AT_ONCE:
            break
    return depth, np.argwhere(by_cube)


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

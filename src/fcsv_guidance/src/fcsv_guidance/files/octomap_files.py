# SPDX-License-Identifier: Apache-2.0
"""Maps as an OctoMap for a vehicle in the air: free along rays, occupied at surfaces, all else
unknown.

Free ends two sigma before a surface, and needs two rays: one wrong pixel frees nothing. Of one map,
a surface in a voxel stands against rays through it; several maps are added up as log odds, with the
library's sensor model.
"""

from pathlib import Path
from typing import Iterator, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_guidance.errors import GroundError, GuidanceError
from fcsv_guidance.ground import kernels, tuning
from fcsv_guidance.ground.model import sure_depth
from fcsv_guidance.ground.views import DepthView

_MOST_VOXELS = 1 << 31
_TILE_VOXELS = 1 << 25
_SIGMAS = 2.0
_UNKNOWN, _FREE, _OCCUPIED = 0, 1, 2


def write_octomap(
    views: Sequence[DepthView], folder: Path, name: str, voxel_m: float = 0.2, reach_m: float = 60.0
) -> List[Path]:
    """NAME.bt (free, occupied, unknown) and NAME.ot (probabilities) of the views to ``reach_m``
    from their cameras; their paths.

    Raises GroundError where there is nothing to write or the voxels are too many, GuidanceError
    where the library is not installed, OSError where the disk does not take them.
    """
    octomap = _library()
    if not 0 < voxel_m < np.inf or not 0 < reach_m < np.inf:
        raise GroundError(
            f"voxels of {voxel_m} m to {reach_m} m cannot be laid; both must be above 0"
        )
    boxes = [_box_of(view, voxel_m, reach_m, alone=len(views) == 1) for view in views]
    first, shape = _whole(boxes, reach_m)
    tree = octomap.OcTree(voxel_m)
    hit, miss = tree.getProbHitLog(), tree.getProbMissLog()
    for low, size, meeting in _tiles(first, shape, boxes):
        log_odds, seen = np.zeros(size, np.float32), np.zeros(size, bool)
        for number in meeting:
            state = _seen_by(views[number], low, size, voxel_m, reach_m)
            log_odds += np.select([state == _OCCUPIED, state == _FREE], [hit, miss], 0.0)
            seen |= state != _UNKNOWN
        for value in np.unique(log_odds[seen]):
            voxels = np.argwhere(seen & (log_odds == value))
            tree.updateNodes((low + voxels + 0.5) * voxel_m, float(value), True)
    tree.updateInnerOccupancy()
    paths = [Path(folder) / f"{name}.bt", Path(folder) / f"{name}.ot"]
    # .bt forgets probabilities: last
    if not tree.write(str(paths[1])) or not tree.writeBinary(str(paths[0])):
        raise OSError(f"{paths[0].name}: cannot be written; is the disk full?")
    return paths


def _library():
    try:
        import pyoctomap
    except ImportError as error:
        raise GuidanceError(
            f"an OctoMap needs pyoctomap ({error}); install it: pip install pyoctomap"
        ) from error
    return pyoctomap


Box = Tuple[np.ndarray, np.ndarray]  # (3,) indices of the first voxel and of the last


def _box_of(view: DepthView, voxel_m: float, reach_m: float, alone: bool) -> Optional[Box]:
    """The box of what a view shows and of its camera, on whole multiples of a voxel from home; None
    where it shows nothing. Raises GroundError where it has no sure depth and is ``alone``."""
    try:
        points = _surfaces(view, reach_m)
    except GroundError:
        if alone:
            raise
        return None
    corners = np.array([points.min(0), points.max(0), view.T_home_cam[:3, 3]])
    low, high = (np.floor(f(axis=0) / voxel_m).astype(int) for f in (corners.min, corners.max))
    return low, high


def _whole(
    boxes: Sequence[Optional[Box]], reach_m: float
) -> Tuple[np.ndarray, Tuple[int, int, int]]:
    """Index of the first voxel (3,), and how many there are along x, y, z."""
    shown = [box for box in boxes if box is not None]
    if not shown:
        raise GroundError(
            f"no map shows anything within {reach_m:g} m of its camera; give a larger reach"
        )
    first = np.min([low for low, _ in shown], axis=0)
    x, y, z = (int(n) for n in np.max([high for _, high in shown], axis=0) - first + 1)
    if float(x) * y * z > _MOST_VOXELS:
        raise GroundError(f"an OctoMap of {x} x {y} x {z} voxels is too large; take larger voxels")
    return first, (x, y, z)


def _tiles(
    first: np.ndarray, shape: Tuple[int, int, int], boxes: Sequence[Optional[Box]]
) -> Iterator[Tuple[np.ndarray, Tuple[int, int, int], List[int]]]:
    """Parts of the whole box, as high as it: first voxel, size, and the views that show something
    there. What is held at a time does not grow with the site."""
    side = max(1, int(np.sqrt(_TILE_VOXELS / shape[2])))
    for x in range(0, shape[0], side):
        for y in range(0, shape[1], side):
            size = (min(side, shape[0] - x), min(side, shape[1] - y), shape[2])
            low = first + [x, y, 0]
            high = low + size
            meeting = [
                number
                for number, box in enumerate(boxes)
                if box is not None and (box[0] < high).all() and (box[1] >= low).all()
            ]
            if meeting:
                yield low, size, meeting


def _surfaces(view: DepthView, reach_m: float) -> np.ndarray:
    """(N,3) home: points on the rays of all sure pixels, at most ``reach_m`` along the optical
    axis."""
    depth = np.minimum(sure_depth(view), np.float32(reach_m))
    v, u = np.nonzero(np.isfinite(depth))
    rays = np.stack(
        [(u - view.K[0, 2]) / view.K[0, 0], (v - view.K[1, 2]) / view.K[1, 1], np.ones(len(u))], -1
    )
    return (rays * depth[v, u, None]) @ view.T_home_cam[:3, :3].T + view.T_home_cam[:3, 3]


def _seen_by(
    view: DepthView, first: np.ndarray, shape, voxel_m: float, reach_m: float
) -> np.ndarray:
    """(x, y, z) uint8 of what one view shows of each voxel."""
    # rays lie half a voxel apart at the farthest
    stride = max(1, int(0.5 * voxel_m * view.K[0, 0] / reach_m))
    depth = sure_depth(view)
    R, p = (
        np.ascontiguousarray(view.T_home_cam[:3, :3], float),
        np.ascontiguousarray(view.T_home_cam[:3, 3], float),
    )
    rays, hits = kernels.rays_through(
        depth,
        view.sigma.astype(np.float32),
        np.ascontiguousarray(view.K, float),
        R,
        p,
        voxel_m,
        reach_m,
        _SIGMAS,
        stride,
        first * voxel_m,
        shape,
    )
    return np.select([hits, rays >= tuning.LEAST_POINTS], [_OCCUPIED, _FREE], _UNKNOWN).astype(
        np.uint8
    )

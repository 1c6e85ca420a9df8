# SPDX-License-Identifier: Apache-2.0
"""What bounds and an outlier filter do to a cloud: points kept, and points wrong by more than 10 %
(or in the sky).

    PYTHONPATH=tools python -m bench.clouds             eight scenes, four horizontal pairs; --quick: two scenes

Bounds are those of ``cloud_bounds``; the filter is open3d's ``remove_statistical_outlier`` (20
neighbours, 2 standard deviations) after them, in metres and in pixels and disparity, where a cloud
is evenly dense.
"""

import argparse
import sys
from typing import Callable, Dict, List, Optional

import numpy as np

from bench.scenes import HORIZONTAL, NOISES, SCENES, shoot
from fcsv_geometry import transforms
from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.map_files.cloud_bounds import CloudBounds, bound_cloud, held_range_m
from fcsv_stereo.model import MapResult

_NEIGHBOURS, _DEVIATIONS = 20, 2.0
_HEAD = ("points of", "kept", "right ones kept", "wrong of the kept", "farthest")


def main(argv: Optional[List[str]] = None) -> int:
    """Print a table for maps as they are, and one for complete ones."""
    parser = argparse.ArgumentParser(prog="bench.clouds", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="every fourth scene")
    args = parser.parse_args(argv)
    scenes = SCENES[:: 4 if args.quick else 1]
    rows: Dict[bool, Dict[str, list]] = {False: {}, True: {}}
    for name in scenes:
        scene = shoot(name, HORIZONTAL)
        for complete, found in rows.items():
            result = Joint().map(
                scene.given(HORIZONTAL, NOISES[0]), JointOptions(complete=complete)
            )
            with np.errstate(invalid="ignore"):
                right = (np.abs(result.depth / scene.true_depth - 1.0) <= 0.1)[
                    np.isfinite(result.depth)
                ]
            for title, kept in _choices(result).items():
                found.setdefault(title, []).append(_figures(result, right, kept))
        print(f"{name}: {len(result.cloud):,} points with --complete", file=sys.stderr, flush=True)
    for complete, found in rows.items():
        print(
            f"\nMean of {len(scenes)} scenes{', --complete' if complete else ''}\n\n| {' | '.join(_HEAD)} |"
        )
        print("|" + "---|" * len(_HEAD))
        for title, each in found.items():
            kept, right, wrong, _ = np.mean(each, axis=0)
            print(
                f"| {title} | {kept:.1%} | {right:.1%} | {wrong:.2%} | {np.max(each, axis=0)[3]:.0f} m |"
            )
    return 0


def _choices(result: MapResult) -> Dict[str, np.ndarray]:
    """Which points stay (N bool), by what was done."""
    bounds = {"the map": CloudBounds(None, None), "range": CloudBounds("auto", None)}
    for percent in (30, 20, 10):
        bounds[f"sigma up to {percent} %"] = CloudBounds(
            None, ErrorThreshold(percent / 100.0, True)
        )
    bounds["range, sigma up to 20 % (default)"] = CloudBounds()
    found = {title: _within(result, b) for title, b in bounds.items()}
    default = _within(result, CloudBounds())
    for title, space in (("in metres", _metres), ("in pixels", _pixels)):
        found[f"default, outliers out ({title})"] = _without_outliers(result, default, space)
    return found


def _within(result: MapResult, bounds: CloudBounds) -> np.ndarray:
    """N bool: the cloud's points have an index in place of their pair."""
    index = np.arange(len(result.cloud))
    marked = type(result.cloud)(
        result.cloud.points_home_m, result.cloud.colors, result.cloud.sigma_m, index
    )
    kept = np.zeros(len(index), bool)
    kept[
        bound_cloud(MapResult(**{**vars(result), "cloud": marked}), bounds).cloud.baseline_index
    ] = True
    return kept


def _camera_points(result: MapResult) -> np.ndarray:
    return transforms.apply(
        transforms.invert(result.reference.T_home_cam), result.cloud.points_home_m.astype(float)
    )


_metres = _camera_points


def _pixels(result: MapResult) -> np.ndarray:
    """Pixel, and disparity on the widest pair in half pixels."""
    p = _camera_points(result)
    focal_baseline = held_range_m(result) / 0.2
    return np.column_stack([result.reference.camera.project(p), 2.0 * focal_baseline / p[:, 2]])


def _without_outliers(result: MapResult, kept: np.ndarray, space: Callable) -> np.ndarray:
    import open3d as o3d

    index = np.flatnonzero(kept)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(space(result)[index]))
    stays = np.zeros_like(kept)
    stays[index[np.asarray(cloud.remove_statistical_outlier(_NEIGHBOURS, _DEVIATIONS)[1])]] = True
    return stays


def _figures(result: MapResult, right: np.ndarray, kept: np.ndarray):
    farthest = _camera_points(result)[kept, 2].max()
    return (
        kept.mean(),
        (kept & right).sum() / right.sum(),
        (kept & ~right).sum() / kept.sum(),
        farthest,
    )


if __name__ == "__main__":
    sys.exit(main())

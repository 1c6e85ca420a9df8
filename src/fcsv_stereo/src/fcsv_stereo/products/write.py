# SPDX-License-Identifier: Apache-2.0
"""Writes the products that were asked for into one folder."""

from pathlib import Path
from typing import Callable, Dict, Optional, Sequence

from fcsv_stereo.errors import OutputError
from fcsv_stereo.model import Cloud, MapInput, MapResult
from fcsv_stereo.model.kinds import DepthKind
from fcsv_stereo.products import clouds, exchange, from_above, ground, rectified
from fcsv_stereo.products.holes import hole_shares
from fcsv_stereo.products.points import merge_duplicates


def _orthophoto(result: MapResult, cloud: Cloud, folder: Path) -> None:
    """Its holes are told in the report."""
    raster = from_above.write_from_above(cloud, folder, result.reference, result.origin_m)
    result.holes = hole_shares(raster, cloud, result.reference, result.kind == DepthKind.SKY)


_Writer = Callable[[MapResult, MapInput, Cloud, Path], None]
_WRITERS: Dict[str, _Writer] = {
    "pcd": lambda result, given, cloud, folder: clouds.write_pcd(
        cloud, folder / "map.pcd", result.origin_m
    ),
    "laz": lambda result, given, cloud, folder: clouds.write_laz(
        cloud, folder / "map.laz", result.origin_m
    ),
    "orthophoto": lambda result, given, cloud, folder: _orthophoto(result, cloud, folder),
    "colmap": lambda result, given, cloud, folder: exchange.write_colmap(
        result, given, cloud, folder / "colmap"
    ),
    "pairs": lambda result, given, cloud, folder: rectified.write_pairs(
        result, given, folder / "pairs"
    ),
}


def write_products(
    names: Sequence[str],
    result: MapResult,
    given: MapInput,
    folder: Path,
    robot: Optional[Path] = None,
) -> None:
    """Each of ``names`` into ``folder``; what a reader must know is added to the map's warnings.
    ``robot``: the file of the one whose ``ground`` is wanted.

    Raises FcsvError where the map cannot give one, or the disk does not take it.
    """
    if not names:
        return
    cloud = merge_duplicates(result.cloud, result.reference)
    if not len(cloud):
        cut = result.cut and result.cut.beyond_range + result.cut.beyond_sigma
        why = (
            "all lie beyond the cloud's bounds: --cloud-range-m, --cloud-sigma"
            if cut
            else "only sky?"
        )
        raise OutputError(f"the map holds no points ({why}): nothing to make {', '.join(names)} of")
    if "orthophoto" in names and result.reference.looks_down:
        result.unseen.append(
            "Home's z axis points at the camera. That is right where the pictures look down; where they look ahead, "
            "orthophoto and heights are along the view: turn the model upright (its world's z up)."
        )
    if "orthophoto" in names and not result.reference.is_level:
        result.warnings.append(
            "home's z axis does not point up in the reference picture: orthophoto and heights are along that axis all "
            "the same. Turn the model upright (its world's z up) for a map that lies level."
        )
    for name in names:
        try:
            if name == "ground":
                result.ground = ground.write_ground(result, robot, folder / "ground")
            else:
                _WRITERS[name](result, given, cloud, folder)
        except OSError as error:
            raise OutputError(
                f"{name}: cannot be written into {folder} ({error.strerror or error})"
            ) from error

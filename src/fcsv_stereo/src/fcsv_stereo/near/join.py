# SPDX-License-Identifier: Apache-2.0
"""The near field and the map of distant configurations made one, and whether they agree where both
see."""

from dataclasses import dataclass, replace
from typing import Dict, Optional, Sequence

import numpy as np

from fcsv_stereo.depth import pixels_of
from fcsv_stereo.model import Cloud, MapResult, Picture, as_rgb, concatenate
from fcsv_stereo.model.kinds import DepthKind
from fcsv_stereo.near.surface import NearPoints, NearSurface

#: In map.ply, where other points have the index of their configuration.
NEAR_BASELINE = 255
_AGREE = 2.0  # standard deviations of the difference
_GREY = 128  # of what no picture of the map shows
_LEAST_SHARED = 50  # pixels: with fewer both do not meet


@dataclass(frozen=True)
class NearJoin:
    """What the near field brought. ``frames`` by vehicle; ``points`` of it in the cloud; ``pixels``
    of the reference picture that it gave a depth, ``new`` of them had none. Where both have one
    (``shared`` pixels, from ``from_m`` to ``to_m``): ``step`` is the median of the map's depth over
    the near field's, less one, ``apart`` the median of its size, ``agree`` the share within two
    standard deviations; None where they do not meet."""

    frames: Dict[str, int]
    points: int
    pixels: int
    new: int
    shared: int
    from_m: Optional[float] = None
    to_m: Optional[float] = None
    step: Optional[float] = None
    apart: Optional[float] = None
    agree: Optional[float] = None

    def to_dict(self) -> dict:
        """Gives the figures for report.json."""
        return {
            "frames": dict(self.frames),
            "points": self.points,
            "pixels": self.pixels,
            "new_pixels": self.new,
            "seam": {
                "pixels": self.shared,
                "from_m": self.from_m,
                "to_m": self.to_m,
                "step": self.step,
                "apart": self.apart,
                "agree": self.agree,
            },
        }


def join(
    result: MapResult,
    surface: NearSurface,
    frames: Dict[str, int],
    pictures: Sequence[Picture] = (),
) -> MapResult:
    """The map with the near field in it, and ``near``: what it brought.

    At every pixel of the reference picture the surer of both stands. Points of the map at pixels
    where the near field stands are left out, and points of the near field at or before the map's
    depth where that stands. What the reference camera does not see, the near field adds.
    ``pictures`` give its points their colours.
    """
    view = result.reference
    near, near_sigma = surface.seen(view.camera, view.T_home_cam)
    far, far_sigma = result.depth, result.sigma
    known, both = np.isfinite(near), np.isfinite(near) & np.isfinite(far)
    with np.errstate(invalid="ignore"):
        stands = known & ~(both & (far_sigma <= near_sigma))
    kept = ~_at(stands, result, result.cloud.points_home_m)
    points, twice = surface.points(), np.zeros(0, bool)
    if len(points):
        twice = _twice(points, result, stands, surface.voxel_m)
        points = NearPoints(points.points_home_m[~twice], points.sigma_m[~twice])
    cloud = concatenate([result.cloud[kept], _cloud(points, coloured(points, surface, pictures))])
    found = NearJoin(
        dict(frames),
        len(points),
        int(stands.sum()),
        int((stands & ~np.isfinite(far)).sum()),
        int(both.sum()),
        **_seam(near[both], near_sigma[both], far[both], far_sigma[both]),
    )
    return replace(
        result,
        depth=np.where(stands, near, far),
        sigma=np.where(stands, near_sigma, far_sigma),
        kind=np.where(stands, np.uint8(DepthKind.NEAR), result.kind),
        cloud=cloud,
        near=found,
    )


def _seam(near: np.ndarray, near_sigma: np.ndarray, far: np.ndarray, far_sigma: np.ndarray) -> dict:
    if len(near) < _LEAST_SHARED:
        return {}
    ratio = far / near - 1.0
    from_m, to_m = (float(v) for v in np.percentile(near, [5, 95]))
    agree = np.abs(far - near) <= _AGREE * np.hypot(near_sigma, far_sigma)
    return {
        "from_m": from_m,
        "to_m": to_m,
        "step": float(np.median(ratio)),
        "apart": float(np.median(np.abs(ratio))),
        "agree": float(agree.mean()),
    }


def _at(mask: np.ndarray, result: MapResult, points_home_m: np.ndarray) -> np.ndarray:
    rows, columns, _, inside = pixels_of(
        result.reference.camera, result.reference.T_home_cam, points_home_m
    )
    return inside & mask[rows, columns]


def _twice(points: NearPoints, result: MapResult, stands: np.ndarray, voxel_m: float) -> np.ndarray:
    """(N,) bool: points that the map has already, and surer, or that stand where it sees
    through."""
    view = result.reference
    rows, columns, z, inside = pixels_of(view.camera, view.T_home_cam, points.points_home_m)
    far, sigma = result.depth[rows, columns], result.sigma[rows, columns]
    with np.errstate(invalid="ignore"):
        before = z <= far + voxel_m + _AGREE * np.hypot(points.sigma_m, sigma)
    return inside & np.isfinite(far) & ~stands[rows, columns] & before


def coloured(points: NearPoints, surface: NearSurface, pictures: Sequence[Picture]) -> np.ndarray:
    """(N,3) uint8 RGB of the first of ``pictures`` that shows each point; grey where none does."""
    colors = np.full((len(points), 3), _GREY, np.uint8)
    missing = np.ones(len(points), bool)
    for picture in pictures:
        if not missing.any():
            break
        depth, _ = surface.seen(picture.camera, picture.T_home_cam)
        rows, columns, z, inside = pixels_of(
            picture.camera, picture.T_home_cam, points.points_home_m
        )
        with np.errstate(invalid="ignore"):
            shown = missing & inside & (z <= depth[rows, columns] + 2.0 * surface.voxel_m)
        colors[shown] = as_rgb(picture.image)[rows[shown], columns[shown]]
        missing &= ~shown
    return colors


def _cloud(points: NearPoints, colors: np.ndarray) -> Cloud:
    index = np.full(len(points), NEAR_BASELINE, np.uint8)
    return Cloud(
        points.points_home_m.astype(np.float32), colors, points.sigma_m.astype(np.float32), index
    )

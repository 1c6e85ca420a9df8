# SPDX-License-Identifier: Apache-2.0
"""Clouds in the formats of PCL (PCD) and of laser scanning (LAZ); PLY is in output.py."""

import contextlib
from pathlib import Path
from typing import Iterator, Tuple

import numpy as np

from fcsv_stereo.model import Cloud
from fcsv_stereo.model.inputs import NO_SHIFT

_LAZ_STEP_M = 0.001  # LAZ stores whole numbers of this
_BASELINE = ("baseline", "index of configuration")
#: By hand: open3d's tensor writer gives rgb type F and orders sigma and baseline as it likes;
#: readers know this layout.
_PCD_POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("rgb", "<u4"),
        ("sigma", "<f4"),
        ("baseline", "<u4"),
    ]
)


def origin_line(origin_m: np.ndarray) -> str:
    """Gives the line for the header of a file in float32.

    >>> origin_line(np.array([500000.0, 5824000.0, 0.0]))
    'origin_m 500000 5824000 0 (x y z plus this are in home)'
    """
    return f"origin_m {' '.join(f'{v:.15g}' for v in origin_m)} (x y z plus this are in home)"


def write_pcd(cloud: Cloud, path: Path, origin_m: np.ndarray = NO_SHIFT) -> None:
    """Binary PCD 0.7: x y z (home, m), rgb packed as PCL does, sigma (m), baseline (index of the
    configuration).

    A comment says ``origin_m`` where x y z plus this are in home.
    """
    points = np.empty(len(cloud), _PCD_POINT)
    for i, axis in enumerate("xyz"):
        points[axis] = cloud.points_home_m[:, i]
    red, green, blue = cloud.colors.astype(np.uint32).T
    points["rgb"] = (red << 16) | (green << 8) | blue
    points["sigma"], points["baseline"] = cloud.sigma_m, cloud.baseline_index
    count = len(points)
    comment = f"# {origin_line(origin_m)}\n" if np.any(origin_m) else ""
    head = (
        f"# .PCD v0.7 - frame home, metres\n{comment}VERSION 0.7\nFIELDS x y z rgb sigma baseline\nSIZE 4 4 4 4 4 4\n"
        f"TYPE F F F U F U\nCOUNT 1 1 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\n"
        "DATA binary\n"
    )
    path.write_bytes(head.encode() + points.tobytes())


class LazFile:
    """LAZ 1.4 (point format 7) that takes one cloud after the other: x y z (m, to 1 mm), 16-bit
    colours, extra dimensions sigma (m) and baseline, or ``last``'s name and meaning; ``crs`` names
    the reference system of x and y, where they are of one. Clouds leave out ``origin_m``;
    ``least_m`` (3,): about their least coordinates. A context manager: the file is there, whole,
    when it is left without an error. Raises OSError where the disk does not take it."""

    def __init__(
        self,
        path: Path,
        least_m: np.ndarray,
        origin_m: np.ndarray = NO_SHIFT,
        last: Tuple[str, str] = _BASELINE,
        crs: str = "",
    ):
        import laspy  # with lazrs; only where the product is asked for

        header = laspy.LasHeader(point_format=7, version="1.4")
        header.scales = np.full(3, _LAZ_STEP_M)
        header.offsets = np.floor(least_m).astype(float) + origin_m
        header.add_extra_dims(
            [
                laspy.ExtraBytesParams("sigma", np.float32, "standard deviation (m)"),
                laspy.ExtraBytesParams(last[0], np.uint8, last[1]),
            ]
        )
        if crs:
            from pyproj import CRS

            header.add_crs(CRS.from_user_input(crs))
        self._path, self._origin_m, self._last = path, origin_m, last[0]
        self._partial = path.with_name(path.name + ".partial")
        path.parent.mkdir(parents=True, exist_ok=True)
        self._writer = laspy.open(
            str(self._partial),
            mode="w",
            header=header,
            laz_backend=laspy.LazBackend.Lazrs,
            do_compress=True,
        )

    def __enter__(self) -> "LazFile":
        return self

    def __exit__(self, kind, *_) -> None:
        try:
            if kind is None:
                with self._refusals():
                    self._writer.close()
                self._partial.replace(self._path)
        finally:
            self._partial.unlink(missing_ok=True)

    def add(self, cloud: Cloud) -> None:
        """Writes its points."""
        import laspy

        points = laspy.ScaleAwarePointRecord.zeros(len(cloud), header=self._writer.header)
        points.x, points.y, points.z = (cloud.points_home_m.astype(float) + self._origin_m).T
        points.red, points.green, points.blue = cloud.colors.T.astype(np.uint16) * 257
        points["sigma"], points[self._last] = cloud.sigma_m, cloud.baseline_index
        with self._refusals():
            self._writer.write_points(points)

    @contextlib.contextmanager
    def _refusals(self) -> Iterator[None]:
        """What the disk refuses is an OSError, as of other files."""
        from lazrs import LazrsError

        try:
            yield
        except LazrsError as error:
            raise OSError(f"{self._path}: {error}; is the disk full?") from error


def write_laz(cloud: Cloud, path: Path, origin_m: np.ndarray = NO_SHIFT) -> None:
    """A map's cloud as ``LazFile``."""
    with LazFile(path, cloud.points_home_m.min(axis=0), origin_m) as file:
        file.add(cloud)

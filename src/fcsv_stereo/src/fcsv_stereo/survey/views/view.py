# SPDX-License-Identifier: Apache-2.0
"""A view: the map of one reference picture, with what is known of its place before views are
compared."""

import itertools
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Optional, Tuple

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.picture_files import read_picture
from fcsv_stereo.errors import DamagedMapError, InputError, SurveyError
from fcsv_stereo.map_files.reading import read_map_folder
from fcsv_stereo.model.kinds import supported
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.sessions.fixes import cam_place
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.views.station import Prior


@dataclass(frozen=True)
class View:
    """``image`` (H,W,3) uint8 RGB; ``depth`` and ``sigma`` (H,W) m along the optical axis, NaN
    where none; ``kind`` (H,W) uint8 of ``model.kinds``; ``T_home_cam`` 4x4 of the map.

    ``picture``: the reference picture's name; of a photograph also the camera that took it,
    distortion included. ``gps``: of the photograph, or of a session's vehicles; ``gps_cam_m`` (3,):
    where in the camera's frame.

    Raises SurveyError, which names the view, where these do not belong together.
    """

    name: str
    source: str
    image: np.ndarray
    depth: np.ndarray
    sigma: np.ndarray
    kind: np.ndarray
    camera: PinholeCamera
    T_home_cam: np.ndarray
    prior: Prior
    picture: str = ""
    taken_with: Optional[PinholeCamera] = None
    gps: Optional[Gps] = None
    gps_cam_m: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self):
        size = (self.camera.height, self.camera.width)
        for what in ("depth", "sigma", "kind"):
            if getattr(self, what).shape != size:
                raise SurveyError(
                    f"{self.name}: {what} has shape {getattr(self, what).shape}, not {size}"
                )
        if self.image.shape != (*size, 3):
            raise SurveyError(
                f"{self.name}: reference picture has shape {self.image.shape}, not {(*size, 3)}"
            )

    @cached_property
    def known(self) -> np.ndarray:
        """(H,W) bool: pixels whose depth some pair supports, and that is sure enough for a
        cloud."""
        with np.errstate(invalid="ignore"):
            sure = (
                (self.depth > 0)
                & (self.sigma > 0)
                & (self.sigma <= tuning.MOST_CLOUD_SIGMA * self.depth)
            )
        return sure & supported(self.kind)

    @cached_property
    def own_sigma(self) -> np.ndarray:
        """(H,W) m: ``sigma`` without the map's scale, which the adjustment measures.

        A map's sigma holds its scale only where its input stated it; then no pixel is surer than
        that.
        """
        if not self.known.any():
            return self.sigma
        least = float(np.quantile(self.sigma[self.known] / self.depth[self.known], 0.01))
        held = min(self.prior.scale, least)
        own = np.square(self.sigma) - np.square(held * self.depth)
        return np.sqrt(np.maximum(own, np.square(0.25 * self.sigma)))

    @cached_property
    def _inverse(self) -> np.ndarray:
        """(H,W) 1/m, the inverse depth, NaN where it is not known."""
        return 1.0 / np.where(self.known, self.depth, np.nan)

    @cached_property
    def _bend_m(self) -> np.ndarray:
        """(H,W) m: how far surfaces bend or step within what the matcher compares."""
        return _bend(self._inverse) * np.square(self.depth)

    @cached_property
    def point_sigma(self) -> np.ndarray:
        """(H,W) m: ``own_sigma`` less on planes, more where the surface bends or steps, and where one
        pair alone tells the depth."""
        bend_m = np.fmin(self._bend_m, tuning.MOST_BEND * self.own_sigma)  # steps are known well
        sigma = np.hypot(tuning.PLANE_SIGMA * self.own_sigma, tuning.BEND_SIGMA * bend_m)
        return np.where(self.kind == 1, tuning.ONE_PAIR_SIGMA, 1.0) * sigma

    def pose_variance(self, covariance: np.ndarray) -> np.ndarray:
        """(H,W) m²: of the depths, as the tangent of the view's similarity with this covariance (7,7)
        moves the surface that a pixel sees: the flatter it is seen, the more. A step is no slope."""
        steps = self._bend_m > tuning.MOST_BEND * self.own_sigma
        across, down = (
            np.where(steps, 0.0, np.nan_to_num(0.5 * (one - other) / tuning.BEND_PX))
            for one, other in (_opposite(self._inverse, *d) for d in ((0, 1), (1, 0)))
        )
        rows, columns = np.nonzero(self.known)
        z = self.depth[rows, columns].astype(float)
        points = self._at(columns, rows, z)
        normal = np.column_stack([across[self.known], down[self.known], 1.0 / z])
        normal[:, :2] *= [self.camera.fx, self.camera.fy]
        normal[:, 2] -= np.einsum("ni,ni->n", normal[:, :2], points[:, :2]) / z
        # of the plane normal . p = 1 about the point
        J = np.column_stack([np.cross(points, normal), normal, np.ones(len(z))])
        found = np.full(self.depth.shape, np.nan)
        found[self.known] = np.square(z) * np.einsum("ni,ni->n", J @ covariance, J)
        return found

    @cached_property
    def sampled(self) -> np.ndarray:
        """(N,3) float32 m in the camera's frame: some of the known pixels, evenly."""
        rows, columns = np.nonzero(self.known)
        some = slice(None, None, max(1, len(rows) // tuning.OVERLAP_SAMPLES))
        depth = self.depth[rows[some], columns[some]].astype(float)
        return self._at(columns[some], rows[some], depth).astype(np.float32)

    @cached_property
    def corners(self) -> np.ndarray:
        """(8,3) m in the camera's frame: the truncated pyramid that holds all known pixels; (0,3)
        where there are none."""
        rows, columns = np.nonzero(self.known)
        if not len(rows):
            return np.zeros((0, 3))
        depth = self.depth[rows, columns].astype(float)
        limits = [(v.min(), v.max()) for v in (columns, rows, depth)]
        return self._at(*np.array(list(itertools.product(*limits)), float).T)

    def _at(self, u: np.ndarray, v: np.ndarray, depth: np.ndarray) -> np.ndarray:
        c = self.camera
        return (
            np.column_stack([(u - c.cx) / c.fx, (v - c.cy) / c.fy, np.ones(len(u))])
            * depth[:, None]
        )

    def load(self) -> "View":
        """The view itself: its pixels are in memory already."""
        return self


def _bend(inverse: np.ndarray) -> np.ndarray:
    """(H,W) 1/m: how far the inverse depth, which is linear on planes, is off the middle of two
    pixels opposite each other: the most of four directions, and of the pixels about."""
    most, side = np.zeros(inverse.shape), tuning.BEND_PX + 1
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one, other = _opposite(inverse, down, right)
        most = np.fmax(most, np.abs(0.5 * (one + other) - inverse))
    return cv2.dilate(most, np.ones((side, side), np.uint8))


def _opposite(inverse: np.ndarray, down: int, right: int) -> Tuple[np.ndarray, np.ndarray]:
    """(H,W) what is ``BEND_PX`` pixels down and right (0, 1 or -1 times), and opposite; NaN
    outside."""
    r, (height, width) = tuning.BEND_PX, inverse.shape
    padded = np.pad(inverse, r, constant_values=np.nan)
    one, other = (padded[r + s * r * down :, r + s * r * right :][:height, :width] for s in (1, -1))
    return one, other


def read_view(folder: Path, name: str, source: str, prior) -> View:
    """The view of a folder that ``map`` wrote; ``prior``: (T_home_cam, name) -> Prior. Raises
    DamagedMapError naming folder and file."""
    try:
        read = read_map_folder(folder)
    except InputError as error:
        raise DamagedMapError(str(error)) from error
    try:
        T_home_cam = transforms.require_rigid(read.T_home_cam, "T_home_cam")
        size = (int(read.reference[n]) for n in ("width", "height"))
        K = read.K
        camera = PinholeCamera(*size, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        gps = _gps(read.gps) if read.gps else None
        at = cam_place(read.gps, T_home_cam) if read.gps else np.zeros(3)
        image = cv2.cvtColor(read_picture(folder / "reference.png").pixels, cv2.COLOR_BGR2RGB)
    except (FcsvError, KeyError, TypeError, ValueError, OSError, cv2.error) as error:
        raise DamagedMapError(f"{folder}: is not a map of this program ({error})") from error
    return View(
        name,
        source,
        image,
        read.depth,
        read.sigma,
        read.kind,
        camera,
        T_home_cam,
        prior(T_home_cam, name),
        str(read.reference.get("image", "")),
        gps=gps,
        gps_cam_m=at,
    )


def _gps(told: dict) -> Gps:
    """Raises KeyError, TypeError or ValueError where report.json does not tell a place."""
    height_m, height_sigma_m = told["height_m"], told["height_sigma_m"]
    if height_m is None:
        height_m, height_sigma_m = 0.0, tuning.FREE_M
    numbers = (told["latitude_deg"], told["longitude_deg"], height_m, told["sigma_m"])
    return Gps(*map(float, numbers), float(height_sigma_m))

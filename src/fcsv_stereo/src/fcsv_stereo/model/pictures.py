# SPDX-License-Identifier: Apache-2.0
"""A camera's picture in its three states: to be mapped, as it came over the link, and as what a map
belongs to."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Optional

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import PictureFileError
from fcsv_geometry.picture_files import decode_picture
from fcsv_stereo.errors import InputError


def as_rgb(image: np.ndarray) -> np.ndarray:
    """HxWx3 of a picture (HxWx3, or HxW: grey)."""
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)


def as_grey(image: np.ndarray) -> np.ndarray:
    """HxW uint8 of a picture (HxWx3 uint8 RGB, or HxW: grey)."""
    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image


def is_level(T_home_cam: np.ndarray) -> bool:
    """Whether home's z may point up, as ``Reference.is_level`` says it."""
    right, down, ahead = T_home_cam[2, :3]
    return bool(-down > 0.5 or -ahead > max(abs(right), down, 0.5))


@dataclass(frozen=True)
class Picture:
    """An undistorted picture (HxWx3 uint8 RGB), its pinhole camera and the prior of its pose.

    ``blank`` (HxW bool) are pixels that the camera did not take, as taking out the distortion
    leaves them along the borders; None where there are none. ``covariance`` (6, 6) is of the prior
    in home (pose_covariance); None where the input's ``prior`` says how good it is.
    """

    name: str
    vehicle: str
    stamp_s: float
    image: np.ndarray
    camera: PinholeCamera
    T_home_cam: np.ndarray
    blank: Optional[np.ndarray] = None
    covariance: Optional[np.ndarray] = None

    @classmethod
    def undistorted(
        cls, name, vehicle, stamp_s, image, camera: PinholeCamera, T_home_cam, covariance=None
    ) -> "Picture":
        """Makes a picture from the picture as a ``camera`` with distortion took it."""
        undistorted = camera.undistort(image)
        return cls(
            name,
            vehicle,
            stamp_s,
            undistorted,
            camera.undistorted(),
            T_home_cam,
            camera.blank(),
            covariance,
        )

    def shrunk(self, scale: float) -> "Picture":
        """The picture at a share of its size."""
        height, width = (max(1, round(n * scale)) for n in self.image.shape[:2])
        image = cv2.resize(self.image, (width, height), interpolation=cv2.INTER_AREA)
        blank = self.blank
        if blank is not None:
            blank = (
                cv2.resize(blank.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
                > 0
            )
        return replace(self, image=image, camera=self.camera.resized(width, height), blank=blank)


@dataclass(frozen=True)
class LivePicture:
    """A picture as it came over the link: JPEG of the distorted picture, and T_odom_cam at its
    stamp."""

    vehicle: str
    stamp_s: float
    jpeg: bytes
    camera: PinholeCamera
    T_odom_cam: np.ndarray
    # of the pose in home, as far as it is known (pose_covariance)
    covariance: Optional[np.ndarray] = None

    @cached_property
    def image(self) -> np.ndarray:
        """Undistorted (H,W,3) uint8 RGB, made once: a map takes it again with every configuration
        that comes.

        Raises InputError where it is no picture of its camera.
        """
        name = f"picture of {self.vehicle} at {self.stamp_s:.3f}"
        try:
            bgr = decode_picture(self.jpeg, "it").pixels
        except PictureFileError as error:
            raise InputError(f"{name} is not a JPEG that can be read ({error})") from error
        size = (self.camera.height, self.camera.width)
        if bgr.shape[:2] != size:
            raise InputError(f"{name} is {bgr.shape[1]}x{bgr.shape[0]}, not {size[1]}x{size[0]}")
        return self.camera.undistort(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB))

    def picture(self, T_home_odom: np.ndarray) -> Picture:
        """Makes the picture with its pose in home. Raises like image."""
        name = f"{self.vehicle}/{self.stamp_s:.3f}"
        T_home_cam = T_home_odom @ self.T_odom_cam
        camera, blank = self.camera.undistorted(), self.camera.blank()
        return Picture(
            name, self.vehicle, self.stamp_s, self.image, camera, T_home_cam, blank, self.covariance
        )


@dataclass(frozen=True)
class Reference:
    """The undistorted picture (HxWx3 uint8 RGB) that depth and sigma belong to."""

    name: str
    stamp_s: float
    vehicle: str
    image: np.ndarray
    camera: PinholeCamera
    T_home_cam: np.ndarray

    @classmethod
    def of(cls, p: Picture) -> "Reference":
        """A picture as what depth belongs to."""
        return cls(p.name, p.stamp_s, p.vehicle, p.image, p.camera, p.T_home_cam)

    @property
    def is_level(self) -> bool:
        """Whether home's z may point up: photographs may have any world.

        It does where it points up in the picture, or at the camera as in pictures that look down,
        to within 60 degrees. Sideways, down and along the view it does not.
        """
        return is_level(self.T_home_cam)

    @property
    def looks_down(self) -> bool:
        """Whether home's z points at the camera, to within 45 degrees, as in pictures of ground
        from above."""
        return bool(-self.T_home_cam[2, 2] > np.sqrt(0.5))

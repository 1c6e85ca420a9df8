# SPDX-License-Identifier: Apache-2.0
"""Features of a view that have a depth: where they are in its camera's frame, how well that is
known, what they look like."""

from dataclasses import dataclass
from typing import Tuple

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import as_grey
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.views.view import View

_SIDE_PX = 5  # of the pixels about a feature whose depths must be of one surface


@dataclass(frozen=True)
class Features:
    """``uv`` (N,2) px; ``points`` (N,3) m in the camera's frame; ``covariances`` (N,3,3) m²;
    ``descriptors`` (N,128) float32 of unit length (RootSIFT)."""

    camera: PinholeCamera
    uv: np.ndarray
    points: np.ndarray
    covariances: np.ndarray
    descriptors: np.ndarray

    def __len__(self) -> int:
        return len(self.uv)

    def __getitem__(self, which) -> "Features":
        arrays = (self.uv, self.points, self.covariances, self.descriptors)
        return Features(self.camera, *(values[which] for values in arrays))

    def joined_with(self, other: "Features") -> "Features":
        """Both, of one view."""
        names = ("uv", "points", "covariances", "descriptors")
        both = (np.concatenate([getattr(self, n), getattr(other, n)]) for n in names)
        return Features(self.camera, *both)


def features_of(view: View) -> Features:
    """SIFT features of the reference picture at pixels whose depth is sure and of one surface."""
    uv, root = sift_at(as_grey(view.image), on_surfaces(view))
    return of_pixels(view, uv, root)


def sift_at(grey: np.ndarray, where: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Features ``where`` (H,W) bool: (N,2) px, descriptors (N,128)."""
    sift = cv2.SIFT_create(tuning.MOST_FEATURES, contrastThreshold=0.02)
    keypoints = sift.detect(grey, where.astype(np.uint8))
    if not keypoints:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    keypoints, descriptors = sift.compute(grey, keypoints)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-6))
    return np.array([k.pt for k in keypoints]), root.astype(np.float32)


def of_pixels(view: View, uv: np.ndarray, descriptors: np.ndarray) -> Features:
    """Features at (N,2) px of a view, with its depth there."""
    u, v = np.rint(uv).astype(int).reshape(-1, 2).T
    depth, sigma = view.depth[v, u].astype(float), view.own_sigma[v, u].astype(float)
    return located(view.camera, uv, depth, sigma, descriptors)


def located(
    camera: PinholeCamera, uv: np.ndarray, depth: np.ndarray, sigma: np.ndarray, descriptors
) -> Features:
    """Features at pixels ``uv`` (N,2) with ``depth`` and ``sigma`` (N,) m along the optical
    axis."""
    ray = np.column_stack(
        [(uv - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(len(uv))]
    )
    across = np.zeros((len(uv), 3, 3))
    across[:, 0, 0], across[:, 1, 1] = (
        np.square(tuning.FEATURE_PX * depth / f) for f in (camera.fx, camera.fy)
    )
    covariances = across + np.square(sigma)[:, None, None] * ray[:, :, None] * ray[:, None, :]
    return Features(camera, uv, ray * depth[:, None], covariances, descriptors)


def on_surfaces(view: View) -> np.ndarray:
    """(H,W) bool: sure pixels all of whose neighbours are known and nearly as far."""
    window = np.ones((_SIDE_PX, _SIDE_PX), np.uint8)
    depth = np.where(view.known, view.depth, 0.0).astype(np.float32)
    low, high = cv2.erode(depth, window), cv2.dilate(depth, window)
    with np.errstate(invalid="ignore"):
        sure = view.sigma <= tuning.MOST_FEATURE_SIGMA * view.depth
    return view.known & sure & (low > 0) & (high - low <= tuning.MOST_FEATURE_STEP * high)

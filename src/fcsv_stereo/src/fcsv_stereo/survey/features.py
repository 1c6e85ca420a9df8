# SPDX-License-Identifier: Apache-2.0
"""Features of a view that have a depth: where they are in its camera's frame, how well that is
known, what they look like."""

from dataclasses import dataclass

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import as_grey
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.views import View

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


def features_of(view: View) -> Features:
    """SIFT features of the reference picture at pixels whose depth is sure and of one surface."""
    grey = as_grey(view.image)
    sift = cv2.SIFT_create(tuning.MOST_FEATURES, contrastThreshold=0.02)
    keypoints = sift.detect(grey, _on_surfaces(view).astype(np.uint8))
    if not keypoints:
        return _none(view.camera)
    keypoints, descriptors = sift.compute(grey, keypoints)
    uv = np.array([k.pt for k in keypoints])
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-6)).astype(
        np.float32
    )
    u, v = np.rint(uv).astype(int).T
    return located(
        view.camera, uv, view.depth[v, u].astype(float), view.own_sigma[v, u].astype(float), root
    )


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


def _on_surfaces(view: View) -> np.ndarray:
    """(H,W) bool: sure pixels all of whose neighbours are known and nearly as far."""
    window = np.ones((_SIDE_PX, _SIDE_PX), np.uint8)
    depth = np.where(view.known, view.depth, 0.0).astype(np.float32)
    low, high = cv2.erode(depth, window), cv2.dilate(depth, window)
    with np.errstate(invalid="ignore"):
        sure = view.sigma <= tuning.MOST_FEATURE_SIGMA * view.depth
    return view.known & sure & (low > 0) & (high - low <= tuning.MOST_FEATURE_STEP * high)


def _none(camera: PinholeCamera) -> Features:
    return Features(
        camera,
        np.zeros((0, 2)),
        np.zeros((0, 3)),
        np.zeros((0, 3, 3)),
        np.zeros((0, 128), np.float32),
    )

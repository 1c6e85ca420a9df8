# SPDX-License-Identifier: Apache-2.0
"""Features of one picture: SIFT on a reduced picture to find correspondences, corners to measure
them."""

import threading
import weakref
from dataclasses import dataclass, replace
from typing import Dict, Tuple

import cv2
import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model import Picture, as_grey

_SIFT_PIXELS = 150e3  # SIFT finds neighbours; accuracy comes from tracking in the whole picture
_TRACKING_PIXELS = 2e6  # more is more blur, not more detail
_MIN_SIDE_PX = 24


@dataclass(frozen=True)
class FeatureView:
    """A picture prepared for matching.

    ``gray`` is HxW uint8, reduced where a picture has more pixels than lenses resolve, ``camera``
    the camera of that; all pixels of a view are those of ``gray``. ``uv`` (N, 2) px, ``rays`` (N,
    3) with z = 1 and ``descriptors`` (N, 128) float32 of unit length (RootSIFT) belong to its
    features.
    """

    picture: Picture
    camera: PinholeCamera
    gray: np.ndarray
    uv: np.ndarray
    rays: np.ndarray
    descriptors: np.ndarray
    noise_px: float = 0.5  # standard deviation of a feature's place


def rays_of(camera: PinholeCamera, uv: np.ndarray) -> np.ndarray:
    """Directions (N, 3) with z = 1 of pixels (N, 2) of an undistorted picture."""
    return np.column_stack(
        [(uv[:, 0] - camera.cx) / camera.fx, (uv[:, 1] - camera.cy) / camera.fy, np.ones(len(uv))]
    )


class KnownFeatures:
    """Views of pictures that are refined again, as when a map grows: by the identity of their
    pixels, while these live.

    Safe to use from several threads; whoever keeps one must not change a picture's pixels in place.
    """

    def __init__(self):
        self._views: Dict[Tuple, Tuple[weakref.ref, FeatureView]] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._views)

    def prepare(self, picture: Picture, features: int) -> FeatureView:
        """Prepares as ``prepare``, without doing again what was done."""
        key = (id(picture.image), picture.camera, features)
        with self._lock:
            image, view = self._views.get(key, (None, None))
        if image is not None and image() is picture.image:
            return replace(view, picture=picture)
        view = prepare(picture, features)
        if view.gray is picture.image:  # it would keep alive what it is to be forgotten with
            return view
        with self._lock:
            gone = weakref.ref(picture.image, lambda _: self._views.pop(key, None))
            self._views[key] = (gone, replace(view, picture=replace(picture, image=None)))
        return view


def prepare(picture: Picture, features: int) -> FeatureView:
    """SIFT features of a picture, at most so many, spread over it."""
    gray = _reduced(as_grey(picture.image), _TRACKING_PIXELS)
    camera = _resized(picture.camera, gray.shape)
    small = _reduced(gray, _SIFT_PIXELS)
    if min(small.shape) < _MIN_SIDE_PX:
        return _empty(picture, camera, gray)
    sift = cv2.SIFT_create(contrastThreshold=0.015)
    keypoints = sift.detect(small, None)
    keypoints = [keypoints[i] for i in spread(keypoints, small.shape, features)]
    keypoints, descriptors = sift.compute(small, keypoints)
    if not keypoints:
        return _empty(picture, camera, gray)
    ratio = np.array([gray.shape[1] / small.shape[1], gray.shape[0] / small.shape[0]])
    uv = (np.array([k.pt for k in keypoints]) + 0.5) * ratio - 0.5
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-6))
    return FeatureView(
        picture,
        camera,
        gray,
        uv,
        rays_of(camera, uv),
        root.astype(np.float32),
        0.5 * float(ratio[0]),
    )


def _reduced(gray: np.ndarray, pixels: float) -> np.ndarray:
    scale = float(np.sqrt(pixels / gray.size))
    return (
        cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        if scale < 1.0
        else gray
    )


def _resized(camera: PinholeCamera, shape) -> PinholeCamera:
    """The camera of a resized picture; pixel centres are at whole numbers."""
    height, width = shape
    u, v = width / camera.width, height / camera.height
    cx, cy = (camera.cx + 0.5) * u - 0.5, (camera.cy + 0.5) * v - 0.5
    return PinholeCamera(width, height, camera.fx * u, camera.fy * v, cx, cy)


def _empty(picture: Picture, camera: PinholeCamera, gray: np.ndarray) -> FeatureView:
    return FeatureView(
        picture, camera, gray, np.empty((0, 2)), np.empty((0, 3)), np.empty((0, 128), np.float32)
    )


def spread(keypoints, shape, count: int) -> np.ndarray:
    """Indices of the strongest keypoints of each cell of a grid, so that far and near parts both
    have some."""
    if not keypoints:
        return np.empty(0, int)
    uv = np.array([k.pt for k in keypoints])
    strength = np.array([k.response for k in keypoints])
    columns, rows = 16, 12
    cell = (uv[:, 0] * columns // shape[1]).astype(int) + columns * (
        uv[:, 1] * rows // shape[0]
    ).astype(int)
    order = np.lexsort((-strength, cell))
    first = np.r_[0, np.flatnonzero(np.diff(cell[order])) + 1]
    rank = np.arange(len(order)) - np.repeat(first, np.diff(np.r_[first, len(order)]))
    return order[np.argsort(rank, kind="stable")][:count]


def corners(gray: np.ndarray, count: int) -> np.ndarray:
    """Corners (N, 2) px, at most so many, no two nearer than the count asks for."""
    spacing_px = 0.6 * float(np.sqrt(gray.size / count))
    found = cv2.goodFeaturesToTrack(gray, count, 0.003, max(spacing_px, 3.0), blockSize=5)
    return np.empty((0, 2)) if found is None else found.reshape(-1, 2).astype(float)

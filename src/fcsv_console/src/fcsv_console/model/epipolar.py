# SPDX-License-Identifier: Apache-2.0
"""How well two cameras' pictures and their places agree: the distance of matched features from
their epipolar lines.

Places from tracking, pictures from the radio. Beside it: what a fit of the pair leaves, as the map
refines poses. A turn along the baseline shows in no epipolar line.
"""

import math
import threading
from collections import deque
from dataclasses import dataclass, replace
from typing import Deque, Dict, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_console.model.facts import EpipolarReport
from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.model.inputs import FLOWN

# ORB's; fewer matches that agree with any epipolar geometry say nothing
_FEATURES, _LEAST = 800, 25
# of the second best; of the matches, less is a geometry that chance has found
_RATIO, _SHARE = 0.85, 0.5
# features of a picture that shows enough: where fewer than _LEAST match, it shows something else
_ENOUGH = 4 * _LEAST
# the same octets so often in a row: a camera has noise, and a vehicle moves
_FROZEN = 4
# of matches with a geometry of their own: it sorts out wrong ones, whatever the places say
_AGREE_PX = 2.0
# of the baseline: cameras one before the other, as in the column; no configuration stands so
_ALONG = 0.7
_NOISE_PX = 1.0  # standard deviation of a feature of ORB: a corner of some level of its pyramid
# kept per vehicle, 4 s; a picture without one so near in time is left out
_POSES, _POSE_S = 120, 0.05


# stamp, as it came, its camera; None: a reduced one
Picture = Tuple[float, bytes, Optional[PinholeCamera]]


@dataclass(frozen=True)
class EpipolarPicture:
    """A picture (JPEG or PNG) with its camera as taken and its place; ``reduced``: it may be
    smaller than that."""

    stamp_s: float
    data: bytes
    camera: PinholeCamera
    T_home_cam: np.ndarray
    reduced: bool = False


def measured(pair: Tuple[str, str], a: EpipolarPicture, b: EpipolarPicture) -> EpipolarReport:
    """How two pictures agree with their places, in px of b. NaN: too few matches.

    Raises ValueError where a picture cannot be unpacked.
    """
    # it loads all of refinement: not at the window's start
    from fcsv_stereo.refinement.geometry import epipolar_error

    (gray_a, a), (gray_b, b) = _read(a), _read(b)
    features = _features(gray_a), _features(gray_b)
    uv_a, uv_b = _matches(*features)

    def too_few(agreeing: int) -> EpipolarReport:
        shown = [len(points) for points, _ in features]
        return EpipolarReport(pair, math.nan, agreeing, unlike=_unlike(pair, shown, agreeing))

    if len(uv_a) < _LEAST:
        return too_few(len(uv_a))
    rays_a, rays_b = (
        np.column_stack([s.camera.normalize(uv), np.ones(len(uv))])
        for s, uv in ((a, uv_a), (b, uv_b))
    )
    cv2.setRNGSeed(1)
    _, kept = cv2.findEssentialMat(
        rays_a[:, :2].copy(),
        rays_b[:, :2].copy(),
        np.eye(3),
        cv2.RANSAC,
        0.999,
        _AGREE_PX / b.camera.fx,
    )
    kept = np.zeros(len(rays_a), bool) if kept is None else kept.ravel().astype(bool)
    if kept.sum() < max(_LEAST, _SHARE * len(kept)):
        return too_few(int(kept.sum()))
    T_a_b = transforms.invert(a.T_home_cam) @ b.T_home_cam
    error, _ = epipolar_error(T_a_b, rays_a[kept], rays_b[kept])
    error_px, fitted = (
        float(b.camera.fx * np.median(np.abs(error))),
        _fitted(T_a_b, rays_a[kept], rays_b[kept], b),
    )
    return EpipolarReport(pair, error_px, int(kept.sum()), *fitted, picture_focal_px=b.camera.fx)


def _fitted(
    T_a_b: np.ndarray, rays_a: np.ndarray, rays_b: np.ndarray, b: EpipolarPicture
) -> Tuple[float, float]:
    """(median px that is left, standard deviations from the trackers' pose) once the pair is fitted
    as the map fits it, with its prior; NaN where it would not: the baseline is too short, or the
    vehicle in front is in the way."""
    from fcsv_stereo.refinement.geometry import PairPrior, fit_pair, prior_offset
    from fcsv_stereo.refinement.matching import band_px

    baseline_m = float(np.linalg.norm(T_a_b[:3, 3]))
    prior = PairPrior(T_a_b, FLOWN.rotation_rad, FLOWN.position_sigma_m(baseline_m))
    in_front = abs(float(T_a_b[2, 3])) > _ALONG * baseline_m
    if in_front or baseline_m < 3.0 * prior.position_m:
        return math.nan, math.nan
    width_px = band_px(prior, b.camera.fx, 1.5 * baseline_m)
    T_fitted, error_px = fit_pair(prior, rays_a, rays_b, b.camera.fx, width_px, _NOISE_PX)
    surprise = float((np.abs(prior_offset(prior, T_fitted)) * np.sqrt(prior.information)).max())
    return float(np.median(np.abs(error_px))), surprise


def _read(seen: EpipolarPicture) -> Tuple[np.ndarray, EpipolarPicture]:
    """Grey, with the camera of its size."""
    gray = (
        cv2.imdecode(np.frombuffer(seen.data, np.uint8), cv2.IMREAD_GRAYSCALE)
        if seen.data
        else None
    )
    if gray is None:
        raise ValueError(f"{len(seen.data)} octets are no picture")
    if seen.reduced:
        seen = replace(seen, camera=seen.camera.resized(gray.shape[1], gray.shape[0]))
    if gray.shape != (seen.camera.height, seen.camera.width):
        raise ValueError(
            f"the picture is {gray.shape[1]} x {gray.shape[0]}, its camera {seen.camera.width} x "
            f"{seen.camera.height}"
        )
    return gray, seen


def _unlike(pair: Tuple[str, str], shown: Sequence[int], agreeing: int) -> str:
    """Why pictures with so many features each tell nothing of each other; empty where both show
    little, as plain ground does."""
    least, most = sorted(range(2), key=lambda i: shown[i])
    if shown[most] < _ENOUGH:
        return ""
    if shown[least] < _LEAST:
        return (
            f"the picture of {pair[least]} shows nothing to compare: dark, out of focus or covered"
        )
    if shown[least] < _ENOUGH:
        return ""
    return f"the pictures have too little in common: {agreeing} features agree, {_LEAST} are needed"


def _features(gray: np.ndarray):
    return cv2.ORB_create(_FEATURES).detectAndCompute(gray, None)


def _matches(a, b) -> Tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) of features that are each other's best, by far (Lowe's ratio)."""
    (points_a, of_a), (points_b, of_b) = a, b
    if of_a is None or of_b is None:
        return np.empty((0, 2)), np.empty((0, 2))
    forth, back = (_best(x, y) for x, y in ((of_a, of_b), (of_b, of_a)))
    pairs = [(points_a[i].pt, points_b[k].pt) for i, k in forth.items() if back.get(k) == i]
    uv = np.array(pairs, float).reshape(-1, 2, 2)
    return uv[:, 0], uv[:, 1]


def _best(a: np.ndarray, b: np.ndarray) -> Dict[int, int]:
    found = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(a, b, k=2)
    return {
        m[0].queryIdx: m[0].trainIdx
        for m in found
        if len(m) == 2 and m[0].distance < _RATIO * m[1].distance
    }


class EpipolarWatch:
    """Keeps the newest picture of each vehicle with its place. ``tell`` and ``measure`` from
    different threads."""

    def __init__(self, vehicles: Sequence[str]):
        self._poses: Dict[str, Deque[Tuple[float, np.ndarray]]] = {
            n: deque(maxlen=_POSES) for n in vehicles
        }
        self._pictures: Dict[str, Deque[Picture]] = {n: deque(maxlen=_FROZEN) for n in vehicles}
        self._cameras: Dict[str, PinholeCamera] = {}
        self._measured: Tuple[float, float] = (math.nan, math.nan)
        self._lock = threading.Lock()

    def tell_pose(self, name: str, stamp_s: float, T_home_cam: np.ndarray) -> None:
        """Where a camera was."""
        with self._lock:
            self._poses[name].append((stamp_s, T_home_cam))

    def tell_picture(self, name: str, stamp_s: float, data: bytes, camera: PinholeCamera) -> None:
        """What it saw while recording."""
        with self._lock:
            self._pictures[name].append((stamp_s, data, camera))

    def tell_camera(self, name: str, camera: PinholeCamera) -> None:
        """Takes the camera by which its live pictures are read."""
        with self._lock:
            self._cameras[name] = camera

    def tell_live(self, name: str, stamp_s: float, data: bytes) -> None:
        """A reduced picture, as they always come."""
        with self._lock:
            self._pictures[name].append((stamp_s, data, None))

    def measure(self, pair: Tuple[str, str]) -> Optional[EpipolarReport]:
        """Measures the error of the newest pictures of both whose places are known; None where
        there is nothing new."""
        if len(set(pair)) < 2 or not set(pair) <= set(self._poses):
            return None
        with self._lock:
            a, b = (self._seen(name) for name in pair)
            frozen = [name for name in pair if self._frozen(name)]
        if a is None or b is None or (a.stamp_s, b.stamp_s) == self._measured:
            return None
        self._measured = (a.stamp_s, b.stamp_s)
        told = measured(pair, a, b)
        if frozen:
            unlike = f"the camera of {' and of '.join(frozen)} gives one picture again and again"
            told = replace(told, unlike=unlike)
        return told

    def _frozen(self, name: str) -> bool:
        kept = self._pictures[name]
        return len(kept) == _FROZEN and len({data for _, data, _ in kept}) == 1

    def _seen(self, name: str) -> Optional[EpipolarPicture]:
        for stamp_s, data, camera in reversed(self._pictures[name]):
            near = min(self._poses[name], key=lambda p: abs(p[0] - stamp_s), default=None)
            as_taken = camera or self._cameras.get(name)
            if as_taken is not None and near is not None and abs(near[0] - stamp_s) <= _POSE_S:
                return EpipolarPicture(stamp_s, data, as_taken, near[1], camera is None)
        return None

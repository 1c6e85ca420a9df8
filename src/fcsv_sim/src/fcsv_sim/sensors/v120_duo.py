# SPDX-License-Identifier: Apache-2.0
"""An OptiTrack V120 Duo on the ground and its software: rigid bodies of markers, seen by two
infrared cameras.

Every marker is triangulated with the noise of its centroids, so depth is as bad as it is for the
real one, and the pose is a rigid fit to them. Frame M ``mocap``: between the lenses, x out of them,
y left, z up (table 5.1: 47 x 43 degrees, 640 x 480, 120 frames a second). While a body is not seen
its last pose is streamed on, as Motive can.
"""

from dataclasses import dataclass
from typing import Dict, Optional, Tuple

import numpy as np
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_tracking.mocap.markers import MarkerRules

#: Four markers on top of a vehicle (m, body frame), in no symmetric pattern (thesis 5.2).
MARKERS_BODY_M = np.array(MarkerRules().layout_m)
FRAME_RATE_HZ = 120.0


@dataclass(frozen=True)
class V120DuoErrors:
    """What the real one does wrong; noise is per frame."""

    centroid_px: float = 0.03
    body_m: float = 0.0003  # constant: where the rigid body was put in the software
    body_deg: float = 0.04
    fov_deg: Tuple[float, float] = (47.0, 43.0)
    range_m: Tuple[float, float] = (0.3, 7.0)
    lens_distance_m: float = 0.24
    # between the vehicle's up axis and the way to the camera: markers sit on top
    steepest_deg: float = 140.0
    swaps_per_s: float = 0.0  # two markers taken for each other, for about 50 ms
    flips_per_s: float = 0.0  # the body taken for itself turned about its up axis, for up to 2 s
    streams_old_pose: bool = True


@dataclass(frozen=True)
class StreamedBody:
    """What is streamed of one body: its pose, and whether it is seen in this frame."""

    T_M_D: np.ndarray
    seen: bool
    true_pose: bool  # neither swapped nor flipped; for tests alone


class V120Duo:
    """frame() once per 1/120 s, with true poses; noise is seeded."""

    def __init__(self, errors: V120DuoErrors, T_world_mocap: np.ndarray, seed: int):
        self._errors = errors
        self._T_mocap_world = transforms.invert(T_world_mocap)
        self._random = np.random.default_rng([seed, 11])
        self._focal_px = 320.0 / np.tan(np.radians(errors.fov_deg[0] / 2.0))
        self._bodies: Dict[str, Tuple[np.ndarray, np.ndarray]] = {}
        self._last: Dict[str, StreamedBody] = {}
        self._wrong: Dict[str, Tuple[float, str, float]] = {}  # until, what, angle

    def frame(
        self, stamp_s: float, T_world_body: Dict[str, np.ndarray], hidden=()
    ) -> Dict[str, StreamedBody]:
        """What is streamed after a frame; bodies named in ``hidden`` stand behind something."""
        out = {}
        for name, T in T_world_body.items():
            sight = None if name in hidden else self._look(stamp_s, name, self._T_mocap_world @ T)
            if sight is None and self._errors.streams_old_pose and name in self._last:
                sight = StreamedBody(self._last[name].T_M_D, False, False)
            if sight is not None:
                out[name] = self._last[name] = sight
        return out

    def in_view(self, T_world_body: np.ndarray) -> bool:
        """Whether all markers are in both cameras' view and face them."""
        return self._visible(self._T_mocap_world @ T_world_body)

    def _visible(self, T_M_D: np.ndarray) -> bool:
        e = self._errors
        p = transforms.apply(T_M_D, MARKERS_BODY_M)
        range_m = float(np.linalg.norm(T_M_D[:3, 3]))
        if not e.range_m[0] < range_m < e.range_m[1] or np.any(p[:, 0] <= 0.0):
            return False
        half = np.tan(np.radians(np.array(e.fov_deg) / 2.0))
        for side in (-0.5, 0.5):
            if np.any(np.abs(p[:, 1] - side * e.lens_distance_m) > half[0] * p[:, 0]):
                return False
        up, view = T_M_D[:3, 2], T_M_D[:3, 3] / range_m
        return bool(
            np.all(np.abs(p[:, 2]) <= half[1] * p[:, 0])
            and -(up @ view) > np.cos(np.radians(e.steepest_deg))
        )

    def _look(self, stamp_s: float, name: str, T_M_D: np.ndarray) -> Optional[StreamedBody]:
        if not self._visible(T_M_D):
            return None
        known = self._bodies.setdefault(name, self._mounted())[0]
        seen = self._triangulated(transforms.apply(T_M_D, MARKERS_BODY_M))
        what, angle = self._wrong_now(stamp_s, name)
        if what == "swap":
            known = known[[1, 0, 2, 3]]
        T = _rigid_fit(known, seen)
        if what == "flip":
            T = T @ transforms.from_xyz_yaw([0.0, 0.0, 0.0], angle)
        return StreamedBody(T, True, not what)

    def _mounted(self) -> Tuple[np.ndarray, np.ndarray]:
        """Markers as the software believes them to sit in the body."""
        e = self._errors
        turn = Rotation.from_rotvec(self._random.normal(0.0, np.radians(e.body_deg), 3)).as_matrix()
        T = transforms.transform(turn, self._random.normal(0.0, e.body_m, 3))
        return transforms.apply(T, MARKERS_BODY_M), T

    def _triangulated(self, p_M: np.ndarray) -> np.ndarray:
        """Markers from noisy centroids of a parallel stereo pair; x is depth."""
        b, f, noise = self._errors.lens_distance_m, self._focal_px, self._errors.centroid_px
        left = f * (p_M[:, 1] - 0.5 * b) / p_M[:, 0] + self._random.normal(0.0, noise, len(p_M))
        right = f * (p_M[:, 1] + 0.5 * b) / p_M[:, 0] + self._random.normal(0.0, noise, len(p_M))
        up = f * p_M[:, 2] / p_M[:, 0] + self._random.normal(0.0, noise / np.sqrt(2.0), len(p_M))
        depth = f * b / (right - left)
        return np.stack([depth, depth * (left + right) / (2.0 * f), depth * up / f], axis=1)

    def _wrong_now(self, stamp_s: float, name: str) -> Tuple[str, float]:
        until, what, angle = self._wrong.get(name, (-np.inf, "", 0.0))
        if stamp_s < until:
            return what, angle
        draw, e = self._random.uniform(0.0, FRAME_RATE_HZ), self._errors
        if draw < e.swaps_per_s:
            self._wrong[name] = (stamp_s + 0.05, "swap", 0.0)
        elif draw < e.swaps_per_s + e.flips_per_s:
            angle = float(self._random.choice([np.pi, np.pi / 2, -np.pi / 2]))
            self._wrong[name] = (stamp_s + self._random.uniform(0.1, 2.0), "flip", angle)
        else:
            return "", 0.0
        return self._wrong[name][1:]


def _rigid_fit(known: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """T with seen = T known, least squares (Umeyama 1991)."""
    a, b = known.mean(axis=0), seen.mean(axis=0)
    U, _, Vt = np.linalg.svd((seen - b).T @ (known - a))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return transforms.transform(R, b - R @ a)

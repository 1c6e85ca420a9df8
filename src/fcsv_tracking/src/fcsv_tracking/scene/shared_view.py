# SPDX-License-Identifier: Apache-2.0
"""What two cameras both see: the common part of two pyramids."""

from typing import List, Tuple

import numpy as np

from fcsv_geometry import transforms

_ON_THE_PLANE_M = 1e-9


def shared_view(
    T_home_a: np.ndarray, T_home_b: np.ndarray, tangents: Tuple[float, float], reach_m: float
) -> List[np.ndarray]:
    """Faces of the room that both cameras see, each (K, 3) corners in home (m), in order; empty:
    they share none.

    ``T_home_a``, ``T_home_b``: 4x4, optical frames; ``tangents`` of half the field of view, across
    and down; ``reach_m``: depth at which both views are cut. The surface of what two convex bodies
    share is what lies of each one's surface within the other.

    >>> side_by_side = np.eye(4), transforms.transform(np.eye(3), np.array([2.0, 0.0, 0.0]))
    >>> faces = shared_view(*side_by_side, (0.5, 0.5), 10.0)
    >>> round(float(min(f[:, 2].min() for f in faces)), 9)
    2.0
    """
    poses = (T_home_a, T_home_b)
    faces = []
    for own, other in (poses, poses[::-1]):
        planes = _planes(other, tangents, reach_m)
        for face in _pyramid(own, tangents, reach_m):
            for normal, offset_m in planes:
                face = _clipped(face, normal, offset_m)
            if len(face) > 2:
                faces.append(face)
    return faces


def _pyramid(
    T_home_cam: np.ndarray, tangents: Tuple[float, float], reach_m: float
) -> List[np.ndarray]:
    """Its five faces."""
    ends = transforms.apply(T_home_cam, corners(tangents) * reach_m)
    apex = T_home_cam[:3, 3]
    return [*(np.stack([apex, ends[k], ends[(k + 1) % 4]]) for k in range(4)), ends]


def _planes(
    T_home_cam: np.ndarray, tangents: Tuple[float, float], reach_m: float
) -> List[Tuple[np.ndarray, float]]:
    """(normal n, offset d) of its faces; inside is n·p + d >= 0."""
    edges = corners(tangents)
    normals = [np.cross(edges[k], edges[(k + 1) % 4]) for k in range(4)]
    R, p = T_home_cam[:3, :3], T_home_cam[:3, 3]
    inward = [R @ (n / np.linalg.norm(n)) for n in normals]
    far = -R[:, 2]
    return [*((n, -float(n @ p)) for n in inward), (far, reach_m - float(far @ p))]


def corners(tangents: Tuple[float, float]) -> np.ndarray:
    """(4, 3) at depth 1, clockwise as the camera sees them; ``tangents`` of half the field of view,
    across and down."""
    w, h = tangents
    return np.array([[-w, -h, 1.0], [w, -h, 1.0], [w, h, 1.0], [-w, h, 1.0]])


def _clipped(face: np.ndarray, normal: np.ndarray, offset_m: float) -> np.ndarray:
    """The part of a convex face on a plane's inner side (Sutherland and Hodgman)."""
    if not len(face):
        return face
    inside_m = face @ normal + offset_m
    kept = []
    for k in range(len(face)):
        following = (k + 1) % len(face)
        here_m, there_m = inside_m[k], inside_m[following]
        if here_m >= -_ON_THE_PLANE_M:
            kept.append(face[k])
        if (here_m >= -_ON_THE_PLANE_M) != (there_m >= -_ON_THE_PLANE_M):
            kept.append(face[k] + here_m / (here_m - there_m) * (face[following] - face[k]))
    return np.array(kept).reshape(-1, 3)

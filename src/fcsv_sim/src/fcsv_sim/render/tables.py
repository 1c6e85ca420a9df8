# SPDX-License-Identifier: Apache-2.0
"""A town's arrays in the form in which the shading kernel reads them."""

import numpy as np

from fcsv_sim.render.layout import flat_data
from fcsv_sim.render.shade import Tables
from fcsv_sim.render.shadows import shadow_maps
from fcsv_sim.world.town import Town

_AT_ONCE = 4096


def build_tables(town: Town, cast) -> Tables:
    """``cast`` takes origins and directions (N,3) and gives distances to the town (N): for the
    shadows."""
    return Tables(
        _triangles(town), town.material, town.instance, flat_data(town), *shadow_maps(cast)
    )


def _triangles(town: Town) -> np.ndarray:
    """Normals, and the affine maps from world points to (u, v). Some thousand triangles at a time:
    they stay in the processor's cache."""
    parts = range(0, len(town.triangles), _AT_ONCE)
    return np.concatenate([_affine(town, town.triangles[i : i + _AT_ONCE]) for i in parts])


def _affine(town: Town, triangles: np.ndarray) -> np.ndarray:
    """Gradients by the dual basis of the edges."""
    corners = town.vertices[triangles].astype(np.float64)
    p0, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(e1, e2)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    uv = town.uv[triangles].astype(np.float64)
    a, b, c = (np.einsum("ij,ij->i", x, y) for x, y in ((e1, e1), (e1, e2), (e2, e2)))
    det = np.maximum(a * c - b * b, 1e-15)[:, None]
    dual1 = (c[:, None] * e1 - b[:, None] * e2) / det
    dual2 = (a[:, None] * e2 - b[:, None] * e1) / det
    out = np.zeros((len(p0), 12), np.float32)
    out[:, :3] = normal
    for k in range(2):
        gradient = (uv[:, 1, k] - uv[:, 0, k])[:, None] * dual1 + (uv[:, 2, k] - uv[:, 0, k])[
            :, None
        ] * dual2
        out[:, 4 + 4 * k : 7 + 4 * k] = gradient
        out[:, 7 + 4 * k] = uv[:, 0, k] - np.einsum("ij,ij->i", gradient, p0)
    return out

# SPDX-License-Identifier: Apache-2.0
"""The town as a mesh file."""

from pathlib import Path

import numpy as np

from fcsv_sim.world.town import Town


def write_ply(town: Town, path) -> None:
    """Binary PLY: vertices (m, world frame) and triangles. Written beside and moved: it is whole or
    not there."""
    write_mesh(
        town.vertices,
        town.triangles,
        path,
        f"simulated town, seed {town.seed}, metres, world frame",
    )


def write_mesh(vertices: np.ndarray, triangles: np.ndarray, path, comment: str) -> None:
    """Binary PLY of vertices (N, 3) m and triangles (M, 3); whole or not there."""
    path = Path(path)
    part = path.with_name(path.name + ".part")
    faces = np.empty(len(triangles), np.dtype([("count", "u1"), ("vertices", "<i4", 3)]))
    faces["count"], faces["vertices"] = 3, triangles
    header = (
        f"ply\nformat binary_little_endian 1.0\ncomment {comment}\n"
        f"element vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    try:
        with open(part, "wb") as file:
            file.write(header.encode("ascii"))
            file.write(vertices.astype("<f4").tobytes())
            file.write(faces.tobytes())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)

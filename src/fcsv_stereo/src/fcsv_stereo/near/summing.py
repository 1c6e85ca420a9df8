# SPDX-License-Identifier: Apache-2.0
"""The compiled loop that adds a depth frame to voxels."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def add_frame(
    xyz, flat, T_cam_home, intrinsics, depth, noise2, shared2, unit_m, sigmas, tsdf, weight, told
):
    """Add one frame to N voxels, in place.

    ``xyz`` (N,3) float32 m in home, ``flat`` (N,) where each voxel stands in the attributes;
    ``intrinsics`` fx, fy, cx, cy; ``depth`` (H,W) m, NaN where there is none, its variance of this
    frame alone ``noise2`` and the one that it shares with others ``shared2`` (m2). Distances are
    kept in units of ``unit_m`` and count to the larger of it and ``sigmas`` standard deviations
    behind a surface. They fade out from half of it on, so that a thin thing's far side is not
    pushed; faded from the surface on, noise would push it back, by 12 mm at 6 m.

    ``tsdf`` (V,1): mean of the distances, weighted by 1/(noise2 + shared2); ``weight`` (V,1): the
    sum of weights; ``told`` (V,3): variance of the mean by what is each frame's own (m2), which
    averages out; mean variance of what frames share, which does not; number of frames.
    """
    fx, fy, cx, cy = intrinsics
    height, width = depth.shape
    for i in range(len(flat)):
        x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        zc = T_cam_home[2, 0] * x + T_cam_home[2, 1] * y + T_cam_home[2, 2] * z + T_cam_home[2, 3]
        if zc <= 0.05:
            continue
        xc = T_cam_home[0, 0] * x + T_cam_home[0, 1] * y + T_cam_home[0, 2] * z + T_cam_home[0, 3]
        yc = T_cam_home[1, 0] * x + T_cam_home[1, 1] * y + T_cam_home[1, 2] * z + T_cam_home[1, 3]
        u, v = int(np.floor(fx * xc / zc + cx + 0.5)), int(np.floor(fy * yc / zc + cy + 0.5))
        if u < 0 or v < 0 or u >= width or v >= height:
            continue
        d = depth[v, u]
        if not np.isfinite(d):
            continue
        noise, shared = noise2[v, u], shared2[v, u]
        truncation = max(unit_m, sigmas * np.sqrt(noise))
        distance = d - zc
        if distance <= -truncation:
            continue
        w = 1.0 / (noise + shared + 1e-8)
        w *= min(1.0, 2.0 * (1.0 + distance / truncation))
        k = flat[i]
        before = weight[k, 0]
        after = before + w
        a, b = before / after, w / after
        tsdf[k, 0] = a * tsdf[k, 0] + b * (min(distance, truncation) / unit_m)
        weight[k, 0] = after
        told[k, 0] = a * a * told[k, 0] + b * b * noise
        told[k, 1] = a * told[k, 1] + b * shared
        told[k, 2] += 1.0

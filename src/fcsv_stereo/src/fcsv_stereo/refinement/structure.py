# SPDX-License-Identifier: Apache-2.0
"""Points as inverse depths along rays of the pictures where they were chosen, and their
elimination.

An inverse depth takes points at infinity, which fix rotations, as easily as near ones (Civera et
al. 2008). Poses are T_ref_cam; a step of a pose is [rotation, position] in the camera's own axes,
as GTSAM has it.
"""

from dataclasses import dataclass, replace
from typing import Dict, List, Tuple

import numpy as np

from fcsv_geometry import rotations, transforms

_KERNEL = 2.0  # width of the Cauchy kernel in standard deviations


@dataclass(frozen=True)
class Observations:
    """Point ``point[i]`` was measured in picture ``picture[i]`` along ``rays[i]`` (z = 1).

    Each point is anchored: ``anchor`` (N,) is the picture and ``anchor_rays`` (N, 3) the ray that
    defines it.
    """

    anchor: np.ndarray
    anchor_rays: np.ndarray
    point: np.ndarray
    picture: np.ndarray
    rays: np.ndarray

    def select(self, keep: np.ndarray) -> "Observations":
        """Only some of the observations; points stay numbered as they are."""
        return replace(
            self, point=self.point[keep], picture=self.picture[keep], rays=self.rays[keep]
        )

    def groups(self) -> List[Tuple[int, int, np.ndarray]]:
        """(anchor picture, measuring picture, indices of its observations)."""
        anchor = self.anchor[self.point]
        pairs = sorted(set(zip(anchor.tolist(), self.picture.tolist())))
        return [(a, k, np.flatnonzero((anchor == a) & (self.picture == k))) for a, k in pairs]


@dataclass
class Linearised:
    """Residuals (M, 2) px and their derivatives; ``by_group`` holds those to the two poses (m, 2,
    6) and to focal."""

    residual: np.ndarray
    to_rho: np.ndarray
    by_group: List[Tuple[np.ndarray, np.ndarray, np.ndarray]]


class Structure:
    """All points of an adjustment, whose inverse depths follow the poses."""

    def __init__(
        self, observations: Observations, rho: np.ndarray, focals_px: Dict[int, float], noise_px
    ):
        """``rho`` (N,) 1/m to start from; focals and noise by picture."""
        self.observations = observations
        self.groups = observations.groups()
        self.rho = rho.copy()
        self._focal = np.array([focals_px[k] for k in observations.picture.tolist()])
        self._sigma = np.array([noise_px[k] for k in observations.picture.tolist()])

    def linearise(
        self, poses: Dict[int, np.ndarray], scale: float = 1.0, poses_too: bool = True
    ) -> Linearised:
        """Linearises at the present inverse depths; ``scale`` multiplies every focal length."""
        o = self.observations
        out = Linearised(np.empty((len(o.point), 2)), np.empty((len(o.point), 2)), [])
        undo = np.array([1.0 / scale, 1.0 / scale, 1.0])
        for a, k, of in self.groups:
            T = transforms.invert(poses[a]) @ poses[k]
            R, t = T[:3, :3], T[:3, 3]
            rho = self.rho[o.point[of]]
            ray = o.anchor_rays[o.point[of]] * undo
            p = (ray - rho[:, None] * t) @ R
            z = np.where(p[:, 2] > 1e-3, p[:, 2], 1e-3)
            xy = p[:, :2] / z[:, None]
            f = self._focal[of]
            out.residual[of] = (scale * xy - o.rays[of, :2]) * f[:, None]
            along = -(t @ R)
            out.to_rho[of] = (along[:2] - xy * along[2]) * (scale * f / z)[:, None]
            if poses_too:
                out.by_group.append(_derivatives(R, ray, rho, p, xy, scale * f / z, f, scale))
        return out

    def weights(self, residual: np.ndarray) -> Tuple[np.ndarray, float]:
        """Weights (M,) of the Cauchy kernel in 1/px^2 and twice its cost."""
        square = _dot(residual, residual) / self._sigma**2 / _KERNEL**2
        return 1.0 / (1.0 + square) / self._sigma**2, float(_KERNEL**2 * np.log1p(square).sum())

    def settle(self, poses: Dict[int, np.ndarray], scale: float = 1.0, rounds: int = 3) -> None:
        """Inverse depths to their optimum under poses."""
        count = len(self.rho)
        for _ in range(rounds):
            at = self.linearise(poses, scale, poses_too=False)
            weight, _ = self.weights(at.residual)
            H = self._sum(_dot(at.to_rho, at.to_rho) * weight, count)
            g = self._sum(_dot(at.to_rho, at.residual) * weight, count)
            self.rho = self.rho - g / np.maximum(H, 1e-12)

    def reduced(
        self, poses: Dict[int, np.ndarray], scale: float, order: List[int], with_focal: bool
    ):
        """Normal equations of the poses in ``order`` (and the focal scale last), points eliminated
        by Schur.

        Returns H (6n, 6n) or one more, gradient, twice the robust cost, at the points' optimum.
        """
        self.settle(poses, scale)
        at = self.linearise(poses, scale)
        weight, cost = self.weights(at.residual)
        size = 6 * len(order) + int(with_focal)
        place = {k: slice(6 * i, 6 * i + 6) for i, k in enumerate(order)}
        if with_focal:
            place["focal"] = slice(size - 1, size)
        parts = [
            [(place[key], J) for key, J in zip((a, k, "focal"), blocks) if key in place]
            for (a, k, _), blocks in zip(self.groups, at.by_group)
        ]
        return (*self.eliminated(at, weight, parts, size), cost)

    def eliminated(
        self, at: Linearised, weight: np.ndarray, parts, size: int
    ) -> Tuple[np.ndarray, np.ndarray]:
        """H (size, size) and gradient with the points eliminated by Schur; ``parts``: for each
        group its derivatives (m, 2, k) and the slice of the variables that they are to."""
        n = len(self.rho)
        H, g, coupling = np.zeros((size, size)), np.zeros(size), np.zeros((n, size))
        for (_, _, of), used in zip(self.groups, parts):
            J = np.concatenate([J for _, J in used], axis=2) if used else np.empty((len(of), 2, 0))
            columns = (
                np.concatenate([np.arange(s.start, s.stop) for s, _ in used])
                if used
                else np.empty(0, int)
            )
            weighted = J * weight[of][:, None, None]
            flat = J.reshape(2 * len(of), -1)
            H[np.ix_(columns, columns)] += weighted.reshape(flat.shape).T @ flat
            g[columns] += (weighted * at.residual[of][:, :, None]).sum((0, 1))
            rows = (weighted * at.to_rho[of][:, :, None]).sum(1)
            coupling[self.observations.point[of][:, None], columns] += rows
        own = np.sqrt(np.maximum(self._sum(_dot(at.to_rho, at.to_rho) * weight, n), 1e-12))
        left = self._sum(_dot(at.to_rho, at.residual) * weight, n) / own
        coupling /= own[:, None]
        return H - coupling.T @ coupling, g - coupling.T @ left

    def _sum(self, values, count):
        return np.bincount(self.observations.point, values, count)


def _derivatives(R, ray, rho, p, xy, gain, f, scale):
    """Gives the derivatives of the residual to the anchor's pose, the measuring picture's pose (m,
    2, 6) and the focal scale (m, 2, 1)."""

    def projected(of_p):
        """(m, 2, k) from the derivatives of the point p in the camera (m, 3, k)."""
        return (of_p[:, :2] - xy[:, :, None] * of_p[:, 2:]) * gain[:, None, None]

    turned_ray = np.tensordot(rotations.skews(ray), -R, axes=(1, 0)).transpose(0, 2, 1)
    of_k = np.concatenate([rotations.skews(p), -rho[:, None, None] * np.eye(3)], axis=2)
    of_a = np.concatenate([turned_ray, rho[:, None, None] * R.T], axis=2)
    of_focal = (
        projected((-(ray * [1.0, 1.0, 0.0] / scale) @ R)[:, :, None])
        + (xy * f[:, None])[:, :, None]
    )
    return projected(of_a), projected(of_k), of_focal


def _dot(a, b):
    """Row by row; sums along a short axis are slow."""
    return np.einsum("ij,ij->i", a, b)

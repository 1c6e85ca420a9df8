# SPDX-License-Identifier: Apache-2.0
"""Views and the cloud of a drawn site against what was drawn."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List

import numpy as np
from scipy.spatial import cKDTree

from fcsv_sim.sensors.photo_site import TRUTH
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.document import Site
from fcsv_stereo.survey.views.view import View
from harness import rms

_ONE_SURFACE = 1.03  # ratio of the depths of four pixels
#: Bands of the distance (m) to the view that stands nearest, and every so-manieth point of a view.
BANDS_M = ((0.0, 60.0), (60.0, 130.0), (130.0, 400.0))
_SAMPLE = 7


@dataclass(frozen=True)
class TrueView:
    """``T_world_cam`` 4x4 and ``depth`` (H,W) m, as drawn."""

    T_world_cam: np.ndarray
    depth: np.ndarray

    @classmethod
    def of(cls, folder: Path) -> "TrueView":
        document = json.loads((folder / TRUTH).read_text())
        return cls(np.array(document["T_world_cam"]), np.load(folder / "true_depth.npy"))


def points_of(view: View, S_site_cam, true: TrueView):
    """(N,3) m in the site, and in the world by the true depth of the same pixels."""
    points, pixels = rays_of(view, np.isfinite(true.depth))
    T = true.T_world_cam
    true_points = points * (true.depth[pixels] / view.depth[pixels])[:, None]
    return similarity.apply(S_site_cam, points), true_points @ T[:3, :3].T + T[:3, 3]


def rays_of(view: View, where=True):
    """(N,3) m, points of a view's camera at its known pixels ``where`` (H,W), and their rows and
    columns."""
    rows, columns = np.nonzero(view.known & where)
    c = view.camera
    ray = np.column_stack([(columns - c.cx) / c.fx, (rows - c.cy) / c.fy, np.ones(len(rows))])
    return ray * view.depth[rows, columns][:, None], (rows, columns)


def true_scale(view: View, true: TrueView) -> float:
    """Metres of the world per metre of the view's map."""
    both = view.known & np.isfinite(true.depth)
    return float(np.median(true.depth[both] / view.depth[both]))


def figures(
    views: List[View], poses: Dict[str, object], truth: Dict[str, TrueView]
) -> Dict[str, float]:
    """Errors of views at ``poses`` (S_site_cam by name); places and points after the similarity
    that fits best."""
    names = [v.name for v in views]
    off = np.array([np.log(true_scale(v, truth[v.name]) / poses[v.name].scale()) for v in views])
    places = np.array([similarity.place(poses[n]) for n in names])
    true_places = np.array([truth[n].T_world_cam[:3, 3] for n in names])
    M = similarity.fit(true_places[None], places[None])[0]
    at = similarity.of_matrix(M)
    turns = [
        _yaw_deg(similarity.rotation(at) @ similarity.rotation(poses[n]), truth[n].T_world_cam)
        for n in names
    ]
    error, distance = [], []
    for v in views:
        told, true = (p[::_SAMPLE] for p in points_of(v, poses[v.name], truth[v.name]))
        error.append(np.linalg.norm(similarity.apply(at, told) - true, axis=1))
        distance.append(cKDTree(true_places).query(true)[0])
    error, distance = np.concatenate(error), np.concatenate(distance)
    return {
        "scales against each other, rms (%)": 100 * float(np.std(off)),
        "common scale (%)": 100 * abs(float(np.mean(off))),
        "places, rms (m)": rms(np.linalg.norm(similarity.apply(at, places) - true_places, axis=1)),
        "yaw, rms (deg)": rms(np.array(turns) - np.mean(turns)),
        "points: median error (m)": float(np.median(error)),
        "points: within 3 % of the nearest view's distance (%)": _within(0.03, error, distance),
        "within 10 % (%)": _within(0.1, error, distance),
        **_by_band(error, distance),
    }


def _within(share: float, error: np.ndarray, distance: np.ndarray) -> float:
    return 100 * float((error <= share * distance).mean())


def _by_band(error: np.ndarray, distance: np.ndarray) -> Dict[str, float]:
    found = {}
    for low, high in BANDS_M:
        of = (distance > low) & (distance <= high)
        if of.any():
            found[f"{low:.0f} to {high:.0f} m: median error (m)"] = float(np.median(error[of]))
            found[f"{low:.0f} to {high:.0f} m: within 10 % (%)"] = _within(
                0.1, error[of], distance[of]
            )
    return found


def _yaw_deg(R: np.ndarray, T_world_cam: np.ndarray) -> float:
    D = R @ T_world_cam[:3, :3].T
    return float(np.degrees(np.arctan2(D[1, 0] - D[0, 1], D[0, 0] + D[1, 1])))


def surface_at(depth: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(N,) m, the true depth at ``uv`` (N,2) px between four pixels of one surface; NaN elsewhere,
    at edges of surfaces, too. The nearest of neighbouring pixels instead would forgive a pixel's
    step of depth, which on slanting ground is a sigma."""
    at = np.floor(uv).astype(int)
    inside = (at >= 0).all(axis=1) & (at < np.array(depth.shape[::-1]) - 1).all(axis=1)
    column, row = np.where(inside[:, None], at, 0).T
    across, down = (uv - at).T
    w = [1.0 / depth[row + dv, column + du] for dv in (0, 1) for du in (0, 1)]
    upper, lower = (w[i] * (1.0 - across) + w[i + 1] * across for i in (0, 2))
    with np.errstate(invalid="ignore"):
        one = inside & (np.max(w, axis=0) < _ONE_SURFACE * np.min(w, axis=0))
    return np.where(one, 1.0 / (upper * (1.0 - down) + lower * down), np.nan)


def cloud_figures(site: Site, truth: Dict[str, TrueView]) -> Dict[str, float]:
    """Of the cloud: how wrong what two or more views see is, and what of it its sigma covers; after
    the similarity that fits the points best. A point is compared with the true surface on its own
    view's ray."""
    placed = site.adjusted.placed
    views = [v.load() for v in site.views if v.name in placed]
    pairs = [points_of(v, placed[v.name].S_site_cam, truth[v.name]) for v in views]
    told, true = (np.concatenate([p[i][::50] for p in pairs]) for i in (0, 1))
    good = np.linalg.norm(told - true, axis=1) < np.median(np.linalg.norm(told - true, axis=1)) * 2
    at = similarity.of_matrix(similarity.fit(true[None, good], told[None, good])[0])
    error, exact, sigma, depth, several = [], [], [], [], []
    for v in views:
        cloud, t = site.joined[v.name].load(), truth[v.name]
        p = similarity.apply(at, cloud.points_home_m.astype(float) + site.origin_m)
        in_cam = (p - t.T_world_cam[:3, 3]) @ t.T_world_cam[:3, :3]
        z = in_cam[:, 2]
        uv = in_cam[:, :2] / z[:, None] * [v.camera.fx, v.camera.fy] + [v.camera.cx, v.camera.cy]
        exact.append(np.abs(surface_at(t.depth, uv) - z))
        pixel = np.rint(uv).astype(int)
        inside = (pixel > 0).all(axis=1) & (pixel < np.array(t.depth.shape[::-1]) - 1).all(axis=1)
        exact[-1] = exact[-1][inside]
        steps = [(dv, du) for dv in (-1, 0, 1) for du in (-1, 0, 1)]
        about = np.stack([t.depth[pixel[inside, 1] + v, pixel[inside, 0] + u] for v, u in steps])
        off = np.where(np.isfinite(about), np.abs(about - z[inside]), 1e3)
        error.append(np.min(off, axis=0))
        sigma.append(cloud.sigma_m[inside])
        depth.append(z[inside])
        several.append(cloud.baseline_index[inside] > 1)
    error, exact, sigma, depth, several = map(np.concatenate, (error, exact, sigma, depth, several))
    wrong = error > 0.1 * depth
    told = several & np.isfinite(exact)
    e, s, d = exact[told], sigma[told], depth[told]
    return {
        "points": site.count,
        "seen by two or more (%)": 100 * float(several.mean()),
        "of these wrong: beyond 10 % (%)": 100 * float(wrong[several].mean()),
        "of these within sigma (68 %)": 100 * float((e <= s).mean()),
        "of these within 1.96 sigma (95 %)": 100 * float((e <= 1.96 * s).mean()),
        "of these median sigma / depth (%)": 100 * float(np.median(s / d)),
        **{
            f"of these within sigma, {low:.0f} to {high:.0f} m (%)": 100
            * float((e <= s)[(d > low) & (d <= high)].mean())
            for low, high in BANDS_M
        },
        "of others wrong: beyond 10 % (%)": 100 * float(wrong[~several].mean()),
    }


def normalised(site: Site, truth: Dict[str, TrueView]) -> float:
    """Mean squared edge error over its covariance, per degree of freedom (1: honest), against the
    true similarities."""
    import gtsam

    by_name = {v.name: v.load() for v in site.views}
    true = {
        n: similarity.of_pose(t.T_world_cam, true_scale(by_name[n], t)) for n, t in truth.items()
    }
    out = []
    for e in (e for e in site.adjusted.edges if e.kept):
        off = gtsam.Similarity3.Logmap(
            e.S_a_b.inverse().compose(similarity.between(true[e.a], true[e.b]))
        )
        out.append(off @ np.linalg.solve(e.covariance, off) / similarity.TANGENT)
    return float(np.mean(out)) if out else float("nan")

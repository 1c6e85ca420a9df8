# SPDX-License-Identifier: Apache-2.0
"""Statements about where a drawn site is on the earth: control points and GPS; what comes of
them."""

from dataclasses import replace
from pathlib import Path
from typing import Dict, List, Sequence

import numpy as np

from bench_survey.truth import TrueView, true_scale
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.posed import colmap
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.document import Site
from fcsv_stereo.survey.placing import earth
from fcsv_stereo.survey.placing.adjust import Adjusted
from fcsv_stereo.survey.placing.earth import EarthFrame
from fcsv_stereo.survey.placing.georeference import World, WorldOptions, place, projected
from fcsv_stereo.survey.views.view_file import ViewFile
from harness import rms

#: Where the drawn world's origin is on the earth; farthest control point from a view; errors of
#: coordinates and of marks; of GPS.
_MIDDLE = np.array([[13.4, 52.5, 0.0]])
_FARTHEST_M, _CONTROL_M, _MARK_PX = 110.0, 0.02, 0.5
_GPS_M = 2.0


def world_frame() -> EarthFrame:
    """The frame whose axes are those of the drawn world."""
    return EarthFrame.about(_MIDDLE, None)


def write_control(folders: List[Path], path: Path, seed: int, count: int) -> None:
    """gcp_list.txt of ``count`` places on surfaces, each marked in all views that truly see it:
    coordinates good to 2 cm per axis, marks to half a pixel."""
    random, frame = np.random.default_rng([seed, 99]), world_frame()
    truth = {f.name: TrueView.of(f) for f in folders}
    cameras = {f.name: colmap.read_cameras(f / "cameras.txt")[1] for f in folders}
    lines, points = [earth.name_of(frame.crs)], 0
    while points < count:
        name = folders[int(random.integers(len(folders)))].name
        t, c = truth[name], cameras[name]
        u, v = random.integers(40, c.width - 40), random.integers(40, c.height - 40)
        near = t.depth[v - 2 : v + 3, u - 2 : u + 3]
        if not (np.isfinite(near).all() and near.max() < _FARTHEST_M and np.ptp(near) < 1.0):
            continue
        ray = np.array([(u - c.cx) / c.fx, (v - c.cy) / c.fy, 1.0])
        p = t.T_world_cam[:3, :3] @ ray * t.depth[v, u] + t.T_world_cam[:3, 3]
        marks = [(n, _mark(p, truth[n], cameras[n])) for n in truth]
        marks = [(n, m) for n, m in marks if m is not None]
        if len(marks) < 2:
            continue
        points += 1
        at = frame.to_projected((p + random.normal(0.0, _CONTROL_M, 3))[None])[0]
        for n, m in marks:
            m = m + random.normal(0.0, _MARK_PX, 2)
            lines.append(
                f"{at[0]:.4f} {at[1]:.4f} {at[2]:.4f} {m[0]:.2f} {m[1]:.2f} {n}/00.png point{points}"
            )
    path.write_text("\n".join(lines) + "\n")


def _mark(p: np.ndarray, true: TrueView, camera):
    """(2,) px where a view truly sees a place; None where it does not."""
    in_cam = (p - true.T_world_cam[:3, 3]) @ true.T_world_cam[:3, :3]
    if in_cam[2] < 1.0:
        return None
    uv = in_cam[:2] / in_cam[2] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    u, v = np.rint(uv).astype(int)
    if not (5 <= u < camera.width - 5 and 5 <= v < camera.height - 5):
        return None
    return uv if abs(true.depth[v, u] - in_cam[2]) < 0.01 * in_cam[2] else None


def control_figures(site: Site, truth: Dict[str, TrueView]) -> Dict[str, float]:
    """Of a site with control points: check points, and places and scales against the truth, without
    any fit."""
    checks = [p for p in site.world.fit.points if p.check and p.views]
    off = np.array([p.off_m for p in checks])
    sigma = np.array([p.sigma_m for p in checks])
    return {
        "control points, check points": f"{len(site.world.fit.points) - len(checks)}, {len(checks)}",
        "check points, rms (m)": rms(np.linalg.norm(off, axis=1)),
        "check points: axes within 1.96 sigma (%)": 100
        * float((np.abs(off) < 1.96 * sigma).mean()),
        **scale_figures(site.views, site.adjusted, site.world, truth),
    }


def with_gps(views: List[ViewFile], truth: Dict[str, TrueView], seed: int) -> List[ViewFile]:
    """The views, each with a fix of GPS of its own that is off by 2 m per axis and says so."""
    random, frame = np.random.default_rng([seed, 98]), world_frame()
    found = []
    for v in views:
        at = truth[v.name].T_world_cam[:3, 3] + random.normal(0.0, _GPS_M, 3)
        longitude, latitude, height_m = earth.to_geographic(
            frame.crs, frame.to_projected(at[None])
        )[0]
        fix = Gps(float(latitude), float(longitude), float(height_m), _GPS_M, _GPS_M)
        found.append(replace(v, gps=fix, gps_cam_m=np.zeros(3)))
    return found


def gps_figures(site: Site, truth: Dict[str, TrueView], seed: int) -> Dict[str, float]:
    """Of the site's views where each has a fix of GPS; nothing is joined anew."""
    given = WorldOptions().read()
    adjusted, frame, world = place(with_gps(site.views, truth, seed), site.adjusted.edges, given)
    return scale_figures(site.views, projected(adjusted, frame), world, truth)


def scale_figures(
    views: Sequence[ViewFile], adjusted: Adjusted, world: World, truth: Dict[str, TrueView]
) -> Dict[str, float]:
    """Places and scales of views on the earth against the truth, without any fit."""
    by_name, frame = {v.name: v.load() for v in views}, world_frame()
    places, scales = [], []
    for n, p in adjusted.placed.items():
        T = truth[n].T_world_cam
        at = frame.to_projected(T[:3, 3][None])[0]
        places.append(np.linalg.norm(similarity.place(p.S_site_cam) - at))
        stretch = np.cbrt(np.linalg.det(frame.turn_at(T[:3, 3])))
        scales.append(np.log(true_scale(by_name[n], truth[n]) * stretch / p.scale))
    return {
        "places in the world, rms (m)": rms(places),
        "stated sigma of the site's place (m)": world.fit.sigma_m,
        "common scale in the world (%)": 100 * abs(float(np.mean(scales))),
        "its stated sigma (%)": 100 * world.fit.sigma_scale,
    }

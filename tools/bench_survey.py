# SPDX-License-Identifier: Apache-2.0
"""Draws a site with the errors of trackers, joins its views, compares with truth; the table of
docs/lab/survey.md.

python tools/bench_survey.py [--world village] [--seed 1] [--views 6] [--step-deg 15] [--radius-m
90] [-o out/site] A site that was drawn in OUT/drawn is taken as it is.
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List

import numpy as np

from fcsv_sim.sensors.photo_site import TRUTH, draw_site, ring
from fcsv_sim.world.town import WORLDS, Town
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.document import Site
from fcsv_stereo.survey.survey import run
from fcsv_stereo.survey.views import View

_HEAD = ("figure", "as flown", "joined")


@dataclass(frozen=True)
class TrueView:
    """``T_world_cam`` 4x4 and ``depth`` (H,W) m, as drawn."""

    T_world_cam: np.ndarray
    depth: np.ndarray

    @classmethod
    def of(cls, folder: Path) -> "TrueView":
        document = json.loads((folder / TRUTH).read_text())
        return cls(np.array(document["T_world_cam"]), np.load(folder / "true_depth.npy"))


def rms(values) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def points_of(view: View, S_site_cam, true: TrueView):
    """(N,3) m in the site, and in the world by the true depth of the same pixels."""
    rows, columns = np.nonzero(view.known & np.isfinite(true.depth))
    c = view.camera
    ray = np.column_stack([(columns - c.cx) / c.fx, (rows - c.cy) / c.fy, np.ones(len(rows))])
    depth, true_depth = view.depth[rows, columns], true.depth[rows, columns]
    T = true.T_world_cam
    return similarity.apply(S_site_cam, ray * depth[:, None]), ray * true_depth[:, None] @ T[
        :3, :3
    ].T + T[:3, 3]


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
        told, true = points_of(v, poses[v.name], truth[v.name])
        error.append(np.linalg.norm(similarity.apply(at, told) - true, axis=1))
        distance.append(np.linalg.norm(true - truth[v.name].T_world_cam[:3, 3], axis=1))
    error, distance = np.concatenate(error), np.concatenate(distance)
    return {
        "scales against each other, rms (%)": 100 * float(np.std(off)),
        "common scale (%)": 100 * abs(float(np.mean(off))),
        "places, rms (m)": rms(np.linalg.norm(similarity.apply(at, places) - true_places, axis=1)),
        "yaw, rms (deg)": rms(np.array(turns) - np.mean(turns)),
        "points: median error (m)": float(np.median(error)),
        "points: within 3 % (%)": 100 * float((error <= 0.03 * distance).mean()),
        "points: within 10 % (%)": 100 * float((error <= 0.1 * distance).mean()),
    }


def _yaw_deg(R: np.ndarray, T_world_cam: np.ndarray) -> float:
    D = R @ T_world_cam[:3, :3].T
    return float(np.degrees(np.arctan2(D[1, 0] - D[0, 1], D[0, 0] + D[1, 1])))


def cloud_figures(site: Site, truth: Dict[str, TrueView]) -> Dict[str, float]:
    """Of the cloud: how wrong what two or more views see is, and what of it its sigma covers; after
    the similarity that fits the points best. A point is compared with the true surface on its own
    view's ray."""
    placed = site.adjusted.placed
    views = [v for v in site.views if v.name in placed]
    pairs = [points_of(v, placed[v.name].S_site_cam, truth[v.name]) for v in views]
    told, true = (np.concatenate([p[i][::50] for p in pairs]) for i in (0, 1))
    good = np.linalg.norm(told - true, axis=1) < np.median(np.linalg.norm(told - true, axis=1)) * 2
    at = similarity.of_matrix(similarity.fit(true[None, good], told[None, good])[0])
    error, sigma, depth, several = [], [], [], []
    for v in views:
        cloud, t = site.joined[v.name].cloud, truth[v.name]
        p = similarity.apply(at, cloud.points_home_m.astype(float) + site.origin_m)
        in_cam = (p - t.T_world_cam[:3, 3]) @ t.T_world_cam[:3, :3]
        z = in_cam[:, 2]
        uv = np.rint(
            in_cam[:, :2] / z[:, None] * [v.camera.fx, v.camera.fy] + [v.camera.cx, v.camera.cy]
        ).astype(int)
        inside = (uv > 0).all(axis=1) & (uv < np.array(t.depth.shape[::-1]) - 1).all(axis=1)
        at_pixels = np.stack(
            [
                t.depth[uv[inside, 1] + dv, uv[inside, 0] + du]
                for dv in (-1, 0, 1)
                for du in (-1, 0, 1)
            ]
        )
        nearest = np.nanmin(
            np.where(np.isfinite(at_pixels), np.abs(at_pixels - z[inside]), 1e3), axis=0
        )
        error.append(nearest)
        sigma.append(cloud.sigma_m[inside])
        depth.append(z[inside])
        several.append(cloud.baseline_index[inside] > 1)
    error, sigma, depth, several = map(np.concatenate, (error, sigma, depth, several))
    e, s, d = error[several], sigma[several], depth[several]
    return {
        "points": len(site.cloud),
        "seen by two or more (%)": 100 * float(several.mean()),
        "of these wrong: beyond 10 % (%)": 100 * float((e > 0.1 * d).mean()),
        "of these within sigma (68 %)": 100 * float((e <= s).mean()),
        "of these within 1.96 sigma (95 %)": 100 * float((e <= 1.96 * s).mean()),
        "of these median sigma / depth (%)": 100 * float(np.median(s / d)),
        "of others wrong: beyond 10 % (%)": 100 * float((error > 0.1 * depth)[~several].mean()),
    }


def normalised(site: Site, truth: Dict[str, TrueView]) -> float:
    """Mean squared edge error over its covariance, per degree of freedom (1: honest), against the
    true similarities."""
    import gtsam

    by_name = {v.name: v for v in site.views}
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


def main(argv=None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--world", choices=list(WORLDS), default="village")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--views", type=int, default=6)
    parser.add_argument(
        "--step-deg", type=float, default=15.0, help="from each view to the next on the circle"
    )
    parser.add_argument("--radius-m", type=float, default=90.0)
    parser.add_argument(
        "--height-m", type=float, default=25.0, help="above the ground in the middle"
    )
    parser.add_argument("--middle-m", type=float, default=130.0, help="x of the circle's middle")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/bench_survey"))
    args = parser.parse_args(argv)
    drawn = args.out / "drawn"
    if not drawn.is_dir():
        town = Town.generate(args.seed, args.world)
        height_m = float(town.plan.height(args.middle_m, 0.0)) + args.height_m
        step_rad = np.radians(args.step_deg)
        draw_site(
            town,
            ring(args.views, (args.middle_m, 0.0), args.radius_m, step_rad, height_m),
            drawn,
            args.seed,
        )
    folders = sorted(drawn.glob("view*"))
    started = time.perf_counter()
    site = run(folders, args.out / "site")
    took_s = time.perf_counter() - started
    truth = {f.name: TrueView.of(f) for f in folders}
    placed = site.adjusted.placed
    views = [v for v in site.views if v.name in placed]
    flown = figures(views, {v.name: similarity.of_pose(v.prior.T_site_cam) for v in views}, truth)
    joined = figures(views, {n: p.S_site_cam for n, p in placed.items()}, truth)
    print(
        f"{args.world} {args.seed}, {len(placed)} of {len(folders)} views, {took_s:.0f} s with what was there"
    )
    print("| " + " | ".join(_HEAD) + " |\n" + "|---" * len(_HEAD) + "|")
    for name in flown:
        print(f"| {name} | {flown[name]:.2f} | {joined[name]:.2f} |")
    kept = sum(e.kept for e in site.adjusted.edges)
    print(f"| edges kept | | {kept} of {len(site.adjusted.edges)} |")
    print(
        f"| edges: squared error over covariance, per degree of freedom | | {normalised(site, truth):.2f} |"
    )
    for name, value in cloud_figures(site, truth).items():
        print(f"| {name} | | {value:,.2f} |")
    if site.adjusted.loops:
        print(
            f"| worst loop closes to (m) | | {max(loop.closing_m for loop in site.adjusted.loops):.2f} |"
        )
    for m in site.missing:
        print(f"missing {m.name}: {m.reason}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

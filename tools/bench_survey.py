# SPDX-License-Identifier: Apache-2.0
"""Draws a site with the errors of trackers, joins its views, compares with truth; the table of
docs/lab/survey.md.

python tools/bench_survey.py [--world village] [--seed 1] [--views 6] [--step-deg 15] [--radius-m
90] [--control 5] [--kills 0] [--small]
[--workers 2] [-o out/site] Views that were drawn in OUT/drawn are taken as they are; what was
stopped goes on.
"""

import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List

import numpy as np

from fcsv_sim.sensors.photo_site import TRUTH, draw_site, ring
from fcsv_sim.world.town import WORLDS, Town
from fcsv_stereo.posed import colmap
from fcsv_stereo.survey import earth, similarity
from fcsv_stereo.survey.document import Site
from fcsv_stereo.survey.earth import EarthFrame
from fcsv_stereo.survey.georeference import WorldOptions
from fcsv_stereo.survey.survey import FILES, run
from fcsv_stereo.survey.views import View
from fcsv_stereo.survey.work import WorkOptions

_HEAD = ("figure", "as flown", "joined")
_ONE_SURFACE = 1.03  # ratio of the depths of four pixels
#: Where the drawn world's origin is on the earth; farthest control point from a view; errors of
#: coordinates and of marks.
_MIDDLE = np.array([[13.4, 52.5, 0.0]])
_FARTHEST_M, _CONTROL_M, _MARK_PX = 110.0, 0.02, 0.5


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
    views = [v for v in site.views if v.name in placed]
    pairs = [points_of(v, placed[v.name].S_site_cam, truth[v.name]) for v in views]
    told, true = (np.concatenate([p[i][::50] for p in pairs]) for i in (0, 1))
    good = np.linalg.norm(told - true, axis=1) < np.median(np.linalg.norm(told - true, axis=1)) * 2
    at = similarity.of_matrix(similarity.fit(true[None, good], told[None, good])[0])
    error, exact, sigma, depth, several = [], [], [], [], []
    for v in views:
        cloud, t = site.joined[v.name].cloud, truth[v.name]
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
        "points": len(site.cloud),
        "seen by two or more (%)": 100 * float(several.mean()),
        "of these wrong: beyond 10 % (%)": 100 * float(wrong[several].mean()),
        "of these within sigma (68 %)": 100 * float((e <= s).mean()),
        "of these within 1.96 sigma (95 %)": 100 * float((e <= 1.96 * s).mean()),
        "of these median sigma / depth (%)": 100 * float(np.median(s / d)),
        **{
            f"of these within sigma, {low} to {high} m (%)": 100
            * float((e <= s)[(d > low) & (d <= high)].mean())
            for low, high in ((0, 60), (60, 130), (130, 400))
        },
        "of others wrong: beyond 10 % (%)": 100 * float(wrong[~several].mean()),
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


def write_control(folders: List[Path], path: Path, seed: int, count: int) -> EarthFrame:
    """gcp_list.txt of ``count`` places on surfaces, each marked in all views that truly see it:
    coordinates good to 2 cm per axis, marks to half a pixel. The world's axes are those of the
    frame that is given back."""
    random, frame = np.random.default_rng([seed, 99]), EarthFrame.about(_MIDDLE, None)
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
    return frame


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


def control_figures(site: Site, truth: Dict[str, TrueView], frame: EarthFrame) -> Dict[str, float]:
    """Of a site with control points: check points, and places and scales against the truth, without
    any fit."""
    checks = [p for p in site.world.fit.points if p.check and p.views]
    off = np.array([p.off_m for p in checks])
    sigma = np.array([p.sigma_m for p in checks])
    views = {v.name: v for v in site.views}
    places, scales = [], []
    for n, p in site.adjusted.placed.items():
        T = truth[n].T_world_cam
        at = frame.to_projected(T[:3, 3][None])[0]
        places.append(np.linalg.norm(similarity.place(p.S_site_cam) - at))
        stretch = np.cbrt(np.linalg.det(frame.turn_at(T[:3, 3])))
        scales.append(np.log(true_scale(views[n], truth[n]) * stretch / p.scale))
    return {
        "control points, check points": f"{len(site.world.fit.points) - len(checks)}, {len(checks)}",
        "check points, rms (m)": rms(np.linalg.norm(off, axis=1)),
        "check points: axes within 1.96 sigma (%)": 100
        * float((np.abs(off) < 1.96 * sigma).mean()),
        "places in the world, rms (m)": rms(places),
        "stated sigma of the site's place (m)": site.world.fit.sigma_m,
        "common scale in the world (%)": 100 * abs(float(np.mean(scales))),
        "its stated sigma (%)": 100 * site.world.fit.sigma_scale,
    }


_COMMAND = "import sys; from fcsv_stereo.survey.command import main; sys.exit(main())"


def survey_process(folders: List[Path], out: Path, *options: str) -> subprocess.Popen:
    """A survey as a process of its own, which leads its group."""
    words = [sys.executable, "-c", _COMMAND, *map(str, folders), "-o", str(out), *options]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen(words, start_new_session=True, **quiet)


def content_of(out: Path) -> Dict[str, str]:
    """Checksums of a site's files."""
    return {n: hashlib.sha256((out / n).read_bytes()).hexdigest() for n in FILES}


def written(folder: Path) -> Dict[Path, int]:
    """When (ns) each note of a map, or edge, was written; they are written when all else is."""
    return {p: p.stat().st_mtime_ns for p in folder.glob("*.json")}


def scaling(folders: List[Path], out: Path, kills: int, seed: int) -> Dict[str, str]:
    """Seconds without and with one and two processes, whether all write the same, and what a run
    that was killed at random moments writes."""
    took, contents, random = {}, {}, np.random.default_rng(seed)
    for name in ("0", "1", "2", "killed"):
        shutil.rmtree(out / name, ignore_errors=True)
    for workers in ("0", "1", "2"):
        started = time.perf_counter()
        if survey_process(folders, out / workers, "--workers", workers).wait() != 0:
            raise SystemExit(f"--workers {workers} ended with an error")
        took[workers] = time.perf_counter() - started
        contents[workers] = content_of(out / workers)
    made, lost, kept = [], 0, {}
    for _ in range(kills):
        process = survey_process(folders, out / "killed", "--workers", "2")
        try:
            process.wait(float(random.uniform(0.1, 0.7)) * took["2"])
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            lost += 1
        maps, edges = written(out / "killed/views"), written(out / "killed/edges")
        made.append(f"{len(maps)}+{len(edges)}")
        kept = {**maps, **edges, **kept}  # by the first time that it was there
    if survey_process(folders, out / "killed", "--workers", "2").wait() != 0:
        raise SystemExit("what was killed did not go on")
    contents["killed"] = content_of(out / "killed")
    now = {**written(out / "killed/views"), **written(out / "killed/edges")}
    again = [path.name for path, stamp in kept.items() if now[path] != stamp]
    differ = {
        name: [n for n in FILES if contents["0"][n] != of[n]] or "nothing"
        for name, of in contents.items()
    }
    return {
        "seconds in a plain loop, by one process, by two": ", ".join(
            f"{took[w]:.0f}" for w in ("0", "1", "2")
        ),
        "two processes against one": f"{took['1'] / took['2']:.2f}",
        "differs from the plain loop: one, two processes": f"{differ['1']}, {differ['2']}",
        f"killed {lost} times, maps + edges that were there then": ", ".join(made),
        "of these computed again": ", ".join(again) or "none",
        "differs from the plain loop: after the kills": str(differ["killed"]),
    }


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
    parser.add_argument(
        "--control",
        type=int,
        default=5,
        help="control points of 2 cm, with 10 check points; 0: none",
    )
    parser.add_argument("--small", action="store_true", help="400x300 pixels, two baselines")
    parser.add_argument(
        "--kills", type=int, default=0, help="times processes, too, and kills a run so often"
    )
    parser.add_argument("--workers", type=int, help="processes (one a core)")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/bench_survey"))
    args = parser.parse_args(argv)
    drawn = args.out / "drawn"
    if len(list(drawn.glob(f"view*/{TRUTH}"))) < args.views:
        town = Town.generate(args.seed, args.world)
        height_m = float(town.plan.height(args.middle_m, 0.0)) + args.height_m
        step_rad = np.radians(args.step_deg)
        draw_site(
            town,
            ring(args.views, (args.middle_m, 0.0), args.radius_m, step_rad, height_m),
            drawn,
            args.seed,
            **({"size": (400, 300), "baselines_m": (3.0, 6.0)} if args.small else {}),
        )
    folders = sorted(drawn.glob("view*"))
    if args.kills:
        for name, value in scaling(folders, args.out, args.kills, args.seed).items():
            print(f"| {name} | {value} |")
        return 0
    started, work = time.perf_counter(), WorkOptions(args.workers)
    site = run(
        folders, args.out / "site", begin=lambda *said: print(*said, file=sys.stderr), work=work
    )
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
    if args.control:
        frame = write_control(folders, args.out / "gcp_list.txt", args.seed, args.control + 10)
        checks = ",".join(f"point{i}" for i in range(args.control + 1, args.control + 11))
        world = WorldOptions(args.out / "gcp_list.txt", checks)
        site = run(folders, args.out / "site", world=world, work=work)
        for name, value in control_figures(site, truth, frame).items():
            print(f"| {name} | | {value if isinstance(value, str) else format(value, '.2f')} |")
        print("\n".join(site.adjusted.remarks))
    for m in site.missing:
        print(f"missing {m.name}: {m.reason}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

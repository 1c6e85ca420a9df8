# SPDX-License-Identifier: Apache-2.0
"""Draws a site with the errors of trackers, joins its views, compares with truth; the tables of
docs/lab/survey.md.

tools/run bench-survey [--world village] [--seed 1] [--views 6] [--step-deg 15] [--radius-m 90]
[--places 25] [--control 5] [--kills 0] [--growth 0] [--small] [--workers 2] [-o out/site]

Views that were drawn in OUT/drawn are taken as they are; what was stopped goes on.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np

from bench_survey.peers import multiway
from bench_survey.processes import growth, kills
from bench_survey.truth import TrueView, cloud_figures, figures, normalised
from bench_survey.world import control_figures, gps_figures, write_control
from fcsv_sim.sensors.photo_site import TRUTH, Stand, draw_site, panoramas, ring
from fcsv_sim.world.town import WORLDS, Town
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.document import Site
from fcsv_stereo.survey.placing.georeference import WorldOptions
from fcsv_stereo.survey.survey import run
from fcsv_stereo.survey.tasks.crew import WorkOptions
from harness import show

_HEAD = ("figure", "as flown", "Open3D multiway", "joined")
_PLACES_X_M, _APART_M = 80.0, 100.0  # of panoramas: the first row, and from each to the next


def _stands(args, town: Town) -> List[Stand]:
    """Stands ``height_m`` above the ground beneath each."""
    if not args.places:
        step_rad = np.radians(args.step_deg)
        stands = ring(args.views, (args.middle_m, 0.0), args.radius_m, step_rad, 0.0)
    else:
        side = int(np.ceil(np.sqrt(args.places)))
        numbers = [divmod(i, side) for i in range(args.places)]
        at = [(_PLACES_X_M + _APART_M * i, _APART_M * (j - (side - 1) / 2)) for i, j in numbers]
        stands = panoramas([(x, y, 0.0) for x, y in at])
    return [replace(s, xyz_m=_above(town, s, args.height_m)) for s in stands]


def _above(town: Town, stand: Stand, height_m: float) -> Tuple[float, float, float]:
    x, y, _ = stand.xyz_m
    return x, y, float(town.plan.height(x, y)) + height_m


def _drawn(args) -> List[Path]:
    """Folders of all views; drawn where they are not there."""
    drawn, count = args.out / "drawn", 4 * args.places or args.views
    if len(list(drawn.glob(f"view*/{TRUTH}"))) < count:
        town = Town.generate(args.seed, args.world)
        small = {"size": (400, 300), "baselines_m": (3.0, 6.0)} if args.small else {}
        draw_site(town, _stands(args, town), drawn, args.seed, **small)
    return sorted(drawn.glob("view*"))[:count]


def _show(title: str, values: Dict[str, object]) -> None:
    print()
    show(
        (title, ""),
        ((n, v if isinstance(v, str) else format(v, ",.2f")) for n, v in values.items()),
    )


def _compare(site: Site, truth: Dict[str, TrueView]) -> None:
    """Prints errors of views and points: as flown, as Open3D joins them, as the survey does."""
    placed = site.adjusted.placed
    views = [v.load() for v in site.views if v.name in placed]
    started = time.perf_counter()
    rigid = multiway(views, site.adjusted.edges)
    print(f"Open3D multiway: {time.perf_counter() - started:.0f} s", file=sys.stderr)
    columns = [
        figures(views, poses, truth)
        for poses in (
            {v.name: similarity.of_pose(v.prior.T_site_cam) for v in views},
            rigid,
            {n: p.S_site_cam for n, p in placed.items()},
        )
    ]
    print()
    show(_HEAD, ((name, *(f"{c[name]:.2f}" for c in columns)) for name in columns[0]))


def _joined(site: Site, truth: Dict[str, TrueView]) -> Dict[str, object]:
    kept = sum(e.kept for e in site.adjusted.edges)
    found: Dict[str, object] = {
        "edges kept": f"{kept} of {len(site.adjusted.edges)}",
        "edges: squared error over covariance, per degree of freedom": normalised(site, truth),
        **cloud_figures(site, truth),
    }
    if site.adjusted.loops:
        found["worst loop closes to (m)"] = max(loop.closing_m for loop in site.adjusted.loops)
    return found


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
        "--height-m", type=float, default=25.0, help="above the ground beneath each view"
    )
    parser.add_argument("--middle-m", type=float, default=130.0, help="x of the circle's middle")
    parser.add_argument(
        "--places", type=int, default=0, help="panoramas of four views instead of the circle"
    )
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
    parser.add_argument(
        "--growth", type=int, default=0, help="times processes with so many views and with all"
    )
    parser.add_argument("--workers", type=int, help="processes (one a core)")
    parser.add_argument("-o", "--out", type=Path, default=Path("out/bench_survey"))
    args = parser.parse_args(argv)
    folders = _drawn(args)
    if args.kills:
        _show("killed", kills(folders, args.out, args.kills, args.seed))
        return 0
    if args.growth:
        _show("growth", growth(folders, args.growth, args.out))
        return 0
    started, work = time.perf_counter(), WorkOptions(args.workers)
    site = run(
        folders, args.out / "site", begin=lambda *said: print(*said, file=sys.stderr), work=work
    )
    print(
        f"{args.world} {args.seed}, {len(site.adjusted.placed)} of {len(folders)} views, "
        f"{time.perf_counter() - started:.0f} s with what was there"
    )
    truth = {f.name: TrueView.of(f) for f in folders}
    _compare(site, truth)
    _show("joined", _joined(site, truth))
    _show("with GPS of 2 m", gps_figures(site, truth, args.seed))
    if args.control:
        write_control(folders, args.out / "gcp_list.txt", args.seed, args.control + 10)
        checks = ",".join(f"point{i}" for i in range(args.control + 1, args.control + 11))
        world = WorldOptions(args.out / "gcp_list.txt", checks)
        site = run(folders, args.out / "site", world=world, work=work)
        _show("with control points", control_figures(site, truth))
        print("\n".join(site.adjusted.remarks))
    for m in site.missing:
        print(f"missing {m.name}: {m.reason}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

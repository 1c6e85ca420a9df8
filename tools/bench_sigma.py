# SPDX-License-Identifier: Apache-2.0
"""Whether sigma of flown maps says how wrong they are; the tables go into docs/lab/sigma.md.

make bench-sigma ARGS="[SESSION ...] [--fly] [--draws 40] [--maps 0] [--write]"

SESSION: folders as `make demo` leaves them (session/ inside, with truth/). --fly flies four worlds
with two seeds into out/sigma/ first and takes these (20 minutes). Each session is mapped with the
covariances that it holds, and as before with one prior for all poses. All flights with one seed
share one tracker's scale, so that a few flights cannot tell luck from sigma: --draws other errors
of trackers and calibration (flown_errors.py) say what the scale's error would have been on other
days, and --maps of them are mapped.
"""

import argparse
import os
import platform
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import List, Tuple

import numpy as np
from flown_errors import FlownErrors, prior_scale

from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_stereo import pipeline
from fcsv_stereo.errors import StereoError
from fcsv_stereo.evaluating.evaluation import evaluate
from fcsv_stereo.evaluating.truth import Truth, load_truth
from fcsv_stereo.model import MapInput

ROOT = Path(__file__).resolve().parents[1]
DOCUMENT = ROOT / "docs" / "lab" / "sigma.md"
BEGIN, END = "<!-- table: tools/bench_sigma.py -->", "<!-- end of table -->"
WORLDS, SEEDS = ("street", "village", "field", "plain"), (1, 2)
HEAD = (
    "| session | poses | 1 σ | 2 σ | 1 σ without scale | within 10 % | median error | scale error | median σ | "
    "rotation, worst |\n|---|---|---|---|---|---|---|---|---|---|"
)


@dataclass(frozen=True)
class Row:
    """One map: ``errors`` (N,) in sigmas of all pixels that it answers; shares, and degrees."""

    session: str
    poses: str
    errors: np.ndarray
    within_1_without_scale: float
    within_10_percent: float
    median_error: float
    scale_error: float
    median_sigma: float
    rotation_deg: float

    def __str__(self) -> str:
        one, two = ((self.errors <= k).mean() for k in (1, 2))
        return (
            f"| {self.session} | {self.poses} | {one:.0%} | {two:.0%} | {self.within_1_without_scale:.0%} | "
            f"{self.within_10_percent:.0%} | {self.median_error:.2%} | {self.scale_error:+.2%} | "
            f"{self.median_sigma:.2%} | {self.rotation_deg:.3f}° |"
        )


def mapped(session: str, poses: str, given: MapInput, truth: Truth, true_depth) -> Row:
    """The map of an input against the truth, of pixels up to 400 m. ``true_depth`` is the reference
    picture's."""
    joint = pipeline.METHODS["joint"]
    result = joint.map(given, joint.complete)
    found = evaluate(result, truth, true_depth)
    judged = np.isfinite(result.depth) & (true_depth <= 400.0)
    depth, true, sigma = (a[judged].astype(float) for a in (result.depth, true_depth, result.sigma))
    scale = float(np.median(depth / true))  # of most pixels all else is smaller
    rotations = [deg for deg, _ in found.pose_errors.values()]
    return Row(
        session,
        poses,
        np.abs(depth - true) / sigma,
        float((np.abs(depth / scale - true) <= sigma).mean()),
        found.overall.within_10_percent,
        found.overall.median_relative_error,
        scale - 1.0,
        float(np.median(sigma / depth)),
        max(rotations),
    )


def without_covariances(given: MapInput) -> MapInput:
    """The same input, as sessions were read before: one prior for all poses."""

    def bare(pictures):
        return [replace(p, covariance=None) for p in pictures]

    configurations = [
        replace(c, references=bare(c.references), others=bare(c.others))
        for c in given.configurations
    ]
    return replace(given, configurations=configurations)


def rows_of(folder: Path, draws: int, maps: int) -> Tuple[List[Row], str]:
    """Of one session: maps as flown, with one prior, and drawn again; and the line of the scale
    over draws."""
    session = folder / "session" if (folder / "session").is_dir() else folder
    given, truth = pipeline.load(session), load_truth(session / "truth")
    reference = given.configurations[0].references[len(given.configurations[0].references) // 2]
    true_depth = truth.depth(reference)
    rows = [
        mapped(folder.name, "as flown", given, truth, true_depth),
        mapped(folder.name, "as flown, one prior", without_covariances(given), truth, true_depth),
    ]
    line = ""
    if draws:
        pictures = [p for c in given.configurations for p in (*c.references, *c.others)]
        vehicles = load_vehicles(
            ROOT / "config" / "vehicles", sorted({p.vehicle for p in pictures})
        )
        errors = FlownErrors(session, given, truth, vehicles)
        rows += [
            mapped(folder.name, f"drawn {k}", errors.draw(k), truth, true_depth)
            for k in range(maps)
        ]
        off = np.array([prior_scale(errors.draw(k), truth)[0] for k in range(draws)])
        flown, stated = prior_scale(given, truth)
        inside = (np.abs(off) <= stated).mean(), (np.abs(off) <= 2.0 * stated).mean()
        rms = float(np.sqrt((off**2).mean()))
        line = f"| {folder.name} | {flown:+.2%} | {stated:.2%} | {rms:.2%} | {inside[0]:.0%} | {inside[1]:.0%} |"
        print(line, flush=True)
    return rows, line


def pooled(name: str, rows: List[Row]) -> str:
    """One row of all maps: shares of all pixels; the scale's rms error and its ratio to sigma of
    most pixels."""
    errors = np.concatenate([r.errors for r in rows])
    one, two = ((errors <= k).mean() for k in (1, 2))
    scale = float(np.sqrt(np.mean([r.scale_error**2 for r in rows])))
    in_sigmas = float(np.sqrt(np.mean([(r.scale_error / r.median_sigma) ** 2 for r in rows])))
    return f"| {name} | {len(rows)} | {one:.0%} | {two:.0%} | {scale:.2%} | {in_sigmas:.2f} |"


def fly(out: Path) -> List[Path]:
    """Four worlds, two seeds; a folder that is there already is not flown again."""
    folders = []
    for seed in SEEDS:
        for world in WORLDS:
            folders.append(out / f"{world}{seed}")
            if (folders[-1] / "session").is_dir():
                continue
            what = {"WORLD": world, "SEED": str(seed), "MISSION": "short", "LIVE": "0", "RVIZ": "0"}
            what["OUT"] = str(folders[-1].resolve())
            subprocess.run(
                [str(ROOT / "tools" / "run"), "demo"],
                env={**os.environ, **what},
                cwd=ROOT,
                check=True,
            )
    return folders


def tables(folders: List[Path], draws: int, maps: int) -> str:
    """All tables, with date, machine and command. Raises StereoError for a session that cannot be
    mapped."""
    rows: List[Row] = []
    scales: List[str] = []
    for folder in folders:
        more, line = rows_of(folder, draws, maps)
        rows, scales = rows + more, scales + [line]
        print(*more, sep="\n", flush=True)
    kinds = {
        "as flown, covariances of the session": [r for r in rows if r.poses == "as flown"],
        "as flown, one prior (0.15 m, 0.3°)": [r for r in rows if r.poses == "as flown, one prior"],
        "drawn again, covariances of the session": [r for r in rows if r.poses.startswith("drawn")],
    }
    sums = [pooled(name, of) for name, of in kinds.items() if of]
    command = (
        f"tools/bench_sigma.py {' '.join(f.name for f in folders)} --draws {draws} --maps {maps}"
    )
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    lines = [
        f"`{command}`, {time.strftime('%Y-%m-%d')}, {machine}.",
        "",
        "| maps | number | 1 σ | 2 σ | rms scale error | in σ |\n|---|---|---|---|---|---|",
        *sums,
        "",
        HEAD,
        *(str(r) for r in rows if not r.poses.startswith("drawn")),
        "",
        f"| session | scale of this flight's priors | stated σ | rms of {draws} draws | 1 σ | 2 σ |\n"
        "|---|---|---|---|---|---|",
        *scales,
    ]
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sessions", nargs="*", type=Path)
    parser.add_argument("--fly", action="store_true", help="fly eight sessions first")
    parser.add_argument(
        "--draws", type=int, default=40, help="other errors of each session's priors"
    )
    parser.add_argument("--maps", type=int, default=0, help="as many of them are mapped")
    parser.add_argument("--write", action="store_true", help="into docs/lab/sigma.md")
    args = parser.parse_args()
    folders = [*args.sessions, *(fly(ROOT / "out" / "sigma") if args.fly else [])]
    if not folders:
        parser.error("name sessions, or --fly")
    try:
        text = tables(folders, args.draws, args.maps)
    except StereoError as error:
        print(f"bench_sigma: {error}", file=sys.stderr)
        return 1
    print(f"\n{text}")
    if args.write:
        before, _, rest = DOCUMENT.read_text().partition(BEGIN)
        DOCUMENT.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.partition(END)[2]}")
        print(f"wrote {DOCUMENT}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

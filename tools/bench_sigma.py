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
import subprocess
import sys
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
from harness import LAB, ROOT, grid, line, measured, provenance, rms, table, write

WORLDS, SEEDS = ("street", "village", "field", "plain"), (1, 2)
_MAPS = ("maps", "number", "1 σ", "2 σ", "rms scale error", "in σ")
_SESSIONS = (
    "session",
    "poses",
    "1 σ",
    "2 σ",
    "1 σ without scale",
    "within 10 %",
    "median error",
    "scale error",
    "median σ",
    "rotation, worst",
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

    def cells(self) -> List[str]:
        """A row of the table of sessions."""
        one, two = ((self.errors <= k).mean() for k in (1, 2))
        return [
            self.session,
            self.poses,
            f"{one:.0%}",
            f"{two:.0%}",
            f"{self.within_1_without_scale:.0%}",
            f"{self.within_10_percent:.0%}",
            f"{self.median_error:.2%}",
            f"{self.scale_error:+.2%}",
            f"{self.median_sigma:.2%}",
            f"{self.rotation_deg:.3f}°",
        ]


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


def rows_of(folder: Path, draws: int, maps: int) -> Tuple[List[Row], List[str]]:
    """A session's maps as flown, with one prior, and drawn again; and the cells of its scale over
    draws (none where nothing is drawn)."""
    session = folder / "session" if (folder / "session").is_dir() else folder
    given, truth = pipeline.load(session), load_truth(session / "truth")
    reference = given.configurations[0].references[len(given.configurations[0].references) // 2]
    true_depth = truth.depth(reference)
    rows = [
        mapped(folder.name, "as flown", given, truth, true_depth),
        mapped(folder.name, "as flown, one prior", without_covariances(given), truth, true_depth),
    ]
    scale: List[str] = []
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
        scale = [folder.name, f"{flown:+.2%}", f"{stated:.2%}", f"{rms(off):.2%}"]
        scale += [f"{share:.0%}" for share in inside]
    return rows, scale


def pooled(name: str, rows: List[Row]) -> List[str]:
    """Cells of a row for all maps: shares of all pixels; the scale's rms error and its ratio to
    sigma of most pixels."""
    errors = np.concatenate([r.errors for r in rows])
    one, two = ((errors <= k).mean() for k in (1, 2))
    scale = rms([r.scale_error for r in rows])
    in_sigmas = rms([r.scale_error / r.median_sigma for r in rows])
    return [name, str(len(rows)), f"{one:.0%}", f"{two:.0%}", f"{scale:.2%}", f"{in_sigmas:.2f}"]


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


def tables(folders: List[Path], draws: int, maps: int) -> List[str]:
    """All tables, with date, machine and command. Raises StereoError for a session that cannot be
    mapped."""
    rows: List[Row] = []
    scales: List[List[str]] = []
    cases = grid(folder=folders, draws=[draws], maps=[maps])
    for _, (more, scale) in measured(rows_of, cases):
        rows, scales = rows + more, scales + [scale] * bool(scale)
        print(*(line(r.cells()) for r in more), sep="\n", flush=True)
    kinds = {
        "as flown, covariances of the session": [r for r in rows if r.poses == "as flown"],
        "as flown, one prior (0.15 m, 0.3°)": [r for r in rows if r.poses == "as flown, one prior"],
        "drawn again, covariances of the session": [r for r in rows if r.poses.startswith("drawn")],
    }
    sums = [pooled(name, of) for name, of in kinds.items() if of]
    command = (
        f"tools/bench_sigma.py {' '.join(f.name for f in folders)} --draws {draws} --maps {maps}"
    )
    of_scales = (
        "session",
        "scale of this flight's priors",
        "stated σ",
        f"rms of {draws} draws",
        "1 σ",
        "2 σ",
    )
    return [
        provenance(command),
        "",
        *table(_MAPS, sums),
        "",
        *table(_SESSIONS, [r.cells() for r in rows if not r.poses.startswith("drawn")]),
        "",
        *table(of_scales, scales),
    ]


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
        lines = tables(folders, args.draws, args.maps)
    except StereoError as error:
        print(f"bench_sigma: {error}", file=sys.stderr)
        return 1
    print("", *lines, sep="\n")
    if args.write:
        write(LAB / "sigma.md", "bench_sigma.py", lines)
    return 0


if __name__ == "__main__":
    sys.exit(main())

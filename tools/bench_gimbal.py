# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/lab/gimbal.md: a gimbal that follows a vehicle at 1 m/s, 2 to 4 m away,
against truth."""

import argparse
from pathlib import Path

import cv2
import numpy as np

from fcsv_sim.trials import gimbal_evaluation as evaluation
from fcsv_tracking.gimbal.config import load_ground_robot
from fcsv_tracking.gimbal.follow import FollowRules
from fcsv_tracking.gimbal.tracker import GimbalRules
from harness import LAB, ROOT, consistency_band, grid, measured, provenance, rms, table, write

GIMBAL = load_ground_robot(ROOT / "config" / "gimbal" / "ground_robot.yaml").gimbals[0]
THESIS = GimbalRules(follow=FollowRules(predict=False, lead=0.0))
# of long runs without pictures, seen face on: what the detector leaves on drawn ones
CORNERS_PX = 0.05
_TITLES = (
    "seed",
    "poses after 2 s, of all pictures",
    "tag in the picture",
    "gimbal still",
    "along, rms (95 %, worst)",
    "across, rms (95 %, worst)",
    "rotation, rms (95 %)",
)


def rendered(seed, seconds):
    """Every picture drawn and looked at; figures of one seed."""
    cv2.setNumThreads(1)
    flight = evaluation.run(GIMBAL, seed, evaluation.Scenario(duration_s=seconds))
    along, across, angle = (
        np.array([getattr(p, name) for p in flight.poses])
        for name in ("along_m", "across_m", "angle_deg")
    )
    figures = {
        "seed": seed,
        "poses": len(along),
        "pictures": flight.pictures,
        "in": float(np.mean(flight.in_picture)),
        "still": float(np.mean(flight.still)),
        "along": rms(along),
        "along95": float(np.percentile(np.abs(along), 95)),
        "along_worst": float(np.abs(along).max()),
        "across": rms(across),
        "across95": float(np.percentile(across, 95)),
        "across_worst": float(across.max()),
        "angle": rms(angle),
        "angle95": float(np.percentile(angle, 95)),
        # constant errors of a mounting make the poses of one run alike: one pose a run counts
        "nees": flight.poses[len(flight.poses) // 2].normalised / 6,
        "nees_all": float(np.mean([p.normalised for p in flight.poses]) / 6),
    }
    print(figures, flush=True)
    return figures


def following(seed, seconds, rules):
    """A minute without pictures: shares of it with the tag in the picture, and with a still gimbal."""
    setup = evaluation.Setup(rules=rules, corners_px=CORNERS_PX)
    flight = evaluation.run(GIMBAL, seed, evaluation.Scenario(duration_s=seconds), setup)
    print(
        seed,
        np.mean(flight.in_picture),
        np.mean(flight.still),
        dict(flight.tracker.counts),
        flush=True,
    )
    return float(np.mean(flight.in_picture)), float(np.mean(flight.still))


def with_pictures(figures):
    """The table of the runs with pictures, and the line of their consistency below it."""

    def row(name, f):
        return (
            name,
            f"{f['poses']} of {f['pictures']}",
            f"{f['in']:.1%}",
            f"{f['still']:.0%}",
            f"{f['along'] * 1e3:.1f} ({f['along95'] * 1e3:.1f}, {f['along_worst'] * 1e3:.1f}) mm",
            f"{f['across'] * 1e3:.1f} ({f['across95'] * 1e3:.1f}, {f['across_worst'] * 1e3:.1f}) mm",
            f"{f['angle']:.2f} ({f['angle95']:.2f}) deg",
        )

    worst = {k: (min if k in ("in", "still") else max)(f[k] for f in figures) for k in figures[0]}
    worst["poses"], worst["pictures"] = (sum(f[k] for f in figures) for k in ("poses", "pictures"))
    rows = [row(f["seed"], f) for f in figures] + [row("**worst** (sum)", worst)]
    rows.append(("bound", "", "≥ 99 %", "≥ 60 %", "20 mm", "5 mm", ""))
    low, high = consistency_band(len(figures))
    mean = np.mean([f["nees"] for f in figures])
    over_all = np.mean([f["nees_all"] for f in figures])
    note = (
        f"Normalised squared error per degree of freedom, one pose a run ({len(figures)} poses): "
        f"{mean:.2f}, 95 % band {low:.2f} to {high:.2f}; over all poses {over_all:.2f}."
    )
    return [*table(_TITLES, rows), "", note]


def long_runs(seeds, seconds, jobs):
    """The table of the runs without pictures."""
    rows = []
    for name, rules in (
        ("predicting, with a lead (default)", GimbalRules()),
        ("as the thesis prints it", THESIS),
    ):
        cases = grid(seed=seeds, seconds=[seconds], rules=[rules])
        found = np.array([shares for _, shares in measured(following, cases, jobs)])
        (mean_in, mean_still), (least_in, least_still) = found.mean(axis=0), found.min(axis=0)
        rows.append(
            (name, f"{mean_in:.2%} ({least_in:.2%})", f"{mean_still:.1%} ({least_still:.1%})")
        )
    titles = ("following alone", "tag in the picture, mean (worst)", "gimbal still, mean (worst)")
    return table(titles, rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(1, 11)))
    parser.add_argument("--seconds", type=float, default=10.0, help="of every run with pictures")
    parser.add_argument("--long-seconds", type=float, default=60.0, help="of every run without")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=LAB / "gimbal.md")
    args = parser.parse_args()
    following_lines = long_runs(args.seeds, args.long_seconds, args.jobs)
    cases = grid(seed=args.seeds, seconds=[args.seconds])
    figures = [found for _, found in measured(rendered, cases, args.jobs)]
    command = (
        f"make bench-gimbal ARGS='--seconds {args.seconds:g} --long-seconds {args.long_seconds:g}'"
    )
    lines = [
        f"Runs of {args.seconds:g} s, every picture drawn and looked at:",
        "",
        *with_pictures(figures),
        "",
    ]
    lines += [
        f"Runs of {args.long_seconds:g} s with corners of {CORNERS_PX} px of noise in place of pictures:",
        "",
    ]
    write(args.out, "bench_gimbal.py", [*lines, *following_lines, "", provenance(command)])


if __name__ == "__main__":
    main()

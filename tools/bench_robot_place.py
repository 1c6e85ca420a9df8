# SPDX-License-Identifier: Apache-2.0
"""A table of docs/lab/guidance.md: a robot drives past two vehicles that hold and drift, and is
located by the gimbals on it."""

import argparse
from pathlib import Path

import cv2
import numpy as np

from fcsv_guidance.robot import load_robot
from fcsv_sim.trials.gimbal_evaluation import Setup
from fcsv_sim.trials.robot_among_vehicles import Held, drive
from fcsv_tracking.gimbal.config import load_ground_robot
from harness import LAB, ROOT, grid, measured, provenance, rms, table, write

GIMBALS = load_ground_robot(ROOT / "config" / "gimbal" / "ground_robot.yaml").gimbals
ROBOT = load_robot(ROOT / "config" / "robots" / "small.yaml")
# beside the way, so that no tag is seen from below
HELD = (Held(1.0, 2.3, 1.8), Held(4.5, -2.3, 1.8))
_TITLES = (
    "seed",
    "pictures",
    "way (m)",
    "vehicles drifted (m)",
    "vehicles away (m)",
    "place, rms (worst) (m)",
    "heading, rms (worst) (deg)",
    "within 2 sigma: place, heading",
    "not known",
)


def located(seed, drawn):
    """Figures of one drive; ``drawn``: every picture is drawn and looked at."""
    cv2.setNumThreads(1)
    setup = Setup() if drawn else None
    outcome = drive(ROBOT, GIMBALS, HELD, seed, setup=setup)
    off_m, off_deg, sigma_m, sigma_deg = (
        np.array([getattr(j, name) for j in outcome.judged])
        for name in ("error_m", "error_deg", "sigma_m", "sigma_deg")
    )
    away_m = np.array([j.distances_m for j in outcome.judged]).min(axis=1)
    figures = {
        "seed": seed,
        "drawn": drawn,
        "way": outcome.way_m,
        "drifted": outcome.drifted_m,
        "nearest": away_m.min(),
        "farthest": away_m.max(),
        "place": rms(off_m),
        "place_worst": float(off_m.max()),
        "heading": rms(off_deg),
        "heading_worst": float(np.abs(off_deg).max()),
        "place_in": float(np.mean(off_m < 2 * sigma_m)),
        "heading_in": float(np.mean(np.abs(off_deg) < 2 * sigma_deg)),
        "unknown": outcome.unknown / (outcome.unknown + len(off_m)),
    }
    print(figures, flush=True)
    return figures


def row(f):
    """One line of the table."""
    return (
        f["seed"],
        "drawn" if f["drawn"] else "corners with noise",
        f"{f['way']:.1f}",
        ", ".join(f"{d:.2f}" for d in f["drifted"]),
        f"{f['nearest']:.1f} to {f['farthest']:.1f}",
        f"{f['place']:.3f} ({f['place_worst']:.3f})",
        f"{f['heading']:.2f} ({f['heading_worst']:.2f})",
        f"{f['place_in']:.0%}, {f['heading_in']:.0%}",
        f"{f['unknown']:.0%}",
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(1, 9)))
    parser.add_argument("--drawn", type=int, nargs="*", default=[1], help="seeds with pictures")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=LAB / "guidance.md")
    args = parser.parse_args()
    cases = [*grid(seed=args.seeds, drawn=[False]), *grid(seed=args.drawn, drawn=[True])]
    rows = [row(found) for _, found in measured(located, cases, args.jobs)]
    command = f"python tools/bench_robot_place.py --seeds {' '.join(map(str, args.seeds))}"
    write(args.out, "bench_robot_place.py", [*table(_TITLES, rows), "", provenance(command)])


if __name__ == "__main__":
    main()

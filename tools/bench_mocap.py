# SPDX-License-Identifier: Apache-2.0
"""The table of docs/lab/mocap.md: the mocap tracker against simulated truth, and against every kind
of bad input."""

import argparse
import dataclasses
from pathlib import Path

import numpy as np

from fcsv_sim.sensors.tello_sensors import TelloErrors
from fcsv_sim.sensors.v120_duo import V120DuoErrors
from fcsv_sim.trials import mocap_evaluation as evaluation
from fcsv_sim.trials.mocap_flight import FlightErrors
from harness import LAB, consistency_band, grid, measured, provenance, table, write

_TITLES = (
    "seed",
    "odometry alone after 20 m",
    "tracker after 20 m",
    "of the distance",
    "largest step at re-entry",
    "in view, rms (95 %)",
    "in view, rms (95 %)",
    "level, worst",
)


def scaled_to_two_percent(seed):
    """The seed's flight with its drift scaled so that odometry alone is off by 2 % after 20 m out
    of view."""
    plain = evaluation.evaluate(seed)
    drift = 0.02 * evaluation.AWAY_M / evaluation.at_20_m(plain.records["b"]).raw_m
    errors = FlightErrors(tello=TelloErrors(drift=drift))
    return plain, evaluation.evaluate(seed, errors)


def rows_of(seed):
    plain, flight = scaled_to_two_percent(seed)
    away = evaluation.at_20_m(flight.records["b"])
    view = evaluation.in_view(flight)
    figures = {
        "seed": seed,
        "odometry": away.raw_m,
        "away": float(np.linalg.norm(away.error_m)),
        "share": float(np.linalg.norm(away.error_m)) / away.away_m,
        "jump": evaluation.largest_jump_m(flight.records["b"]),
        **view,
        "level": max(
            v for t, v in flight.level_deg if t > evaluation.START_S + evaluation.LEVEL_AFTER_S
        ),
        "nees_view": evaluation.normalised_in_view(plain),
        "nees_away": evaluation.normalised(evaluation.at_20_m(plain.records["b"])),
    }
    print(figures, flush=True)
    return figures


def accuracy(figures):
    """The table of errors, a row for each seed and the worst of all with its bounds."""
    rows = [
        (
            f["seed"],
            f"{f['odometry']:.3f} m",
            f"{f['away']:.3f} m",
            f"{f['share']:.2%}",
            f"{f['jump'] * 1e3:.1f} mm",
            f"{f['rms_m'] * 1e3:.1f} ({f['p95_m'] * 1e3:.1f}) mm",
            f"{f['rms_deg']:.2f} ({f['p95_deg']:.2f}) deg",
            f"{f['level']:.2f} deg",
        )
        for f in figures
    ]
    worst = {k: max(f[k] for f in figures) for k in figures[0]}
    rows.append(
        (
            "**worst**",
            f"{worst['odometry']:.3f} m",
            f"{worst['away']:.3f} m",
            f"**{worst['share']:.2%}** (2.5 %)",
            f"**{worst['jump'] * 1e3:.1f} mm** (20)",
            f"**{worst['rms_m'] * 1e3:.1f}** ({worst['p95_m'] * 1e3:.1f}) mm (5)",
            f"**{worst['rms_deg']:.2f}** ({worst['p95_deg']:.2f}) deg (0.3)",
            f"**{worst['level']:.2f} deg** (0.2)",
        )
    )
    return table(_TITLES, rows)


def consistency(figures):
    """Average normalised squared error of all seeds against the 95 % band of as many independent
    ones."""
    rows = []
    samples = [("after 20 m out of view, one pose a flight", [f["nees_away"] for f in figures])]
    samples.insert(
        0,
        (
            "in view, one pose of either vehicle a flight",
            [n for f in figures for n in f["nees_view"]],
        ),
    )
    for title, values in samples:
        low, high = consistency_band(len(values))
        rows.append(
            (
                f"{title} ({len(values)} poses)",
                f"{np.mean(values) / 6:.2f}",
                f"{low:.2f} to {high:.2f}",
            )
        )
    titles = ("normalised squared error per degree of freedom", "average", "95 % band")
    return table(titles, rows)


def wrong_poses(seed):
    """Markers swapped and bodies turned over in a flight; what the tracker makes of it."""
    errors = FlightErrors(
        mocap=dataclasses.replace(V120DuoErrors(), swaps_per_s=1.0, flips_per_s=0.2)
    )
    flight = evaluation.evaluate(seed, errors)
    view = evaluation.in_view(flight)
    return (
        seed,
        flight.wrong_poses,
        f"{view['rms_m'] * 1e3:.1f} mm, {view['rms_deg']:.2f} deg",
        f"{view['worst_m'] * 1e3:.0f} mm, {view['worst_deg']:.1f} deg",
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(1, 11)))
    parser.add_argument("--out", type=Path, default=LAB / "mocap.md")
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    figures = [found for _, found in measured(rows_of, grid(seed=args.seeds), args.jobs)]
    wrong = [row for _, row in measured(wrong_poses, grid(seed=args.seeds[:2]), args.jobs)]
    titles = ("seed", "wrong poses streamed", "in view, rms", "worst")
    lines = [*accuracy(figures), "", *consistency(figures), "", *table(titles, wrong), ""]
    write(args.out, "bench_mocap.py", [*lines, provenance("python tools/bench_mocap.py")])


if __name__ == "__main__":
    main()

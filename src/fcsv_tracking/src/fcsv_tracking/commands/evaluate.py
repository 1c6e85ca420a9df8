# SPDX-License-Identifier: Apache-2.0
"""``rosrun fcsv_tracking evaluate``: a trajectory against truth or against a second tracker."""

import argparse
import json
from pathlib import Path
from typing import List, Optional

from fcsv_geometry.programs.writing import require_file
from fcsv_tracking import commands
from fcsv_tracking.evaluation.metrics import ALIGNMENTS, Statistics, TrackEvaluation, evaluate
from fcsv_tracking.evaluation.tracks import Track, read_truth, read_tum

_EXAMPLES = """examples:
  evaluate out/uav2_camera.tum out/demo/session/truth/cameras.csv --vehicle uav2
  evaluate t265.tum mocap.tum --align yaw --delta-m 2 -o out/t265.json
"""


def main(argv: Optional[List[str]] = None) -> int:
    return commands.run(_parser(), argv, _evaluate)


def _evaluate(args) -> None:
    if args.out:
        require_file(args.out)
    estimate, reference = (_read(Path(p), args.vehicle) for p in (args.estimate, args.reference))
    found = evaluate(estimate, reference, args.align, args.delta_m, args.gap_s)
    print(table(found))
    if args.out:
        Path(args.out).write_text(json.dumps(found.as_dict(), indent=2) + "\n")
        print(f"wrote {args.out}")


def table(found: TrackEvaluation) -> str:
    """Writes a table for a person."""

    def row(name: str, s: Statistics, unit: str) -> str:
        return f"{name:<28}{s.rmse:10.4f}{s.mean:10.4f}{s.median:10.4f}{s.max:10.4f}  {unit}"

    return "\n".join(
        [
            f"{found.poses} poses over {found.path_m:.1f} m, aligned: {found.alignment}",
            f"{'':<28}{'rmse':>10}{'mean':>10}{'median':>10}{'max':>10}",
            row("ATE position", found.ate_m, "m"),
            row("ATE rotation", found.ate_deg, "deg"),
            row(f"RPE position over {found.delta_m:g} m", found.rpe_m, "m"),
            row(f"RPE rotation over {found.delta_m:g} m", found.rpe_deg, "deg"),
            f"drift {found.drift_m_per_m:.2%} of the distance, {found.drift_deg_per_m:.3f} deg/m",
        ]
    )


def _read(path: Path, vehicle: Optional[str]) -> Track:
    return read_truth(path, vehicle) if path.suffix == ".csv" else read_tum(path)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="evaluate",
        description="Drift, ATE and RPE of a trajectory.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("estimate", help="TUM file (see export_trajectories), or truth/cameras.csv")
    parser.add_argument("reference", help="likewise: truth, or a second tracker")
    parser.add_argument("--vehicle", help="whose rows of cameras.csv count")
    parser.add_argument(
        "--align", choices=ALIGNMENTS, default="yaw", help="before ATE (default %(default)s)"
    )
    parser.add_argument(
        "--delta-m", type=float, default=1.0, help="path between RPE's pairs (default %(default)s)"
    )
    parser.add_argument(
        "--gap-s", type=float, default=0.25, help="longest gap bridged in the reference"
    )
    parser.add_argument("-o", "--out", help="write the figures as JSON")
    return parser

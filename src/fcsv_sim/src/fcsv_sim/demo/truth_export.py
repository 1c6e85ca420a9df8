# SPDX-License-Identifier: Apache-2.0
"""The truth of a simulated session, in the form in which a surveyed one would come: a mesh and camera poses."""

import csv
from pathlib import Path
from typing import Iterable


def export_truth(sim_folder: Path, session_folder: Path, vehicles: Iterable[str]) -> Path:
    """SESSION/truth/cameras.csv out of the cameras' own notes; scene.ply is written beside it by `world`."""
    truth = Path(session_folder) / "truth"
    truth.mkdir(parents=True, exist_ok=True)
    with open(truth / "cameras.csv", "w", newline="") as merged:
        writer = None
        for vehicle in vehicles:
            with open(Path(sim_folder) / f"truth_cameras_{vehicle}.csv", newline="") as notes:
                for row in csv.DictReader(notes):
                    if None in row.values():
                        continue  # the last line of a camera that was stopped while it wrote
                    if writer is None:
                        writer = csv.DictWriter(merged, row.keys())
                        writer.writeheader()
                    writer.writerow(row)
    return truth

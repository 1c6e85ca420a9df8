# SPDX-License-Identifier: Apache-2.0
"""The truth of a simulated session, in the form in which a surveyed one would come: a mesh and
camera poses."""

import csv
from pathlib import Path
from typing import Dict, Iterable, List, Mapping, Optional, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.world.export import write_mesh
from fcsv_sim.world.movers import Mover, mesh

_SAME_S = 1e-3  # stamps of one picture


def export_truth(
    sim_folder: Path,
    session_folder: Path,
    vehicles: Iterable[str],
    stamped: Optional[Mapping[str, Sequence[float]]] = None,
) -> Path:
    """SESSION/truth/cameras.csv out of the cameras' own notes; scene.ply is written beside it by
    `world`.

    ``stamped``: of vehicles whose pictures have no stamps of their own (a Tello's video), the
    stamps (s) that whoever received them gave; each gets the row of the picture that was truly
    taken nearest to it.
    """
    truth = Path(session_folder) / "truth"
    truth.mkdir(parents=True, exist_ok=True)
    with open(truth / "cameras.csv", "w", newline="") as merged:
        writer = None
        for vehicle in vehicles:
            with open(Path(sim_folder) / f"truth_cameras_{vehicle}.csv", newline="") as notes:
                # the last line of a camera that was stopped while it wrote is not whole
                rows = [row for row in csv.DictReader(notes) if None not in row.values()]
            if stamped and vehicle in stamped:
                rows = nearest(rows, stamped[vehicle])
            for row in rows:
                if writer is None:
                    writer = csv.DictWriter(merged, row.keys())
                    writer.writeheader()
                writer.writerow(row)
    return truth


def true_camera(sim_folder: Path, vehicle: str, stamp_s: float) -> Optional[np.ndarray]:
    """T_world_cam of the picture of a stamp, by the camera's own notes; None where they have
    none."""
    with open(Path(sim_folder) / f"truth_cameras_{vehicle}.csv", newline="") as notes:
        for row in csv.DictReader(notes):
            if None not in row.values() and abs(float(row["stamp_s"]) - stamp_s) < _SAME_S:
                q = [float(row[k]) for k in ("qx", "qy", "qz", "qw")]
                return transforms.from_xyz_quaternion([float(row[k]) for k in "xyz"], q)
    return None


def export_movers(truth: Path, moving: Sequence[Mover]) -> None:
    """What moved, beside cameras.csv: a mesh of each in movers/, and in movers.csv where it was at
    every picture."""
    with open(truth / "cameras.csv", newline="") as file:
        stamps = sorted({row["stamp_s"] for row in csv.DictReader(file)})
    (truth / "movers").mkdir(exist_ok=True)
    for mover in moving:
        write_mesh(
            *mesh(mover.boxes),
            truth / "movers" / f"{mover.name}.ply",
            f"{mover.name}, metres, its own frame",
        )
    with open(truth / "movers.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["stamp_s", "name", "x", "y", "z", "qx", "qy", "qz", "qw"])
        for stamp in stamps:
            for mover in moving:
                T = mover.T_world_body(float(stamp))
                values = [f"{v:.9f}" for v in (*T[:3, 3], *transforms.quaternion_xyzw(T))]
                writer.writerow([stamp, mover.name, *values])


def nearest(rows: List[Dict[str, str]], stamps_s: Sequence[float]) -> List[Dict[str, str]]:
    """Finds, for each stamp the row whose own is nearest, with that stamp; none for a stamp further
    from all than they are from each other in the mean.

    >>> rows = [{"stamp_s": "1.0", "x": "a"}, {"stamp_s": "1.5", "x": "b"}]
    >>> nearest(rows, [1.3, 1.1, 9.0])
    [{'stamp_s': '1.300000000', 'x': 'b'}, {'stamp_s': '1.100000000', 'x': 'a'}]
    """
    if len(rows) < 2:
        return []
    true_s = np.array([float(row["stamp_s"]) for row in rows])
    most_s, found = float(np.diff(true_s).mean()), []
    for stamp_s in stamps_s:
        k = int(np.argmin(np.abs(true_s - stamp_s)))
        if abs(true_s[k] - stamp_s) <= most_s:
            found.append({**rows[k], "stamp_s": f"{stamp_s:.9f}"})
    return found

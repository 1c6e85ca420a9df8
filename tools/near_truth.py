# SPDX-License-Identifier: Apache-2.0
"""How far the near field's points of a demo are from the true surfaces, and how much of what stands near it has:
python tools/near_truth.py out/demo

Of all surfaces more than 0.3 m above the ground that are within 8 m of a place of a vehicle in the air, 100 points to
the square metre, as tools/bench_near.py counts them: saw, those that a depth camera saw; in sight, those that one at
a place of the way would see if it looked their way; each the share with a point of the near field, and of the joined
map, within 5 cm and 2 % of its distance.
"""

import argparse
import csv
import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Iterator, List

import matplotlib
import numpy as np
import open3d as o3d
from bench_near import Part, all_standing
from matplotlib import pyplot as plt
from scipy.spatial import cKDTree

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.near.join import NEAR_BASELINE
from fcsv_stereo.truth import load_truth

matplotlib.use("Agg")
_WRONG_M = 0.21  # 5 cm and 2 % of 8 m
_FIXED_M, _SHARE = 0.05, 0.02
_UP_M = 1.0  # above where it stood: in the air
_APART_M, _APART_RAD = 0.15, np.radians(4.0)  # poses that are nearer than that to the one before show no more


def main() -> int:
    """Exit status 1 where the map has no near field."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("demo", type=Path, help="folder of a demo that was flown with NEAR=1")
    parser.add_argument("--picture", type=Path, help="where to draw the near field from above (.png)")
    args = parser.parse_args()
    demo = args.demo
    reference = json.loads((demo / "map" / "report.json").read_text())["reference"]
    truth, (vehicle, stamp) = load_truth(demo / "session" / "truth"), reference["image"].split("/")
    T_world_home = truth.T_world_cam(vehicle, float(stamp)) @ transforms.invert(np.array(reference["T_home_cam"]))
    cloud = o3d.t.io.read_point_cloud(str(demo / "map" / "map.ply"))
    near = cloud.point["baseline"].numpy().ravel() == NEAR_BASELINE
    if not near.any():
        print("no near field")
        return 1
    points = transforms.apply(T_world_home, cloud.point.positions.numpy().astype(float))
    mesh = o3d.t.io.read_triangle_mesh(str(truth.mesh_path))
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh)
    off_m = scene.compute_distance(o3d.core.Tensor(points[near].astype(np.float32))).numpy()
    median_cm, most_cm = 100.0 * np.percentile(off_m, [50, 90])
    print(f"{near.sum()} points; distance to the nearest true surface: median {median_cm:.1f} cm")
    print(f"90 % within {most_cm:.1f} cm, within {_WRONG_M} m {(off_m < _WRONG_M).mean():.1%}")
    camera = PinholeCamera(**{k: reference[k] for k in ("width", "height", "fx", "fy", "cx", "cy")})
    eyes = on_the_way(demo / "run" / "sim")
    standing(mesh, eyes, camera, points, near)
    if args.picture:
        from_above(points[near], off_m, np.array([T[:3, 3] for T in eyes]), args.picture)
    return 0


def standing(mesh, eyes: List[np.ndarray], camera: PinholeCamera, points: np.ndarray, near: np.ndarray) -> None:
    """Says how much of what stands is there; ``eyes``: T_world_cam on the way, ``points`` (N,3; world), ``near`` (N,)
    those of the near field."""
    town = SimpleNamespace(
        vertices=mesh.vertex.positions.numpy(), triangles=mesh.triangle.indices.numpy()
    )  # what it reads of a world
    T_world_2m = transforms.from_xyz_yaw([0.0, 0.0, 2.0], 0.0)  # the bench's home is 2 m high
    found = all_standing(town, np.array([T[:3, 3] for T in eyes]), eyes, camera, T_world_2m)
    true = transforms.apply(T_world_2m, found.points_home_m)
    print(f"{len(eyes)} places; of what stands within 8 m of one:")
    for who, some in (("near field", points[near]), ("joined map", points)):
        from_m = cKDTree(some).query(true)[0]
        ranges = {"saw": found.shown_m, "in sight": found.in_sight_m, "all that stands": found.distance_m}
        words = (f"{what} {share(from_m, range_m).words}" for what, range_m in ranges.items())
        print(f"  {who}: {', '.join(words)}")


def share(from_m: np.ndarray, range_m: np.ndarray) -> Part:
    """Of points at ``range_m`` (N,; infinite: not counted) the part with another one near enough, ``from_m`` (N,)."""
    counted = np.isfinite(range_m)
    return Part.of(from_m[counted] <= _FIXED_M + _SHARE * range_m[counted])


def from_above(points: np.ndarray, off_m: np.ndarray, places: np.ndarray, path: Path) -> None:
    """Points (N,3; world), by height and by how far they are from the truth, ``off_m`` (N,); ``places`` (M,3)."""
    highest = np.argsort(points[:, 2])  # upon the lower ones
    figure, axes = plt.subplots(1, 2, figsize=(13, 6.2), sharex=True, sharey=True, constrained_layout=True)
    shown = (
        (points[:, 2], "height above the ground (m)", 4.0),
        (100.0 * off_m, "from the nearest true surface (cm)", 30.0),
    )
    for ax, (values, words, most) in zip(axes, shown):
        dots = ax.scatter(*points[highest, :2].T, c=values[highest], s=0.3, vmin=0.0, vmax=most, cmap="viridis", lw=0)
        ax.plot(*places[:, :2].T, "r.", ms=3, label="cameras in the air")
        figure.colorbar(dots, ax=ax, label=words)
        ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes[0].legend(loc="lower right")
    figure.savefig(path, dpi=80)
    print(f"wrote {path}")


def on_the_way(sim_folder: Path) -> List[np.ndarray]:
    """T_world_cam of every picture that was taken in the air, none twice where a camera stood."""
    eyes = []
    for notes in sorted(sim_folder.glob("truth_cameras_*.csv")):
        ground_m, last = None, None
        for T in poses(notes):
            ground_m = T[2, 3] if ground_m is None else ground_m
            far = last is None or np.linalg.norm(T[:3, 3] - last[:3, 3]) > _APART_M
            if T[2, 3] > ground_m + _UP_M and (far or transforms.rotation_angle(last, T) > _APART_RAD):
                last = T
                eyes.append(T)
    return eyes


def poses(notes: Path) -> Iterator[np.ndarray]:
    """T_world_cam of each row."""
    with notes.open(newline="") as file:
        for row in csv.DictReader(file):
            if None not in row.values():  # it was cut off while it was written
                q = [float(row[k]) for k in ("qx", "qy", "qz", "qw")]
                yield transforms.from_xyz_quaternion([float(row[k]) for k in "xyz"], q)


if __name__ == "__main__":
    sys.exit(main())

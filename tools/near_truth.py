# SPDX-License-Identifier: Apache-2.0
"""How far the near field's points of a demo are from the true surfaces: python tools/near_truth.py out/demo"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import open3d as o3d

from fcsv_geometry import transforms
from fcsv_stereo.near.join import NEAR_BASELINE
from fcsv_stereo.truth import load_truth

_WRONG_M = 0.21  # 5 cm and 2 % of 8 m


def main() -> int:
    """Exit status 1 where the map has no near field."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="folder of a demo that was flown with NEAR=1")
    demo = parser.parse_args().demo
    reference = json.loads((demo / "map" / "report.json").read_text())["reference"]
    truth, (vehicle, stamp) = load_truth(demo / "session" / "truth"), reference["image"].split("/")
    T_world_home = truth.T_world_cam(vehicle, float(stamp)) @ transforms.invert(np.array(reference["T_home_cam"]))
    cloud = o3d.t.io.read_point_cloud(str(demo / "map" / "map.ply"))
    near = cloud.point["baseline"].numpy().ravel() == NEAR_BASELINE
    if not near.any():
        print("no near field")
        return 1
    points = transforms.apply(T_world_home, cloud.point.positions.numpy()[near].astype(float))
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.io.read_triangle_mesh(str(truth.mesh_path)))
    off_m = scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()
    median_cm, most_cm = 100.0 * np.percentile(off_m, [50, 90])
    print(f"{near.sum()} points; distance to the nearest true surface: median {median_cm:.1f} cm")
    print(f"90 % within {most_cm:.1f} cm, within {_WRONG_M} m {(off_m < _WRONG_M).mean():.1%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

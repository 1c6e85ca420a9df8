# SPDX-License-Identifier: Apache-2.0
"""Truth, where it is known: a triangle mesh, true camera poses (docs/design/decisions/0001), and
what moved."""

import csv
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, Iterator, Optional, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.errors import GeometryError
from fcsv_stereo.errors import InputError
from fcsv_stereo.evaluating import raycast
from fcsv_stereo.model import ImageEntry, Reference

Poses = Dict[Tuple[str, int], np.ndarray]
# of the distance: what is so much nearer is before a place, and not a part of the same thing
_HIDES = 0.97


@dataclass(frozen=True)
class Truth:
    """``cameras``: true T_world_cam by vehicle and stamp in milliseconds; ``movers`` likewise
    T_world_body by name of what moved, each with its mesh in movers/NAME.ply beside.
    """

    mesh_path: Path
    cameras: Poses
    movers: Poses = field(default_factory=dict)

    def T_world_cam(self, vehicle: str, stamp_s: float) -> np.ndarray:
        """True pose of a picture. Raises InputError where it is not in cameras.csv."""
        found = _at(self.cameras, vehicle, stamp_s)
        if found is None:
            raise InputError(
                f"{self.mesh_path.parent / 'cameras.csv'}: no pose of {vehicle} at {stamp_s:.3f} s"
            )
        return found

    def depth(self, reference: Reference) -> np.ndarray:
        """True depth (H,W float32, m along the optical axis, NaN where the sky is) of the reference
        picture."""
        return TrueScene(self).depth(reference.vehicle, reference.stamp_s, reference.camera)

    def relative_errors(self, reference: Reference, image: ImageEntry) -> Tuple[float, float]:
        """Rotation error (deg) and position error (m) of a picture's pose relative to the reference
        picture."""
        true = transforms.invert(self.T_world_cam(reference.vehicle, reference.stamp_s))
        true = true @ self.T_world_cam(image.vehicle, image.stamp_s)
        found = transforms.invert(reference.T_home_cam) @ image.T_home_cam
        angle = transforms.rotation_angle(true, found)
        return float(np.degrees(angle)), float(np.linalg.norm(true[:3, 3] - found[:3, 3]))


class TrueScene:
    """The meshes, to be looked at more than once. Raises InputError where there are none."""

    def __init__(self, truth: Truth):
        self._truth, self._still = truth, _scene(truth.mesh_path)
        self._moving = {}  # by name, read when first looked at

    def depth(self, vehicle: str, stamp_s: float, camera: PinholeCamera) -> np.ndarray:
        """True depth (H,W float32, m along the optical axis, NaN where the sky is) of a picture."""
        return self.look(vehicle, stamp_s, camera)[0]

    def look(
        self, vehicle: str, stamp_s: float, camera: PinholeCamera
    ) -> Tuple[np.ndarray, Dict[str, np.ndarray]]:
        """That depth, and where in it (H,W bool) each thing is that moves; empty where it is not
        known to move.

        Raises InputError where it is not known where the picture was taken.
        """
        T_world_cam = self._truth.T_world_cam(vehicle, stamp_s)
        (depth, _), on = raycast.cast(self._still, T_world_cam, camera), {}
        for name, found in self._movers_alone(T_world_cam, stamp_s, camera):
            on[name] = np.isfinite(found) & ~(found >= depth)
            depth = np.where(on[name], found, depth)
            on = {n: m & ~on[name] if n != name else m for n, m in on.items()}
        return depth, on

    def unhidden(
        self, vehicle: str, stamp_s: float, camera: PinholeCamera
    ) -> Dict[str, np.ndarray]:
        """Where in a picture (H,W bool) each thing that moves would be if nothing stood before it;
        else as ``look``."""
        T_world_cam = self._truth.T_world_cam(vehicle, stamp_s)
        return {
            name: np.isfinite(found)
            for name, found in self._movers_alone(T_world_cam, stamp_s, camera)
        }

    def seen_by(
        self,
        other: str,
        vehicle: str,
        stamp_s: float,
        camera: PinholeCamera,
        depth: np.ndarray,
        on: np.ndarray,
    ) -> Optional[float]:
        """Share of the places ``on`` (H,W bool) a vehicle's picture, with its true ``depth`` (H,W,
        m), that another one with the same ``camera`` sees in that moment; None where it took no
        picture then."""
        if _at(self._truth.cameras, other, stamp_s) is None:
            return None
        T_other_cam = transforms.invert(
            self._truth.T_world_cam(other, stamp_s)
        ) @ self._truth.T_world_cam(vehicle, stamp_s)
        places = transforms.apply(T_other_cam, camera.rays()[on] * depth[on][:, None])
        ahead = places[places[:, 2] > 0.0]
        x, y = np.round(camera.project(ahead)).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
        nearest = self.depth(other, stamp_s, camera)[y[inside], x[inside]]
        return float((~(nearest < _HIDES * ahead[inside, 2])).sum()) / max(int(on.sum()), 1)

    def _movers_alone(
        self, T_world_cam: np.ndarray, stamp_s: float, camera: PinholeCamera
    ) -> Iterator[Tuple[str, np.ndarray]]:
        """Names and depths (H,W, m; NaN: none) of what is known to move, each as if it were
        alone."""
        for name in sorted({name for name, _ in self._truth.movers}):
            T_world_body = _at(self._truth.movers, name, stamp_s)
            if T_world_body is None:
                continue
            if name not in self._moving:
                self._moving[name] = _scene(self._truth.mesh_path.parent / "movers" / f"{name}.ply")
            yield (
                name,
                raycast.cast(
                    self._moving[name], transforms.invert(T_world_body) @ T_world_cam, camera
                )[0],
            )


def _at(poses: Poses, name: str, stamp_s: float):
    """Finds the pose of a stamp within a millisecond, or None."""
    key = round(stamp_s * 1000)
    return next(
        (poses[name, near] for near in (key, key - 1, key + 1) if (name, near) in poses), None
    )


def _scene(path: Path):
    """A mesh in its own frame, ready for rays."""
    reading = raycast.open3d().t.io
    if not path.is_file():
        raise InputError(
            f"{path}: does not exist; truth/ needs scene.ply, cameras.csv and meshes of what moves"
        )
    mesh = reading.read_triangle_mesh(str(path))
    if len(mesh.triangle.indices) == 0:
        raise InputError(f"{path}: holds no triangles")
    return raycast.scene_of(mesh)


def load_truth(folder: Path) -> Truth:
    """Loads the truth from ``folder``/scene.ply and cameras.csv, and, where something moved,
    movers.csv and movers/NAME.ply.

    Raises InputError naming the line that is wrong.
    """
    folder = Path(folder)
    moved = folder / "movers.csv"
    movers = _poses(moved, "name") if moved.is_file() else {}
    return Truth(folder / "scene.ply", _poses(folder / "cameras.csv", "vehicle"), movers)


def _poses(path: Path, name: str) -> Poses:
    """Rows of stamp_s, ``name``, x, y, z, qx, qy, qz, qw."""
    poses = {}
    try:
        with open(path, newline="") as file:
            for number, row in enumerate(csv.DictReader(file), 2):
                try:
                    p = [float(row[k]) for k in ("x", "y", "z")]
                    q = [float(row[k]) for k in ("qx", "qy", "qz", "qw")]
                    poses[row[name], round(float(row["stamp_s"]) * 1000)] = (
                        transforms.from_xyz_quaternion(p, q)
                    )
                except (KeyError, TypeError, ValueError, GeometryError) as error:
                    raise InputError(f"{path}, line {number}: not a pose ({error})") from error
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); truth/ needs scene.ply and cameras.csv"
        ) from error
    return poses

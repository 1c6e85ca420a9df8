# SPDX-License-Identifier: Apache-2.0
"""Whether the near field is where it is, and meets the map of distant configurations; the table is
in docs/lab/near.md.

.venv/bin/python tools/bench_near.py [--worlds village street] [--seeds 1 2 3] [--look-round] [--out
FOLDER]

Two vehicles hover 2 m and then 4 m apart, 2 m high, at the lane (the avenue) of a simulated world,
and take the pictures of which the map is made. Then they fly 24 m along it and turn to what stands
on both sides. Both carry a simulated D435F (2 frames a second: noise, range, holes) and a simulated
T265, whose odometry gives the poses; covariances are those of its drift. Truth is the renderer's.
Home is where uav1 began. The way is moved beside the lane until nothing stands within 1 m of it.

there: of the true surfaces that some frame showed within 8 m of its vehicle, the share with a point
of the near field within 5 cm and 2 % of that distance. By area, of all surfaces more than 0.3 m
above the ground that are within 8 m of a place of a vehicle: saw: those that some frame's camera
saw (within 8 m, in its field of view, nothing before them); in sight: those that a camera at one of
these places would see if it looked their way; in sight, joined: the same with the points of the
joined map, which has those of both baselines, too; all that stands: backs, tops and insides of
hedges, too. wrong: share of its points that are farther than that from every true surface.
--look-round: at the begin and after each leg both turn once around, in 18 s, instead of by 30
degrees to both sides. --out: pictures of the map and of the near field, a report.
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Tuple

import numpy as np
from scipy.spatial import cKDTree

from fcsv_geometry import transforms
from fcsv_geometry.home import Place
from fcsv_geometry.programs.workspace import bringup
from fcsv_geometry.vehicles.tracker import T265_PROFILE
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.render.renderer import Renderer
from fcsv_sim.sensors.camera import CameraParameters, SimulatedCamera
from fcsv_sim.sensors.depth_camera import DepthParameters, SimulatedDepth
from fcsv_sim.sensors.t265 import T265
from fcsv_sim.world.town import Town
from fcsv_stereo.joint import Joint
from fcsv_stereo.map_files.output import write_ply
from fcsv_stereo.model import (
    FLOWN,
    Axis,
    Configuration,
    ConfigurationInput,
    MapInput,
    MapResult,
    Picture,
)
from fcsv_stereo.near import DepthFrame, DepthSensor, NearSurface, NearVolume, Thinning, join
from fcsv_stereo.report import write_report
from fcsv_tracking.column.camera_covariance import camera_covariance
from fcsv_tracking.column.drift import Drift
from harness import grid, head, line, measured

_HZ, _TRACKER_HZ, _SPEED_MPS, _HEIGHT_M, _BEGIN_M = 2.0, 50.0, 1.0, 2.0, 8.0
_LEGS = (
    (6.0, 0.0),
    (0.0, 0.5),
    (6.0, 0.0),
    (0.0, -1.0),
    (6.0, 0.0),
    (0.0, 0.5),
    (6.0, 0.0),
)  # m ahead, rad to the left
_ROUND = (0.0, 2.0 * np.pi)
_TURN_S = 4.0  # for a rad
_ROUND_TURN_S = 18.0 / (2.0 * np.pi)
_APART_M, _RECORDED_S = (2.0, 4.0), (2.0, 12.0)  # baselines, and when their pictures are taken
_WITHIN_M, _SHARE, _FIXED_M = 8.0, 0.02, 0.05
_CLEAR_M = 1.0
_PER_M2 = 100.0  # points of all that stands
_EVERY = 7  # pixels of the truth
_BEFORE_M = 0.02  # what is nearer to a point than this hides nothing of it
_STANDING_M = 0.3  # above the ground below uav1: not of the ground
_TRACKER = np.diag([0.005**2] * 3 + [np.radians(0.1) ** 2] * 3)  # of the odometry's own


@dataclass(frozen=True)
class Part:
    """``points`` of what stands, and the share of them that is in the near field."""

    points: int
    there: float

    @staticmethod
    def of(there: np.ndarray) -> "Part":
        """``there`` (N,) bool."""
        return Part(len(there), float(there.mean()) if len(there) else float("nan"))

    @property
    def words(self) -> str:
        """For a table."""
        return f"{self.there:.1%} of {self.points:,}" if self.points else "nothing"


@dataclass(frozen=True)
class Standing:
    """All that stands within 8 m: ``points_home_m`` (N,3); from the nearest place of a vehicle,
    ``distance_m`` (N,); ``shown_m`` and ``in_sight_m`` (N,) from the nearest camera that saw it, or
    would have by looking its way; infinite where none."""

    points_home_m: np.ndarray
    distance_m: np.ndarray
    shown_m: np.ndarray
    in_sight_m: np.ndarray


@dataclass(frozen=True)
class Row:
    """One flight."""

    world: str
    seed: int
    frames: int
    seconds: float
    points: int
    true_points: int
    there: float
    standing: int
    standing_there: float
    saw: "Part"
    in_sight: "Part"
    in_sight_joined: "Part"
    all_standing: "Part"
    wrong: float
    median_m: float
    sigma_m: float
    within_1_sigma: float
    joined: MapResult


class Flown:
    """A vehicle on its way: truth, its tracker and what it says."""

    def __init__(self, name: str, renderer: Renderer, seed: int):
        geometry = load_vehicles(str(bringup() / "config" / "vehicles"), [name])[name]
        self.name, self._T_body_cam = name, geometry.T_body_cam
        lens = CameraParameters()
        self.camera = SimulatedCamera(
            renderer, geometry.T_body_cam, lens, 1000 * seed + geometry.system_id
        )
        self._depth = SimulatedDepth(
            self.camera.model, 1000 * seed + geometry.system_id, DepthSensor(), DepthParameters()
        )
        T_body_t265 = geometry.tracking_camera.T_body_part
        self._tracker, self._T_t265_body = (
            T265(T265_PROFILE, T_body_t265, 1000 * seed + geometry.system_id),
            transforms.invert(T_body_t265),
        )
        self._drift = Drift()
        self._T_home_odom: Optional[Place] = None

    def feel(self, stamp_s: float, T_world_body: np.ndarray, T_world_home: np.ndarray) -> None:
        """The tracker's next sample; the first one is calibrated by truth."""
        T_odom_t265, _, _ = self._tracker.odometry(stamp_s, T_world_body)
        self._T_odom_body = T_odom_t265 @ self._T_t265_body
        if self._T_home_odom is None:
            T = (
                transforms.invert(T_world_home)
                @ T_world_body
                @ transforms.invert(self._T_odom_body)
            )
            self._T_home_odom = Place(T, np.diag([0.01**2] * 3 + [np.radians(0.1) ** 2]))
        self._drift.add(stamp_s, self._T_odom_body[:3, 3])

    def look(
        self, stamp_s: float, T_world_body: np.ndarray, samples: int = 1
    ) -> Tuple[DepthFrame, Picture, np.ndarray, np.ndarray]:
        """A frame and a picture as said, and the truth: depth (H,W) and T_world_cam."""
        shot = self.camera.shoot(stamp_s, T_world_body, samples=samples)
        T_home_cam = self._T_home_odom.T_a_b @ self._T_odom_body @ self._T_body_cam
        C = camera_covariance(
            self._T_home_odom, self._T_odom_body, self._T_body_cam, self._drift, _TRACKER
        )
        measured, model = self._depth.measure(shot.depth, shot.rgb), self.camera.model
        frame = DepthFrame.of_millimetres(self.name, stamp_s, measured, model, T_home_cam, C)
        picture = Picture.undistorted(
            f"{self.name}/{stamp_s:.3f}", self.name, stamp_s, shot.rgb, model, T_home_cam, C
        )
        return frame, picture, shot.depth, shot.T_world_cam


def way(
    town: Town, aside_m: float, look_round: bool = False
) -> Iterator[Tuple[float, np.ndarray, float]]:
    """Stamp, position (x, y, yaw) of the middle between both vehicles in the world, and how far
    they are apart.

    ``aside_m``: how far to the left of the lane's middle.
    """
    plan, s, turn, n = town.plan, _BEGIN_M, 0.0, 0
    lane_t = (float(plan.avenues_t[1]) if len(plan.avenues_t) else 0.0) + aside_m
    wider_m = _APART_M[1] - _APART_M[0]
    hover = [
        (0.0, 0.0, 4.0, 0.0),
        (0.0, 0.0, 6.0, wider_m),
        (0.0, 0.0, 4.0, 0.0),
        (0.0, 0.0, 6.0, -wider_m),
    ]
    apart_m, legs = _APART_M[0], _LEGS
    if look_round:
        legs = (_ROUND, *(leg for metres, _ in _LEGS if metres for leg in ((metres, 0.0), _ROUND)))
    for metres, radians, seconds, wider_m in [
        *hover,
        *(
            (m, r, max(m / _SPEED_MPS, (_ROUND_TURN_S if look_round else _TURN_S) * abs(r)), 0.0)
            for m, r in legs
        ),
    ]:
        steps = int(seconds * _TRACKER_HZ)
        for _ in range(steps):
            s, turn, apart_m, n = (
                s + metres / steps,
                turn + radians / steps,
                apart_m + wider_m / steps,
                n + 1,
            )
            yield (
                n / _TRACKER_HZ,
                np.array([*plan.world(s, lane_t)[:2], plan.heading(s) + turn]),
                apart_m,
            )


def clear(town: Town) -> float:
    """How far beside the lane nothing stands within ``_CLEAR_M`` of a vehicle's way: nobody flies
    through a hedge."""
    distance_to, random = scene(town, np.eye(4)), np.random.default_rng(0)
    for aside_m in (0.0, 1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0, -4.0, 6.0, -6.0):
        places = [
            T[:3, 3]
            for _, at, apart_m in list(way(town, aside_m))[::10]
            for T in bodies(at, apart_m, random).values()
        ]
        if distance_to(np.array(places)).min() > _CLEAR_M:
            return aside_m
    raise SystemExit(f"{town.plan}: no free way beside the lane")


def bodies(at: np.ndarray, apart_m: float, random) -> Dict[str, np.ndarray]:
    """T_world_body of both, with the sway of a hovering quadrotor."""
    x, y, yaw = at
    across = 0.5 * apart_m * np.array([-np.sin(yaw), np.cos(yaw)])
    found = {}
    for name, side in (("uav1", 1.0), ("uav2", -1.0)):
        xyz = [x + side * across[0], y + side * across[1], _HEIGHT_M]
        found[name] = transforms.from_xyz_rpy(xyz, [*random.normal(0.0, 0.012, 2), yaw])
    return found


def flight(world: str, seed: int, look_round: bool = False) -> Row:
    """One row of the table."""
    town = Town.generate(seed, world)
    renderer, random = Renderer(town), np.random.default_rng([seed, 31])
    vehicles = {name: Flown(name, renderer, seed) for name in ("uav1", "uav2")}
    T_world_home, aside_m = None, clear(town)
    frames: List[DepthFrame] = []
    true_points, ranges, places, eyes = [], [], [], []
    pictures: Dict[str, List[Picture]] = {"uav1": [], "uav2": []}
    for n, (t, at, apart_m) in enumerate(way(town, aside_m, look_round)):
        if T_world_home is None:
            T_world_home = transforms.from_xyz_yaw([at[0], at[1], _HEIGHT_M], at[2])
        T_world = bodies(at, apart_m, random)
        for name, flown in vehicles.items():
            flown.feel(t, T_world[name], T_world_home)
            if n % int(_TRACKER_HZ / _HZ) == 0:
                frame, _, depth, T_world_cam = flown.look(t, T_world[name])
                frames.append(frame)
                p, r = within(depth, flown.camera.model, T_world_cam, T_world_home)
                true_points.append(p), ranges.append(r), places.append(T_world[name][:3, 3])
                eyes.append(T_world_cam)
        if t in _RECORDED_S:
            for name, flown in vehicles.items():
                pictures[name].append(flown.look(t, T_world[name], 5)[1])
    started = time.perf_counter()
    volume, counted = NearVolume(), {}
    thinning = Thinning()
    for frame in frames:
        if not thinning.takes(frame.vehicle, frame.stamp_s, frame.T_home_cam):
            continue
        volume.integrate(frame)
        counted[frame.vehicle] = counted.get(frame.vehicle, 0) + 1
    surface = volume.surface()
    seconds = time.perf_counter() - started
    joined = join(far_map(pictures), surface, counted, [pictures["uav1"][0]])
    return judged(
        world,
        seed,
        counted,
        seconds,
        surface,
        np.concatenate(true_points),
        np.concatenate(ranges),
        all_standing(town, np.array(places), eyes, vehicles["uav1"].camera.model, T_world_home),
        scene(town, T_world_home),
        joined,
    )


def within(depth, camera, T_world_cam, T_world_home):
    """True points in home (N,3) that a picture shows within 8 m, and their distances (N,)."""
    rays, z = camera.rays()[::_EVERY, ::_EVERY].reshape(-1, 3), depth[::_EVERY, ::_EVERY].ravel()
    p_cam = rays * z[:, None]
    distance = np.linalg.norm(p_cam, axis=1)
    near = distance <= _WITHIN_M
    T_home_cam = transforms.invert(T_world_home) @ T_world_cam
    return transforms.apply(T_home_cam, p_cam[near]), distance[near]


def scene(town: Town, T_world_home: np.ndarray):
    """The true surfaces, in home."""
    import open3d as o3d

    mesh = o3d.t.geometry.RaycastingScene()
    vertices = transforms.apply(
        transforms.invert(T_world_home), town.vertices.astype(float)
    ).astype(np.float32)
    mesh.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(town.triangles.astype(np.uint32)))
    return lambda points: mesh.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def far_map(pictures: Dict[str, List[Picture]]) -> MapResult:
    """Of the pictures of both baselines, before the first of uav1."""
    reference = pictures["uav1"][0]
    found = []
    for baseline_m, own, other in zip(_APART_M, pictures["uav1"], pictures["uav2"]):
        found.append(
            ConfigurationInput(
                Configuration(Axis.HORIZONTAL, baseline_m, 0.0, f"horizontal {baseline_m:g} m"),
                [reference if not found else own],
                [other],
            )
        )
    return Joint().map(MapInput("session", found, prior=FLOWN), Joint().options())


def all_standing(
    town: Town, places_m: np.ndarray, eyes: List[np.ndarray], camera, T_world_home
) -> Standing:
    """100 points to the square metre of all that stands within 8 m of a place (world), and which of
    them the cameras at ``eyes`` (T_world_cam each) saw."""
    corners = town.vertices[town.triangles].astype(float)
    tree, random = cKDTree(places_m), np.random.default_rng(3)
    a, b, c = np.moveaxis(corners, 1, 0)
    size = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    near = tree.query(corners.mean(axis=1))[0] <= _WITHIN_M + size
    a, b, c = a[near], b[near], c[near]
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    k = np.repeat(np.arange(len(a)), random.poisson(_PER_M2 * area))
    u, v = random.random((2, len(k), 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    points = a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k])
    distance = tree.query(points)[0]
    points_home = transforms.apply(transforms.invert(T_world_home), points)
    kept = (distance <= _WITHIN_M) & (points_home[:, 2] > _STANDING_M - _HEIGHT_M)
    return Standing(points_home[kept], distance[kept], *seen_from(town, points[kept], eyes, camera))


def seen_from(
    town: Town, points: np.ndarray, eyes: List[np.ndarray], camera
) -> Tuple[np.ndarray, np.ndarray]:
    """(N,) m each, of points (N,3; world): from the nearest of the cameras (T_world_cam) that has
    one in its picture and nothing before it, and from the nearest with nothing before it; infinite
    where none within 8 m."""
    import open3d as o3d

    mesh = o3d.t.geometry.RaycastingScene()
    mesh.add_triangles(
        o3d.core.Tensor(town.vertices.astype(np.float32)),
        o3d.core.Tensor(town.triangles.astype(np.uint32)),
    )
    shown, in_sight = np.full((2, len(points)), np.inf)
    for T_world_cam in eyes:
        at = T_world_cam[:3, 3]
        distance = np.linalg.norm(points - at, axis=1)
        k = np.nonzero(distance <= _WITHIN_M)[0]
        short = (points[k] - at) * (1.0 - _BEFORE_M / distance[k])[:, None]
        rays = np.concatenate([np.broadcast_to(at, short.shape), short], axis=1).astype(np.float32)
        k = k[~mesh.test_occlusions(o3d.core.Tensor(rays), tnear=0.0, tfar=1.0).numpy()]
        in_sight[k] = np.minimum(in_sight[k], distance[k])
        x, y, z = transforms.apply(transforms.invert(T_world_cam), points[k]).T
        z = np.where(z > 0.0, z, np.nan)
        column, row = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        k = k[
            (column >= 0) & (column <= camera.width - 1) & (row >= 0) & (row <= camera.height - 1)
        ]
        shown[k] = np.minimum(shown[k], distance[k])
    return shown, in_sight


def judged(
    world,
    seed,
    counted,
    seconds,
    surface: NearSurface,
    true,
    ranges,
    everything: Standing,
    distance_to,
    joined,
) -> Row:
    """Against the truth."""
    points = surface.points()
    tree = cKDTree(points.points_home_m)
    from_m = tree.query(everything.points_home_m)[0]

    of_both = np.concatenate([points.points_home_m, joined.cloud.points_home_m])
    from_joined_m = cKDTree(of_both).query(everything.points_home_m)[0]

    def within_of(range_m: np.ndarray, from_m: np.ndarray = from_m) -> Part:
        known = np.isfinite(range_m)
        return Part.of(from_m[known] <= _FIXED_M + _SHARE * range_m[known])

    there = tree.query(true)[0] <= _FIXED_M + _SHARE * ranges
    standing = true[:, 2] > _STANDING_M - _HEIGHT_M
    standing_there = float(there[standing].mean()) if standing.any() else float("nan")
    off = distance_to(points.points_home_m)
    allowed = _FIXED_M + _SHARE * _WITHIN_M
    return Row(
        world,
        seed,
        sum(counted.values()),
        seconds,
        len(points),
        len(true),
        float(there.mean()),
        int(standing.sum()),
        standing_there,
        *map(within_of, (everything.shown_m, everything.in_sight_m)),
        within_of(everything.in_sight_m, from_joined_m),
        within_of(everything.distance_m),
        float((off > allowed).mean()),
        float(np.median(off)),
        float(np.median(points.sigma_m)),
        float((off <= points.sigma_m).mean()),
        joined,
    )


_HEAD = (
    "world, seed",
    "frames",
    "time",
    "points",
    "there",
    "there, what stands",
    "saw",
    "in sight",
    "in sight, joined",
    "all that stands",
    "wrong",
    "off, median",
    "sigma, median",
    "within sigma",
    "seam",
    "seam at",
    "seam, step",
    "seam, size",
)


def cells(r: Row) -> List[str]:
    """A row of the table."""
    n = r.joined.near
    standing = f"{r.standing_there:.1%} of {r.standing:,}" if r.standing else "nothing"
    seam = ["none", "–", "–", "–"]
    if n.step is not None:
        seam = [
            f"{n.shared:,} px",
            f"{n.from_m:.1f} to {n.to_m:.1f} m",
            f"{n.step:+.1%}",
            f"{n.apart:.1%}",
        ]
    return [
        f"{r.world} {r.seed}",
        str(r.frames),
        f"{r.seconds:.0f} s",
        f"{r.points:,}",
        f"{r.there:.1%}",
        standing,
        r.saw.words,
        r.in_sight.words,
        f"{r.in_sight_joined.there:.1%}",
        r.all_standing.words,
        f"{r.wrong:.1%}",
        f"{1e3 * r.median_m:.0f} mm",
        f"{1e3 * r.sigma_m:.0f} mm",
        f"{r.within_1_sigma:.0%}",
        *seam,
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", nargs="+", default=["village", "street"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument(
        "--look-round", action="store_true", help="turn once around at five places of the way"
    )
    parser.add_argument("--out", type=Path, help="folder for a cloud and a report of each flight")
    args = parser.parse_args()
    cases = grid(world=args.worlds, seed=args.seeds, look_round=[args.look_round])
    print(head(_HEAD), flush=True)
    for _, row in measured(flight, cases):
        print(line(cells(row)), flush=True)
        if args.out:
            folder = args.out / f"{row.world}_{row.seed}"
            folder.mkdir(parents=True, exist_ok=True)
            write_report(row.joined, folder)
            write_ply(row.joined.cloud, folder / "map.ply")


if __name__ == "__main__":
    main()

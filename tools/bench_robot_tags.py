# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/lab/guidance.md: a robot is located by the tags on its sides, in drawn pictures; at
distances, and along a drive with wheels between."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from fcsv_geometry import rotations, transforms
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_guidance.messages import DriveCommand
from fcsv_guidance.place.tag_fix import tag_fix
from fcsv_guidance.place.tracker import PlaceRules, RobotTracker
from fcsv_guidance.robot import load_robot
from fcsv_sim.robot.drive import SimulatedRobot, WheelFlaws
from fcsv_sim.trials.tagged_robot import PoseNoise, TagViewer
from fcsv_sim.world.town import Town
from fcsv_tracking.errors import SampleRejected
from harness import LAB, ROOT, provenance, rms, table, write

ROBOT = load_robot(ROOT / "config" / "robots" / "rescue.yaml")
VEHICLE = load_vehicles(ROOT / "config" / "vehicles", ["uav1"])["uav1"]
SLOPE_RAD = float(np.arctan(ROBOT.largest_slope))
WITHIN = float(chi2.ppf(0.9545, 2))
FREE_TO_M = 8.0  # x up to which nothing hides the robot
SHARES = (0.25, 0.7)  # of a fix's variance that the next one shares
_AT_DISTANCES = (
    "tag, distance",
    "edge (px)",
    "read",
    "x and y: rms (worst); stated, median (m)",
    "within 2 sigma",
    "yaw measured",
    "its rms (deg); within 2 sigma",
)
_DRIVES = (
    "20 m in curves, a vehicle 12 m behind, wheels between",
    "pictures read",
    "share of the variance that lasts",
    "place, rms (worst) (m)",
    "within 2 sigma",
    "yaw, rms (worst) (deg); within 2 sigma",
    "known",
)


def viewer(size_m, seed):
    """Tags of a size in a middle that leaves room for their boards."""
    half_m, z_m = 0.628 * size_m, max(0.41, 0.13 + 0.625 * size_m)
    turns = [t.mount.rpy_deg for t in ROBOT.tags]
    xyz_m = [(np.sign(t.mount.xyz_m[0]), np.sign(t.mount.xyz_m[1])) for t in ROBOT.tags]
    tags = [
        replace(
            t,
            size_m=size_m,
            mount=replace(t.mount, xyz_m=(x * half_m, y * half_m, z_m), rpy_deg=turn),
        )
        for t, turn, (x, y) in zip(ROBOT.tags, turns, xyz_m)
    ]
    return TagViewer(Town.generate(1, "plain"), VEHICLE, tags, seed), {t.id: t for t in tags}


def judged(fix, T_world_robot):
    """x and y off (m), their squared sigmas, what is stated (m); yaw off (deg; NaN where not
    measured), in sigmas."""
    off = np.array([fix.x_m, fix.y_m]) - T_world_robot[:2, 3]
    turned_rad = rotations.wrap(fix.yaw_rad - transforms.yaw(T_world_robot))
    C = fix.covariance[:2, :2]
    sigma_rad = np.sqrt(fix.covariance[2, 2])
    turned_rad = turned_rad if np.isfinite(sigma_rad) else np.nan
    d2 = off @ np.linalg.solve(C, off)
    return np.hypot(*off), d2, np.trace(C) ** 0.5, np.degrees(turned_rad), turned_rad / sigma_rad


def at_distance(size_m, distance_m, pictures, seed=1):
    """A row: pictures of the robot at any bearing, leaning by 3 degrees."""
    view, tags = viewer(size_m, seed)
    random = np.random.default_rng([seed, int(100 * size_m), int(distance_m)])
    found = []
    for k in range(pictures):
        T_world_robot = transforms.from_xyz_rpy(
            [FREE_TO_M, random.uniform(-0.15, 0.15) * distance_m, 0.0],
            [*random.normal(0.0, np.radians(3.0), 2), random.uniform(-np.pi, np.pi)],
        )
        height_m = 0.5 + min(2.6, 0.25 * distance_m)
        T_world_body = transforms.from_xyz_rpy(
            [FREE_TO_M - distance_m, 0.0, height_m], random.normal(0.0, 0.02, 3)
        )
        sight = view.look(float(k), T_world_body, T_world_robot, PoseNoise().error(random))
        try:
            found.append(judged(tag_fix(sight, tags, SLOPE_RAD), T_world_robot))
        except SampleRejected:
            continue
    row = [f"{size_m:g} m, {distance_m:g} m", f"{602 * size_m / distance_m:.0f}"]
    row.append(f"{len(found)} of {pictures}")
    if not found:
        return (*row, "–", "–", "–", "–")
    off_m, d2, stated_m, turned_deg, turns = np.array(found).T
    known = np.isfinite(turned_deg)
    yaw = f"{rms(turned_deg[known]):.1f}; {np.mean(np.abs(turns[known]) < 2):.0%}"
    return (
        *row,
        f"{rms(off_m):.2f} ({off_m.max():.2f}); {np.median(stated_m):.2f}",
        f"{np.mean(d2 < WITHIN):.0%}",
        f"{known.mean():.0%}",
        yaw if known.any() else "–",
    )


def along_a_drive(seed, behind_m=12.0):
    """Rows: 20 m in curves, wheels that slip, a picture each half second of a vehicle behind whose
    own place is off by what changes in 25 s."""
    view, tags = viewer(ROBOT.tags[0].size_m, seed)
    random = np.random.default_rng([seed, 7])
    machine = SimulatedRobot(ROBOT, (-12.0, 0.0, 0.0), WheelFlaws.drawn(random), seed)
    trackers = {s: RobotTracker(PlaceRules(common_share=s)) for s in SHARES}
    noise, coming, pictures, read = PoseNoise(), [], 0, 0
    rows, error = {s: [] for s in SHARES}, noise.error(random)
    for step in range(1, 461):
        now_s = 0.1 * step
        if now_s > 4.0:
            machine.command(now_s, DriveCommand(0.55, 0.25 * np.sin(0.35 * now_s)))
        machine.step(now_s)
        T_world_robot = transforms.from_xyz_yaw([machine.x_m, machine.y_m, 0.0], machine.yaw_rad)
        if step % 5 == 0:
            error = 0.98 * error + np.sqrt(1 - 0.98**2) * noise.error(random)
            T_world_body = transforms.from_xyz_rpy(
                [machine.x_m - behind_m, 1.0, 3.0], random.normal(0.0, 0.02, 3)
            )
            pictures += 1
            try:
                sight = view.look(now_s, T_world_body, T_world_robot, error)
                coming.append((now_s + 0.3, tag_fix(sight, tags, SLOPE_RAD)))
                read += 1
            except SampleRejected:
                pass
        due = [fix for at_s, fix in coming if at_s <= now_s]
        coming = coming[len(due) :]
        for share, tracker in trackers.items():
            for message in (machine.odometry(), *due):
                tracker.receive(now_s, message)
            state = tracker.step(now_s)
            if state.place is not None:
                place = state.place
                off_m = np.hypot(place.x_m - machine.x_m, place.y_m - machine.y_m)
                turned_rad = rotations.wrap(place.yaw_rad - machine.yaw_rad)
                row = off_m, off_m / place.sigma_m, turned_rad, turned_rad / state.yaw_sigma_rad
                rows[share].append(row)
    return [told(seed, f"{read} of {pictures}", share, rows[share]) for share in SHARES]


def told(seed, read, share, rows):
    """One line of the table of drives."""
    off_m, sigmas, turned_rad, turns = np.array(rows).T
    turned_deg = np.degrees(turned_rad)
    return (
        seed,
        read,
        share,
        f"{rms(off_m):.2f} ({off_m.max():.2f})",
        f"{np.mean(sigmas < 2):.0%}",
        f"{rms(turned_deg):.1f} ({np.abs(turned_deg).max():.1f}); {np.mean(np.abs(turns) < 2):.0%}",
        f"{len(rows) / 460:.0%}",
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", type=int, default=20)
    parser.add_argument("--small", type=float, nargs="*", default=[6.0, 9.0, 12.0, 15.0, 18.0])
    parser.add_argument("--large", type=float, nargs="*", default=[12.0, 18.0, 24.0, 30.0])
    parser.add_argument("--drives", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--out", type=Path, default=LAB / "guidance.md")
    args = parser.parse_args()
    sizes = ((ROBOT.tags[0].size_m, args.small), (1.0, args.large))
    distances = [at_distance(s, d, args.pictures) for s, all_m in sizes for d in all_m]
    drives = [row for seed in args.drives for row in along_a_drive(seed)]
    command = f"python tools/bench_robot_tags.py --pictures {args.pictures}"
    lines = [*table(_AT_DISTANCES, distances), "", *table(_DRIVES, drives), "", provenance(command)]
    write(args.out, "bench_robot_tags.py", lines)


if __name__ == "__main__":
    main()

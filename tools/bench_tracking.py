# SPDX-License-Identifier: Apache-2.0
"""Tracking's figures over ten seeds, on simulated truth; the table goes into docs/lab/tracking.md.

. devel/setup.sh && .venv/bin/python tools/bench_tracking.py [--seeds 10] [--only NAME ...]
"""

import argparse
import os
import tempfile
import time

import cv2
import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.home import places_in_home
from fcsv_geometry.ros import conversions
from fcsv_sim.machines.machines import Machine
from fcsv_sim.trials.formation import Formation, FormationParameters
from fcsv_tracking.column.calibration import calibrate_link
from fcsv_tracking.tags import ON_BOARD_DECIMATE, TagDetector
from harness import (
    LAB,
    ROOT,
    consistency_band,
    grid,
    kept,
    line,
    measured,
    provenance,
    table,
    write,
)

PAGE, SCRIPT = LAB / "tracking.md", "bench_tracking.py"


def column_errors(seed, parameters, rendered):
    """(m, deg, position sigma m, squared normalised error of 4) of the last vehicle against the
    first."""
    flight = Formation(seed, parameters)
    names, last = flight.names, parameters.vehicles - 1
    see = flight.seen if rendered else flight.detections
    links = [calibrate_link(names[k], names[k + 1], see(k + 1, k)) for k in range(last)]
    places = places_in_home(links, names[0], np.eye(4))
    estimated, true = flight.relative({n: p.T_a_b for n, p in places.items()}, last)
    covariance = places[names[-1]].at(flight.tracks[last].at(flight.end_s)[:3, 3])
    off = flight.tracks[0].at(flight.end_s)[:3, :3] @ (estimated - true)[:3, 3]
    error = np.array([*off, transforms.yaw(estimated) - transforms.yaw(true)])
    angle_deg = np.degrees(transforms.rotation_angle(estimated, true))
    sigmas = float(np.max(np.abs(error) / np.sqrt(np.diag(covariance))))
    return np.linalg.norm(off), angle_deg, sigmas, error @ np.linalg.solve(covariance, error)


def calibration_row(name, bound, seeds, parameters, rendered):
    cases = grid(seed=range(seeds), parameters=[parameters], rendered=[rendered])
    found = np.array([errors for _, errors in measured(column_errors, cases)])
    (median_m, median_deg), (worst_m, worst_deg) = (
        np.median(found[:, :2], axis=0),
        found[:, :2].max(axis=0),
    )
    low, high = consistency_band(seeds, degrees=4)
    return (
        name,
        bound,
        f"median {median_m:.3f} m, {median_deg:.2f}°; worst {worst_m:.3f} m, {worst_deg:.2f}°, "
        f"{found[:, 2].max():.1f} sigma",
        f"{found[:, 3].mean() / 4:.2f} ({low:.2f} to {high:.2f})",
    )


def two_vehicles(seeds):
    """Rendered pictures, real detector, vibration on, 3 to 4 m apart."""
    distances = [3.0, 3.5, 4.0]
    rows = []
    for distance_m in distances:
        parameters = FormationParameters(distance_m=distance_m)
        rows.append(
            calibration_row(
                f"two vehicles {distance_m:.1f} m apart, rendered VGA pictures, 0.16 m tag, vibration",
                "median 0.02 m, 0.2°; worst 0.05 m, 0.5°",
                seeds,
                parameters,
                True,
            )
        )
    return rows


def chain(seeds):
    """Corners with 0.15 px of noise (the detector's on rendered pictures is less): four links."""
    bound = "worst 0.15 m, 1.0°, inside 3 sigma"
    return [
        calibration_row(
            "chain of five, last against first",
            bound,
            seeds,
            FormationParameters(vehicles=5),
            False,
        )
    ]


def latency(seeds):
    """Pictures of the formation through the detector, and through the running node."""
    cv2.setNumThreads(1)
    flight = Formation(0, FormationParameters())
    pictures = [cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR) for _, gray in flight.pictures(1)]
    camera, detector = (
        flight.parameters.camera.model,
        TagDetector({1: 0.16}, ON_BOARD_DECIMATE, sharp=True),
    )
    took_ms, cpu_ms = [], []
    for _ in range(max(1, seeds // 2)):
        for bgr in pictures:
            begin_s, begin_cpu_s = time.perf_counter(), time.thread_time()
            detector.detect(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), camera)
            took_ms.append((time.perf_counter() - begin_s) * 1e3)
            cpu_ms.append((time.thread_time() - begin_cpu_s) * 1e3)
    p50, p95 = np.percentile(took_ms, [50, 95])
    on_topic = np.percentile(node_latency_ms(flight, pictures), [50, 95])
    return [
        (
            "picture to tag's pose, VGA, one core",
            "p95 ≤ 25 ms",
            f"median {p50:.1f} ms, p95 {p95:.1f} ms; processor time p95 {np.percentile(cpu_ms, 95):.1f} ms",
            "",
        ),
        (
            "picture published to pose on the topic (node)",
            "p95 ≤ 25 ms",
            f"median {on_topic[0]:.1f} ms, p95 {on_topic[1]:.1f} ms",
            "",
        ),
    ]


def node_latency_ms(flight, pictures):
    """From publishing a picture to hearing its detections; odometry is there beforehand, as it is
    on board."""
    with tempfile.TemporaryDirectory() as folder, Machine("bench", folder) as machine:
        os.environ.update({k: v for k, v in machine.env.items() if k.startswith("ROS_")})
        import rospy
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import CameraInfo, Image

        from fcsv_geometry.ros import node
        from fcsv_msgs.msg import TagDetections

        node.begin("bench", disable_signals=True)
        heard = {}
        vehicles = str(ROOT / "config" / "vehicles")
        for key, value in {
            "vehicle": "uav2",
            "vehicles": ["uav1", "uav2"],
            "vehicles_dir": vehicles,
            "rate_hz": 60.0,
            "search_rate_hz": 60.0,
        }.items():
            rospy.set_param(f"/uav2/tags/{key}", value)
        rospy.Subscriber(
            "/uav2/tags/detections",
            TagDetections,
            lambda m: heard.setdefault(
                round(m.header.stamp.to_sec(), 4), (time.perf_counter(), len(m.detections))
            ),
            tcp_nodelay=True,
        )
        image = rospy.Publisher(
            "/uav2/camera/color/image_raw", Image, queue_size=1, tcp_nodelay=True
        )
        info = rospy.Publisher("/uav2/camera/color/camera_info", CameraInfo, queue_size=1)
        body = rospy.Publisher("/uav2/odometry/body", Odometry, queue_size=50)
        process = machine.run(
            ["rosrun", "fcsv_tracking", "tags", "__name:=tags", "__ns:=uav2"], "tags"
        )
        try:
            while not (
                image.get_num_connections()
                and body.get_num_connections()
                and info.get_num_connections()
            ):
                time.sleep(0.05)
            time.sleep(0.5)
            took_ms = _show(flight, pictures, image, info, body, heard)
        finally:
            process.stop(grace_s=5.0)
            rospy.signal_shutdown("done")
    return took_ms


def _show(flight, pictures, image, info, body, heard):
    from nav_msgs.msg import Odometry

    sent, camera = {}, flight.parameters.camera.model
    for bgr in pictures * 2:
        stamp_s = round(time.time(), 4)
        info.publish(
            conversions.info_from_camera(camera, stamp_s, "uav2/camera_color_optical_frame")
        )
        for k in range(-4, 5):
            message = Odometry(header=conversions.header(stamp_s + 0.005 * k, "uav2/odom"))
            message.child_frame_id, message.pose.pose = (
                "uav2/base_link",
                conversions.transform_to_pose(np.eye(4)),
            )
            body.publish(message)
        picture = conversions.array_to_image(
            bgr, "bgr8", stamp_s, "uav2/camera_color_optical_frame"
        )
        time.sleep(0.02)
        sent[stamp_s] = time.perf_counter()
        image.publish(picture)
        time.sleep(0.08)
    time.sleep(0.5)
    took_ms = [
        (heard[s][0] - begin_s) * 1e3 for s, begin_s in sent.items() if s in heard and heard[s][1]
    ]
    if len(took_ms) < len(sent) / 2:
        raise RuntimeError(f"only {len(took_ms)} of {len(sent)} pictures came back with a tag")
    return took_ms


def with_rows(lines, rows):
    """The lines of a table with these rows in place of those of the same first cell."""
    new = {f" {row[0]} ": line(row) for row in rows}
    return [new.get((old.split("|") + [""])[1], old) for old in lines]


ROWS = {"two": two_vehicles, "chain": chain, "latency": latency}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument(
        "--only",
        nargs="+",
        choices=sorted(ROWS),
        help="these rows; only they change in the document",
    )
    args = parser.parse_args()
    rows = []
    for name in args.only or ROWS:
        new = ROWS[name](args.seeds)
        print(*map(line, new), sep="\n", flush=True)
        rows += new
    if args.only:
        lines = with_rows(kept(PAGE, SCRIPT).split("\n"), rows)
    else:
        titles = ("figure", "bound", "measured", "normalised squared error (95 % band)")
        note = provenance(f"make bench-tracking ARGS='--seeds {args.seeds}'")
        lines = [note, "", *table(titles, rows)]
    write(PAGE, SCRIPT, lines)


if __name__ == "__main__":
    main()

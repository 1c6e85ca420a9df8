# SPDX-License-Identifier: Apache-2.0
"""The demos of the gimbal and of the mocap system as a user starts them: a short mission, its session, its map.

Ctrl-C in a pair's flight: tests/fcsv_sim/test_demo_flights.py.
"""

import json
import re

import pytest
import rosbag
from support.demos import left_behind, said, start_demo

from fcsv_geometry import transforms
from fcsv_geometry.ros import conversions
from fcsv_geometry.vehicle import load_vehicles
from fcsv_sim.truth import TruthReader
from fcsv_stereo.truth import load_truth

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(1800)]

NAMES = ("tello1", "tello2")
MISSIONS = {
    "gimbal": "[{axis: horizontal, baseline_m: 1.5, record_s: 2.5}, {axis: vertical, baseline_m: 1.0, record_s: 2.5}]",
    "mocap": "[{axis: vertical, baseline_m: 1.0, record_s: 2.5}, {axis: vertical, baseline_m: 3.0, record_s: 2.5}]",
}
HEIGHTS_M = {"gimbal": 1.7, "mocap": 2.0}


def short_mission(folder, system):
    lines = [
        f"name: short\nreference: tello1\nhome_height_m: {HEIGHTS_M[system]}\nmin_separation_m: 0.7",
        "settle: {pose_age_s: 0.6, time_s: 1.0, hold_m: 0.2}",
        f"configurations: {MISSIONS[system]}",
    ]
    path = folder / "mission.yaml"
    path.write_text("\n".join(lines))
    return str(path)


@pytest.fixture(scope="module", params=sorted(MISSIONS))
def flown(request, tmp_path_factory):
    """(system, folder) of a demo flown and mapped to its end."""
    out = tmp_path_factory.mktemp(request.param)
    demo = start_demo(out, "--system", request.param, "--mission", short_mission(out, request.param))
    try:
        status = demo.wait(1200)
    finally:
        demo.kill()
    assert status == 0, said(out)[-4000:]
    return request.param, out


def test_it_ends_with_a_map_that_is_right(flown):
    """Up to 50 m: 1 m of baseline and 684 px hold 10 % of the distance to 68 m (3.1)."""
    _, out = flown
    report = json.loads((out / "map" / "report.json").read_text())
    near = report["truth"]["bands"][0]
    assert near["range_m"] == [0.0, 50.0] and near["within_10_percent"] >= 0.7
    assert len(report["configurations"]) == 2 and report["points"] > 10000
    assert all(word in said(out) for word in ("within 10 %", "report.html", "map.ply", "flown"))
    held_m = [float(m) for m in re.findall(r"held within ([0-9.]+) m", said(out))]
    assert len(held_m) == 2 and max(held_m) <= 0.2


def poses_in_session(folder, vehicles):
    """(vehicle, stamp): T_session_cam, as the tracker gave it."""
    poses = {}
    for name in NAMES:
        with rosbag.Bag(str(folder / f"{name}.bag")) as bag:
            for _, message, _ in bag.read_messages(topics=[f"/{name}/odometry/body"]):
                T = conversions.pose_to_transform(message.pose.pose)
                poses[name, message.header.stamp.to_sec()] = T @ vehicles[name].T_body_cam
    return poses


def test_pictures_bear_the_trackers_poses(flown, root):
    """Near the truth, as docs/gimbal.md and docs/mocap.md have it (3 cm: two cameras of 1 cm each and a lever arm of
    0.06 m; 2.5 % of the way for a leg of 3 m out of the mocap's view besides), and nowhere the truth itself."""
    _, out = flown
    truth = load_truth(out / "session" / "truth")
    poses = poses_in_session(out / "session", load_vehicles(root / "config" / "vehicles", NAMES))
    reference = min(k for k in poses if k[0] == "tello1")
    errors_m = []
    for key, T in poses.items():
        found = transforms.invert(poses[reference]) @ T
        true = transforms.invert(truth.T_world_cam(*reference)) @ truth.T_world_cam(*key)
        errors_m.append(abs(found[:3, 3] - true[:3, 3]).max())
    assert len(poses) >= 12 and max(errors_m) < 0.15
    assert min(e for k, e in zip(poses, errors_m) if k != reference) > 1e-5


def test_a_gimbals_map_is_in_the_ground_robots_frame(flown, root):
    """Which stands at the world's origin: 3 cm of place, and a degree and a half of heading at the camera."""
    system, out = flown
    if system != "gimbal":
        pytest.skip("the mocap's map is in home")
    report = json.loads((out / "map" / "report.json").read_text())["reference"]
    vehicle, _, stamp = report["image"].partition("/")
    true = load_truth(out / "session" / "truth").T_world_cam(vehicle, float(stamp))
    found = [row[3] for row in report["T_home_cam"][:3]]
    assert max(abs(a - b) for a, b in zip(found, true[:3, 3])) < 0.05


def test_both_have_landed_and_nothing_is_left_behind(flown):
    _, out = flown
    assert left_behind(out) == [] and not list((out / "session").glob("*.active"))
    for name in NAMES:
        assert TruthReader(out / "run" / "sim", name).latest()[1][2, 3] < 0.1

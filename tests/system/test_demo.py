# SPDX-License-Identifier: Apache-2.0
"""The whole thing, as a user starts it: three masters, a flight in real time, a map; and what
happens on Ctrl-C."""

import json
import re
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
from support.demos import left_behind, processes_of, said, start_demo, wait_for

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(1800)]


def bag_topics(path: Path):
    import rosbag

    with rosbag.Bag(str(path)) as bag:
        return {t: info.message_count for t, info in bag.get_type_and_topic_info().topics.items()}


def test_it_leaves_a_session_and_a_map(flown):
    for name in ("map.ply", "depth.npy", "sigma.npy", "report.json", "report.html"):
        assert (flown / "map" / name).stat().st_size > 0
    report = json.loads((flown / "map" / "report.json").read_text())
    depth = np.load(flown / "map" / "depth.npy")
    assert (
        depth.shape == (report["reference"]["height"], report["reference"]["width"])
        and depth.dtype == np.float32
    )
    for key in ("method", "images", "configurations", "coverage", "points", "timing_s"):
        assert key in report
    assert report["timing_s"]["total"] > 0 and report["points"] > 10000


def test_the_map_is_right(flown):
    """Far above the thesis's method on such pictures (docs/lab/benchmarks.md)."""
    truth = json.loads((flown / "map" / "report.json").read_text())["truth"]
    assert truth["within_10_percent"] >= 0.5


def test_bags_hold_what_a_map_needs(flown):
    for vehicle in ("uav1", "uav2"):
        topics = bag_topics(flown / "session" / f"{vehicle}.bag")
        for name in (
            "camera/color/image_raw",
            "camera/color/camera_info",
            "odometry/body",
            "tags/detections",
        ):
            assert topics.get(f"/{vehicle}/{name}", 0) > 20, (name, topics)
        assert "/tf_static" in topics
    topics = bag_topics(flown / "session" / "control.bag")
    assert topics["/mission/capture"] == 4 and topics["/calibration"] >= 1 and topics["/home"] >= 1


def test_set_points_are_held_while_recording(flown):
    errors_m = [float(m) for m in re.findall(r"held within ([0-9.]+) m", said(flown))]
    assert len(errors_m) == 4 and max(errors_m) <= 0.15


def test_the_window_s_verdicts_do_not_flip_and_are_the_map_s(flown):
    """The bags are played into the window's model; ten flights: docs/lab/results.md."""
    from bench_verdict import of_map, recordings

    accepted, seen = of_map(flown / "map"), recordings(flown / "session")
    assert len(seen) == 4 and all(r.verdicts and r.flips == 0 for r in seen), seen
    assert {r.name: r.verdicts[-1] for r in seen} == accepted


def test_only_listed_topics_cross(flown):
    topics = bag_topics(flown / "session" / "control.bag")
    assert not [t for t in topics if "image_raw" in t or "t265" in t or t.endswith("odometry/body")]


def test_the_end_says_where_everything_is(flown):
    text = said(flown)
    for words in ("within 10 %", "report.html", "map.ply", "flown", "moved"):
        assert words in text


def test_nothing_is_left_behind(flown):
    assert left_behind(flown) == []


def test_a_mission_that_cannot_be_flown_is_refused_before_anything_starts(tmp_path):
    """As a command; what else is refused, and in which words:
    tests/fcsv_sim/test_demo_systems.py."""
    (tmp_path / "bad.yaml").write_text("name: x\nconfigurations: []")
    command = [
        "rosrun",
        "fcsv_sim",
        "demo",
        "--out",
        str(tmp_path / "out"),
        "--mission",
        str(tmp_path / "bad.yaml"),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "bad.yaml" in done.stderr
    assert (
        all(w in done.stderr for w in ("configurations", "empty"))
        and not (tmp_path / "out").exists()
    )


def interrupted(demo, out) -> None:
    try:
        demo.send_signal(signal.SIGINT)
        assert demo.wait(300) == 130, said(out)[-3000:]
    finally:
        demo.kill()


def test_ctrl_c_before_anything_flies_ends_it_at_once(tmp_path):
    demo = start_demo(tmp_path, "--seed", "3", "--fly-only")
    wait_for(tmp_path, "building the street world", demo)
    interrupted(demo, tmp_path)
    assert not (tmp_path / "run" / "fleet.json").exists() and processes_of(tmp_path) == []


def test_ctrl_c_in_the_air_lands_and_cleans_up(tmp_path, root):
    """At 5 m: from higher up the same takes longer."""
    from fcsv_sim.truth import TruthReader

    short = (root / "config" / "missions" / "short.yaml").read_text()
    (tmp_path / "low.yaml").write_text(f"{short}home_height_m: 5.0\n")
    where = ("--mission", str(tmp_path / "low.yaml"), "--world", "plain", "--seed", "3")
    demo = start_demo(tmp_path, *where, "--fly-only")
    wait_for(tmp_path, "CONFIGURATIONS 1/4: uav2 on its way", demo)
    interrupted(demo, tmp_path)
    assert left_behind(tmp_path) == []
    for bag in (tmp_path / "session").glob("*.bag"):
        bag_topics(bag)  # readable: raises on an unindexed or truncated bag
    assert not list((tmp_path / "session").glob("*.active"))
    for vehicle in ("uav1", "uav2"):
        assert TruthReader(tmp_path / "run" / "sim", vehicle).latest()[1][2, 3] < 0.3
    assert bag_topics(tmp_path / "session" / "control.bag")["/home"] >= 1

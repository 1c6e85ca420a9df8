# SPDX-License-Identifier: Apache-2.0
"""The demo that guides a robot, as a user starts it: two vehicles map a maze, land, and the real
nodes guide the robot over their map.

A way that closes while it drives: tests/fcsv_sim/test_guided_robot.py, over a drawn map.
"""

import json
import re

import numpy as np
import pytest
from support.demos import end, left_behind, said, start_demo

from fcsv_sim.robot.guided import BAG, PICTURE
from fcsv_sim.robot.sent import ARRIVED
from fcsv_sim.world.town import Town

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(1800)]

#: Its fixes come as tags of 0.45 m are read (docs/lab/guidance.md).
WORLD, SEED = "low_maze", "56"


@pytest.fixture(scope="module")
def guided(tmp_path_factory):
    """The folder of a demo flown, mapped and driven to its end."""
    out = tmp_path_factory.mktemp("guide")
    demo = start_demo(out, "--mission", "guide", "--world", WORLD, "--seed", SEED)
    try:
        status = demo.wait(1200)
    finally:
        end(demo)
    assert status == 0, said(out)[-4000:]
    return out


def figure(text: str, name: str) -> float:
    """A number of the table that the demo ends with."""
    return float(re.search(rf"^{re.escape(name)}\s+([0-9.]+)", text, re.MULTILINE).group(1))


def test_the_robot_arrives_and_touches_nothing(guided):
    drive, text = json.loads((guided / "guide" / "drive.json").read_text()), said(guided)
    assert drive["ended"] == ARRIVED and "guidance: the goal is reached" in text, text[-3000:]
    assert figure(text, "contacts") == 0 and figure(text, "of the way, known free beforehand") > 90
    truth = np.genfromtxt(guided / "guide" / "truth_robot.csv", delimiter=",", names=True)
    assert truth["room_m"].min() > 0.1
    goal_x_m, goal_y_m = Town.generate(int(SEED), WORLD).plan.goal_m
    assert np.hypot(truth["x"][-1] - goal_x_m, truth["y"][-1] - goal_y_m) < 1.0


def test_it_drove_over_the_map_of_this_flight(guided):
    report = json.loads((guided / "map" / "report.json").read_text())
    assert report["truth"]["bands"][0]["within_10_percent"] >= 0.7
    assert len(report["configurations"]) == 3
    assert (guided / "map" / "ground" / "map.yaml").is_file()


def test_it_ends_with_a_picture_and_a_bag_that_holds_the_drive(guided):
    import rosbag

    assert (guided / "guide" / PICTURE).stat().st_size > 10_000
    with rosbag.Bag(str(guided / "guide" / BAG)) as bag:
        topics = bag.get_type_and_topic_info().topics
    for topic in ("/ground/map", "/ground/path", "/robot_pose", "/odom", "/cmd_vel", "/robot_fix"):
        assert topics[topic].message_count > 0, topic
    assert (guided / "play").is_file() and str(guided / "play") in said(guided)


def test_nothing_is_left_behind(guided):
    assert left_behind(guided) == []

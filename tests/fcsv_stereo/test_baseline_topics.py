# SPDX-License-Identifier: Apache-2.0
"""A map by its baselines: whatever the mission's are, for who listens and only then, thinned."""

import numpy as np
import pytest

from fcsv_stereo.in_flight.baseline_clouds import chosen, groups
from fcsv_stereo.map_files.output import write_ply
from fcsv_stereo.model import Cloud

BASELINES = [("horizontal", 2.0), ("vertical", 4.0)]


def cloud(index):
    n = len(index)
    points = np.arange(3.0 * n, dtype=np.float32).reshape(n, 3)
    colors, sigma = np.full((n, 3), 9, np.uint8), np.full(n, 0.5, np.float32)
    return Cloud(points, colors, sigma, np.array(index, np.uint8))


def test_thinning_is_even_and_takes_no_other_pair():
    c = cloud([0, 1] * 500 + [255])  # 255: the near field, which has no baseline
    assert chosen(c, [1]).tolist() == list(range(1, 1000, 2)) and not len(chosen(c, []))
    few = chosen(c, [0, 1], most=300)
    assert len(few) == 250 and set(np.diff(few)) == {4}


def test_two_pairs_of_one_length_share_a_name():
    assert groups([("horizontal", 6.0), ("horizontal", 6.01)])["horizontal_6m"] == [0, 1]


@pytest.fixture
def topics(monkeypatch):
    """The topics with publishers that keep what they are given; ``listeners``: who listens to
    which."""
    rospy = pytest.importorskip("rospy")
    from fcsv_stereo.ros import baseline_topics

    class Publisher:
        made, listeners = {}, set()

        def __init__(self, name, _kind, queue_size, subscriber_listener):
            assert name not in self.made and queue_size == 1
            self.name, self.listener, self.sent = name, subscriber_listener, []
            self.made[name] = self

        def get_num_connections(self):
            return int(self.name in self.listeners)

        def publish(self, message):
            self.sent.append(message)

    monkeypatch.setattr(rospy, "Publisher", Publisher)
    return baseline_topics.BaselineTopics(), Publisher


def lengths(message):
    from sensor_msgs import point_cloud2

    return [round(b, 3) for (b,) in point_cloud2.read_points(message, ["baseline_m"])]


def test_nothing_is_made_while_nobody_listens(topics):
    shown, publisher = topics
    assert set(publisher.made) == {"/map/baselines/horizontal", "/map/baselines/vertical"}
    shown.show(cloud([0, 0, 1]), BASELINES, 1.0)
    assert {"/map/baselines/horizontal_2m", "/map/baselines/vertical_4m"} < set(publisher.made)
    assert not any(p.sent for p in publisher.made.values())


def test_who_listens_gets_every_map_and_a_baseline_that_is_gone_is_emptied(topics):
    shown, publisher = topics
    publisher.listeners.update(publisher.made)
    shown.show(cloud([0, 0, 1]), BASELINES, 1.0)
    assert lengths(publisher.made["/map/baselines/horizontal"].sent[-1]) == [2.0, 2.0]
    assert lengths(publisher.made["/map/baselines/vertical"].sent[-1]) == [4.0]
    shown.show(cloud([0]), [("vertical", 7.0)], 2.0)
    assert lengths(publisher.made["/map/baselines/horizontal"].sent[-1]) == []
    assert lengths(publisher.made["/map/baselines/vertical"].sent[-1]) == [7.0]


def test_who_comes_late_gets_the_newest_map_for_himself(topics):
    shown, publisher = topics
    got = []
    shown.peer_subscribe("/map/baselines/vertical", None, got.append)
    assert not got  # there is no map yet
    shown.show(cloud([0, 1, 1]), BASELINES, 1.0)
    shown.peer_subscribe("/map/baselines/vertical_4m", None, got.append)
    assert lengths(got[0]) == [4.0, 4.0] and got[0].header.frame_id == "home"
    assert not publisher.made["/map/baselines/vertical_4m"].sent


@pytest.mark.parametrize("origin_m", [(0.0, 0.0, 0.0), (389000.0, 5819000.0, 0.0)])
def test_playback_shows_the_same_of_a_finished_map(topics, tmp_path, monkeypatch, origin_m):
    """One that is far from home's origin in a frame of its own, whose transform holds the shift."""
    import json

    import rospy

    from fcsv_stereo.ros import show_map_node

    shown, publisher = topics
    publisher.made.clear()
    write_ply(cloud([0, 1]), tmp_path / "map.ply", np.array(origin_m))
    sent = []
    broadcaster = type(
        "Broadcaster", (), {"sendTransform": lambda _self, transform: sent.append(transform)}
    )
    monkeypatch.setattr(show_map_node.tf2_ros, "StaticTransformBroadcaster", broadcaster)
    monkeypatch.setattr(
        rospy,
        "Publisher",
        lambda name, kind, queue_size, latch=False, subscriber_listener=None: publisher(
            name, kind, queue_size, subscriber_listener
        ),
    )
    rows = [{"axis": axis, "baseline_m": length} for axis, length in BASELINES]
    (tmp_path / "report.json").write_text(json.dumps({"configurations": rows}))
    show_map_node.publish_map(tmp_path)
    assert publisher.made["/map/points"].sent[0].width == 2
    assert {"/map/baselines/horizontal", "/map/baselines/vertical_4m"} < set(publisher.made)
    frame = publisher.made["/map/points"].sent[0].header.frame_id
    assert frame == ("map/local" if any(origin_m) else "home") and len(sent) == int(any(origin_m))
    got = []
    publisher.made["/map/baselines/horizontal"].listener.peer_subscribe(
        "/map/baselines/horizontal", None, got.append
    )
    assert got[0].header.frame_id == frame
    for transform in sent:
        moved = transform.transform.translation
        assert (transform.header.frame_id, transform.child_frame_id) == ("home", frame)
        assert (moved.x, moved.y, moved.z) == origin_m

# SPDX-License-Identifier: Apache-2.0
"""The live map on a real master: configurations come in one by one, or vehicles hold and are
watched."""

import time

import numpy as np
import pytest
from support.radio_pictures import NAMES, RadioPictures
from support.scenes import CAMERA, DEPTH_M
from support.waiting import within

pytestmark = pytest.mark.ros
until = within(40.0)


class Fleet(RadioPictures):
    """With ends of recordings; and what the map says."""

    def __init__(self):
        import rospy
        from sensor_msgs.msg import Image, PointCloud2

        from fcsv_msgs.msg import Capture, MapState

        super().__init__()
        self.captures = rospy.Publisher("/mission/capture", Capture, queue_size=5, latch=True)
        self.states, self.clouds, self.depths, self.shown, self.sites = [], [], [], [], []
        self.heard = [
            rospy.Subscriber("/map/state", MapState, self.states.append),
            rospy.Subscriber("/map/points", PointCloud2, self.clouds.append),
            rospy.Subscriber("/map/depth", Image, self.depths.append),
            rospy.Subscriber("/map/monitor", Image, self.shown.append),
            rospy.Subscriber("/map/site", PointCloud2, self.sites.append),
        ]

    def capture(self, index, vehicle, start_s, stop_s, station=""):
        import rospy

        from fcsv_msgs.msg import Capture, Configuration

        axis = Configuration.HORIZONTAL if vehicle == "l_two" else Configuration.VERTICAL
        configuration = Configuration(f"configuration {index}", axis, 1.0, 0.0, 2.0)
        self.captures.publish(
            Capture(
                index=index,
                configuration=configuration,
                reference="l_one",
                vehicle=vehicle,
                start=rospy.Time.from_sec(start_s),
                stop=rospy.Time.from_sec(stop_s),
                station=station,
            )
        )

    def listen(self, *names):
        import rospy
        from sensor_msgs.msg import PointCloud2

        self.of_baselines = {n: [] for n in names}
        for name, kept in self.of_baselines.items():
            self.heard.append(rospy.Subscriber(f"/map/baselines/{name}", PointCloud2, kept.append))

    def last(self, state):
        said = [s for s in self.states if s.state == state]
        return said[-1] if said else None

    def close(self):
        super().close()
        for each in (*self.heard, self.captures):
            each.unregister()


@pytest.fixture
def fleet(start_node):
    made = []

    def start(names=NAMES, **params):
        start_node(
            "fcsv_stereo", "live_map", ns="l_map", params={"vehicles": list(names), **params}
        )
        made.append(Fleet())
        until(lambda: made[-1].listened_to(names), what="the node")
        return made[-1]

    yield start
    for each in made:
        each.close()


def depth_of(message):
    from fcsv_geometry.ros import conversions

    assert message.encoding == "32FC1" and message.header.frame_id == "map/reference_optical"
    return conversions.image_to_array(message)


def test_each_configuration_adds_to_the_map(fleet):
    f = fleet()
    now = time.time()
    f.picture("l_one", now)
    f.picture("l_two", now + 0.1)
    f.capture(0, "l_two", now - 1.0, now + 1.0)  # before anybody knows where the vehicles are
    until(lambda: f.last("failed") is not None, what="a named error")
    assert "calibrate" in f.last("failed").detail
    f.frames()
    f.capture(0, "l_two", now - 1.0, now + 1.0)
    until(lambda: f.last("ready") is not None and f.clouds, what="a partial map")
    first = f.last("ready")
    assert first.configurations == 1 and first.points > 1000
    order = [s.state for s in f.states if s.state in ("partial", "ready")]
    assert order[0] == "partial" and f.last("partial").points > 1000  # a quick look came before
    relative = np.abs(depth_of(f.depths[-1]) / DEPTH_M - 1.0)
    # the wall; JPEG, one pair of 1 m at 20 m, 3 px of disparity for 10 %
    assert np.nanmedian(relative) < 0.05

    f.capture(1, "l_three", now + 9.0, now + 11.0)
    f.picture("l_one", now + 10.0)
    time.sleep(0.5)
    assert f.last("ready").configurations == 1  # nothing of the second vehicle yet
    f.picture("l_three", now + 10.0)
    until(lambda: f.last("ready").configurations == 2, what="the second configuration")
    assert f.clouds[-1].header.frame_id == "home" and f.clouds[-1].width == f.last("ready").points
    # to the points of either baseline, after they were mapped
    f.listen("horizontal", "vertical_1m")
    until(lambda: all(f.of_baselines.values()), what="both baselines' points")
    widths = [clouds[-1].width for clouds in f.of_baselines.values()]
    assert min(widths) > 100 and sum(widths) <= f.clouds[-1].width  # thinned, each


def test_stations_are_joined_as_they_come(fleet):
    f = fleet()
    f.frames()
    now = time.time()
    for k, (vehicle, station) in enumerate((("l_two", "south"), ("l_three", "north"))):
        at_s = now + 10.0 * k
        f.picture("l_one", at_s)
        f.picture(vehicle, at_s)
        f.capture(k, vehicle, at_s - 1.0, at_s + 1.0, station)
        until(lambda k=k: len([s for s in f.states if s.state == "ready"]) > k, what="a whole map")
        assert not f.sites or k, "one station is no site"
    until(lambda: f.sites, what="the joined stations")
    assert f.sites[-1].header.frame_id == "home" and f.sites[-1].width > 1000
    assert "sigma" in [field.name for field in f.sites[-1].fields]


def test_a_broken_picture_is_named_and_the_next_one_serves(fleet):
    f = fleet()
    f.frames()
    now = time.time()
    f.picture("l_one", now)
    f.picture("l_two", now, jpeg=b"no jpeg at all")
    f.capture(0, "l_two", now - 1.0, now + 1.0)
    until(lambda: f.last("failed") is not None, what="an error")
    assert "not a JPEG" in f.last("failed").detail
    f.picture("l_one", now + 10.0)
    f.picture("l_three", now + 10.0)
    f.capture(1, "l_three", now + 9.0, now + 11.0)
    until(lambda: f.last("ready") is not None, what="a map of the others")
    assert any("l_two" in p for p in f.last("ready").problems)


def test_monitoring_answers_again_and_again(fleet):
    f = fleet(monitor=True)
    f.frames()
    stamps = []

    def instant():
        stamps.append(time.time())
        for name in NAMES:
            f.picture(name, stamps[-1])

    until(lambda: len(f.depths) >= 3, what="three depth images", meanwhile=instant, every_s=0.3)
    assert f.last("ready").configurations == 2
    assert {(d.width, d.height) for d in f.depths} == {(CAMERA.width, CAMERA.height)}
    until(lambda: f.shown and f.last("ready").rate_hz > 0.0, what="their rate")
    assert f.last("ready").skew_s == 0.0 and (f.shown[-1].width, f.shown[-1].encoding) == (
        2 * CAMERA.width,
        "rgb8",
    )
    given = [round(d.header.stamp.to_sec(), 3) for d in f.depths]
    assert len(set(given)) == len(given) and set(given) <= {round(s, 3) for s in stamps}


def test_pictures_that_are_not_of_one_instant_are_told(fleet):
    f = fleet(monitor=True)
    f.frames()
    now = time.time()
    for k in range(9):
        for name in NAMES:
            f.picture(name, now + 0.5 * k + 0.09 * (name == "l_two"))
    until(lambda: f.last("failed") is not None, what="a named problem")
    assert (
        "90 ms apart (apart_s:=0.02): trigger the cameras together" in f.last("failed").detail
        and not f.depths
    )


def test_wrong_parameters_end_the_node_and_are_named(start_node):
    node = start_node(
        "fcsv_stereo", "live_map", ns="l_wrong", params={"vehicles": ["a", "b"], "method": "magic"}
    )
    until(lambda: node.returncode is not None, what="its end")
    assert node.returncode == 2 and "'magic' is not one of joint, thesis" in node.tail(20)


def test_bars_are_of_joint_alone():
    from fcsv_stereo.ros.live_node import LiveParameters

    assert LiveParameters(["a", "b"], bars=True).bars and not LiveParameters(["a", "b"]).bars
    with pytest.raises(ValueError, match="bars: the method 'thesis' does not match bars"):
        LiveParameters(["a", "b"], method="thesis", bars=True)
    with pytest.raises(ValueError, match="shown_from_m: 9.0 must lie in 0..shown_to_m"):
        LiveParameters(["a", "b"], shown_from_m=9.0, shown_to_m=8.0)

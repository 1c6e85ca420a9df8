# SPDX-License-Identifier: Apache-2.0
"""The recorder as a node on a real master: what is in the bag, and that it can be read whatever
ended it."""

import os
import signal
import time

import numpy as np
import pytest
import yaml
from support.waiting import within

from fcsv_control import recording
from fcsv_control.errors import SessionError
from fcsv_control.session import load_session, new_session, save_session, with_part
from fcsv_geometry.bags.parts import parts_in
from fcsv_geometry.bags.repair import repaired
from fcsv_geometry.errors import ConfigError
from fcsv_geometry.missions.mission import load_mission

ros = pytest.mark.ros
LATENCY_S = 1.0  # generous: a loaded machine with two cores
until = within(10.0)


@pytest.fixture
def vehicle(ros_master):
    """Publishes what a vehicle's nodes publish, in a namespace of its own."""
    import rospy
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import CameraInfo, Image
    from std_msgs.msg import Bool
    from tf2_msgs.msg import TFMessage

    from fcsv_msgs.msg import RecorderStatus
    from mavros_msgs.msg import State as VehicleState

    class Vehicle:
        def __init__(self, name):
            self.name = name
            topic = lambda t, kind, **more: rospy.Publisher(  # noqa: E731
                f"/{name}/{t}", kind, queue_size=100, **more
            )
            self.picture = topic("camera/color/image_raw", Image)
            self.info = topic("camera/color/camera_info", CameraInfo)
            self.odometry = topic("odometry/body", Odometry)
            self.state = topic("mavros/state", VehicleState)
            self.other = topic("not/listed", Odometry)
            self.on = topic("recorder/pictures", Bool, latch=True)
            self.tf_static = rospy.Publisher("/tf_static", TFMessage, queue_size=5, latch=True)
            self.status = None
            self.publishers = [
                self.picture,
                self.info,
                self.odometry,
                self.state,
                self.other,
                self.on,
                self.tf_static,
            ]
            self.watch = rospy.Subscriber(
                f"/{name}/recorder/status", RecorderStatus, self._on_status
            )
            self.Bool, self.Image, self.Odometry, self.CameraInfo = (
                Bool,
                Image,
                Odometry,
                CameraInfo,
            )

        def _on_status(self, message):
            self.status = message

        def wait_for_recorder(self):
            until(
                lambda: self.odometry.get_num_connections() and self.picture.get_num_connections()
            )

        def say(self, number):
            """One picture, its camera_info and ten odometry messages, all numbered."""
            for k in range(10):
                message = self.Odometry()
                message.header.seq, message.pose.pose.position.x = 10 * number + k, 10 * number + k
                self.odometry.publish(message)
            picture = self.Image(height=480, width=640, encoding="rgb8", step=1920)
            picture.header.stamp = rospy.Time.from_sec(100.0 + number)
            picture.data = np.full(480 * 1920, number % 256, np.uint8).tobytes()
            self.info.publish(self.CameraInfo(width=640))
            self.picture.publish(picture)

        def close(self):
            self.watch.unregister()
            for publisher in self.publishers:
                publisher.unregister()

    made = []

    def make(name):
        made.append(Vehicle(name))
        return made[-1]

    yield make
    for one in made:
        one.close()


def topics_of(path):
    import rosbag

    with rosbag.Bag(str(path)) as bag:
        return {t: i.message_count for t, i in bag.get_type_and_topic_info().topics.items()}


def record_vehicle(start_node, folder, name, **params):
    return start_node(
        "fcsv_control",
        "recorder",
        ns=name,
        params={"role": "vehicle", "name": name, "folder": str(folder), **params},
    )


@ros
def test_pictures_only_when_told_and_the_rest_always(vehicle, start_node, tmp_path):
    import rosbag

    v = vehicle("rec1")
    v.tf_static.publish()  # latched, before the recorder is there
    process = record_vehicle(start_node, tmp_path, "rec1")
    v.wait_for_recorder()
    for i in range(5):
        v.say(i)
        time.sleep(0.02)
    time.sleep(LATENCY_S)
    v.on.publish(True)
    until(lambda: v.status is not None and v.status.pictures_on)
    for i in range(5, 12):
        v.say(i)
        time.sleep(0.05)
    until(lambda: v.status.pictures == 7)
    v.on.publish(False)
    until(lambda: not v.status.pictures_on)
    v.say(12)
    time.sleep(LATENCY_S)
    assert (
        v.status.path == str(tmp_path / "rec1.bag")
        and not v.status.problem
        and v.status.dropped == 0
    )
    assert v.status.bytes > 7 * 480 * 1920
    assert (tmp_path / "rec1.bag.active").exists(), "not named a bag before it is whole"
    process.stop()
    assert process.returncode == 0, process.tail()

    with rosbag.Bag(str(tmp_path / "rec1.bag")) as bag:
        pictures = [m for _, m, _ in bag.read_messages("/rec1/camera/color/image_raw")]
        odometry = [m.pose.pose.position.x for _, m, _ in bag.read_messages("/rec1/odometry/body")]
        connections = {c.topic: c.header for c in bag._get_connections()}
    assert [p.header.stamp.to_sec() for p in pictures] == [100.0 + i for i in range(5, 12)]
    assert [p.data[0] for p in pictures] == list(range(5, 12)) and pictures[0].encoding == "rgb8"
    assert odometry == list(range(130)), "all of it, in order"
    assert topics_of(tmp_path / "rec1.bag")["/tf_static"] >= 1
    assert connections["/tf_static"]["latching"] in (b"1", "1"), "rosbag play has to latch it again"
    assert not [t for t in connections if "listed" in t]
    assert not (tmp_path / "rec1.bag.active").exists()


@ros
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_in_the_middle_the_bag_can_be_read(vehicle, start_node, tmp_path, number):
    name = f"rec_{number.name.lower()}"
    v = vehicle(name)
    process = record_vehicle(start_node, tmp_path, name, pictures_on=True)
    v.wait_for_recorder()
    for i in range(20):
        v.say(i)
        time.sleep(0.02)
        if i == 12:
            os.killpg(process.pid, number)
    until(lambda: process.returncode is not None, 20.0)
    assert process.returncode in (0, -number), process.tail()
    counts = topics_of(tmp_path / f"{name}.bag")  # raises on a bag without index
    assert counts[f"/{name}/camera/color/image_raw"] >= 5 and counts[f"/{name}/odometry/body"] >= 50
    assert not (tmp_path / f"{name}.bag.active").exists()


@ros
def test_a_second_flight_does_not_write_over_the_first(vehicle, start_node, tmp_path):
    earlier = tmp_path / "rec3.bag"
    earlier.write_bytes(b"the flight of yesterday")
    v = vehicle("rec3")
    process = record_vehicle(start_node, tmp_path, "rec3")
    v.wait_for_recorder()
    process.stop()
    kept = [p for p in tmp_path.glob("rec3.*.bag") if p != earlier]
    assert len(kept) == 1 and kept[0].read_bytes() == b"the flight of yesterday"
    assert "/rec3" not in str(topics_of(earlier))


@ros
def test_killed_in_the_middle_at_most_a_second_is_lost_and_the_next_one_goes_on_in_a_new_part(
    vehicle, start_node, tmp_path
):
    """A SIGKILL costs a second at most, as docs/lab/results.md measured it."""
    import rosbag

    v = vehicle("rec5")
    v.tf_static.publish()
    process = record_vehicle(start_node, tmp_path, "rec5", pictures_on=True)
    v.wait_for_recorder()
    sent_s = []
    for i in range(40):
        v.say(i)
        sent_s.append(time.monotonic())
        time.sleep(0.05)
    killed_s = time.monotonic()
    os.killpg(process.pid, signal.SIGKILL)
    until(lambda: process.returncode is not None)
    assert not (tmp_path / "rec5.bag").exists() and (tmp_path / "rec5.bag.active").exists()

    v.on.publish(True)  # latched, as the agent's
    again = record_vehicle(start_node, tmp_path, "rec5", pictures_on=False)
    until(
        lambda: (
            v.status is not None
            and v.status.path == str(tmp_path / "rec5.1.bag")
            and v.status.pictures_on
        )
    )
    until(lambda: v.say(40) or v.status.pictures)  # until the picture's topic is connected too
    again.stop()

    path, salvaged = repaired(tmp_path / "rec5.bag.active")
    with rosbag.Bag(str(path)) as bag:
        numbers = [m.pose.pose.position.x for _, m, _ in bag.read_messages("/rec5/odometry/body")]
        pictures = [
            m.header.stamp.to_sec() - 100.0
            for _, m, _ in bag.read_messages("/rec5/camera/color/image_raw")
        ]
    assert salvaged.topics["/rec5/odometry/body"] == len(numbers) and numbers == list(
        range(len(numbers))
    )
    assert pictures == list(range(len(pictures)))
    first_lost = min(int(numbers[-1] // 10) + 1, int(pictures[-1]) + 1)
    assert first_lost == 40 or killed_s - sent_s[first_lost] <= 1.0
    counts = topics_of(tmp_path / "rec5.1.bag")
    assert counts["/rec5/camera/color/image_raw"] >= 1 and counts["/tf_static"] >= 1


@ros
def test_a_full_disk_is_said_and_what_is_written_stays(vehicle, start_node, tmp_path):
    """As if less were free than wanted: more than any disk has."""
    v = vehicle("rec4")
    process = record_vehicle(start_node, tmp_path, "rec4", least_free_mib=1 << 30)
    v.wait_for_recorder()
    until(lambda: v.status is not None and v.status.problem)
    assert "are free on the disk" in v.status.problem and str(tmp_path) in v.status.problem
    until(lambda: (tmp_path / "rec4.bag").exists())  # closed at once, not when the node ends
    v.say(1)
    until(lambda: v.status.dropped >= 10)
    assert v.status.minutes_left == 0.0
    process.stop()
    topics_of(tmp_path / "rec4.bag")


@ros
def test_the_control_pc_describes_the_session(start_node, ros_master, root, tmp_path):
    import rospy

    from fcsv_msgs.msg import Capture, MissionState, RecorderStatus

    state = rospy.Publisher("/mission/state", MissionState, queue_size=1, latch=True)
    other = rospy.Publisher("/uav2/recorder/status", RecorderStatus, queue_size=1, latch=True)
    other.publish(path="/data/session/uav2.1.bag")
    capture = rospy.Publisher("/mission/capture", Capture, queue_size=1, latch=True)
    state.publish(detail="before the recorder came")
    params = {
        "role": "control",
        "name": "control",
        "folder": str(tmp_path),
        "vehicles": ["uav1", "uav2"],
        "seed": 7,
        "mission": str(root / "config/missions/short.yaml"),
    }
    process = start_node("fcsv_control", "recorder", name="control_recorder", params=params)
    until(lambda: all(p.get_num_connections() for p in (capture, state, other)))
    capture.publish(index=3)
    time.sleep(LATENCY_S)
    process.stop()
    for publisher in (state, capture, other):
        publisher.unregister()
    counts = topics_of(tmp_path / "control.bag")
    assert counts["/mission/capture"] == 1 and counts["/mission/state"] >= 1
    assert counts["/uav2/recorder/status"] == 1, (
        "a topic to which the recorder itself listens is recorded, too"
    )
    for name in ("uav1.bag", "uav2.bag", "uav2.1.bag"):
        (tmp_path / name).write_bytes(b"")
    session = load_session(tmp_path)
    assert session.parts == {"uav2": ["uav2.1.bag"]}
    assert (
        session.simulation.seed == 7
        and session.vehicles == ["uav1", "uav2"]
        and session.reference == "uav1"
    )
    assert session.mission == load_mission(root / "config/missions/short.yaml")


@ros
@pytest.mark.parametrize(
    "params, words",
    [
        (
            {"role": "pilot", "name": "x", "folder": "/tmp"},
            "role: 'pilot' is not one of vehicle, control",
        ),
        ({"role": "vehicle", "name": "x", "folder": "/proc/no"}, "/proc/no: cannot be made"),
        ({"role": "vehicle", "name": "x", "folder": "/tmp", "speed": 3}, "unknown key 'speed'"),
    ],
)
def test_what_cannot_record_says_so_in_one_line(start_node, params, words):
    process = start_node(
        "fcsv_control", "recorder", name=f"bad_{abs(hash(words)) % 1000}", params=params
    )
    until(lambda: process.returncode is not None, 20.0)
    assert (
        process.returncode == 2 and words in process.tail(3) and "Traceback" not in process.tail(30)
    )


# ---- without a master ----------------------------------------------------------------------------


def test_a_session_that_is_not_whole_is_one_line(root, tmp_path):
    mission = load_mission(root / "config/missions/short.yaml")
    save_session(tmp_path, new_session(mission, ["uav1", "uav2"], "2026-01-02T03:04:05Z"))
    for name in ("uav1.bag", "control.bag"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(SessionError, match=r"uav2\.bag: missing; copy the bag of uav2"):
        load_session(tmp_path)
    (tmp_path / "uav2.bag.active").write_bytes(b"")
    with pytest.raises(
        SessionError,
        match=r"uav2\.bag\.active: was not closed; run: rosrun fcsv_control repair_bag",
    ):
        load_session(tmp_path)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"version": 2}, "version: 2 is not known"),
        ({"reference": "uav9"}, "'uav9' is not among the vehicles"),
        ({"bags": {"uav1": "uav1.bag", "uav2": "uav2.bag"}}, "there is none for control"),
        ({"bags": {"uav1": "../uav1.bag", "uav2": "b", "control": "c"}}, "not a plain file name"),
        ({"colour": "red"}, "unknown key 'colour'"),
        ({"mission": {"name": "m", "configurations": []}}, "configurations: the list is empty"),
    ],
)
def test_a_session_file_that_is_wrong_is_one_line(root, tmp_path, change, words):
    mission = load_mission(root / "config/missions/short.yaml")
    path = save_session(tmp_path, new_session(mission, ["uav1", "uav2"], "2026-01-02T03:04:05Z", 1))
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **change}))
    with pytest.raises(ConfigError, match=words) as error:
        load_session(tmp_path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_the_session_file_is_as_documented(root, tmp_path):
    mission = load_mission(root / "config/missions/short.yaml")
    save_session(tmp_path, new_session(mission, ["uav1", "uav2"], "2026-01-02T03:04:05Z", 4))
    document = yaml.safe_load((tmp_path / "session.yaml").read_text())
    assert document["version"] == 1 and document["simulation"] == {"seed": 4}
    assert document["bags"] == {"uav1": "uav1.bag", "uav2": "uav2.bag", "control": "control.bag"}
    assert [c["baseline_m"] for c in document["mission"]["configurations"]] == [2.0, 4.0, 8.0, 5.0]
    assert "simulation" not in yaml.safe_load(
        save_session(tmp_path, new_session(mission, ["uav1", "uav2"], "now")).read_text()
    )


def test_what_a_machine_records():
    vehicle = recording.plan(recording.RecorderParameters("vehicle", "uav2", "x", topics=["/more"]))
    assert vehicle.pictures == ["/uav2/camera/color/image_raw", "/uav2/camera/color/camera_info"]
    for topic in (
        "/uav2/odometry/body",
        "/uav2/tags/detections",
        "/uav2/mavros/state",
        "/tf_static",
        "/more",
    ):
        assert topic in vehicle.always
    # what was done, and why
    for name in ("guardian/state", "guardian/said", "agent/alive", "command", "command_ack"):
        assert f"/uav2/{name}" in vehicle.always
    for name in (
        "mavros/setpoint_position/local",
        "mavros/vision_pose/pose",
        "flight_link/refusal",
        "recorder/status",
        "tello/odom",
        "tello/imu",
    ):
        assert f"/uav2/{name}" in vehicle.always
    assert "/diagnostics" in vehicle.always
    # control.bag may be lost
    assert {"/calibration", "/home", "/mission/capture"} <= set(vehicle.always)
    assert (
        "/uav2/flight_link/health" in vehicle.always
        and "/uav2/flight_link/estimate_moved" in vehicle.always
    )
    control = recording.plan(
        recording.RecorderParameters("control", "control", "x", ["uav1"], "m.yaml")
    )
    for topic in (
        "/calibration",
        "/home",
        "/mission/state",
        "/mission/capture",
        "/uav1/odometry/state",
        "/uav1/mavros/state",
        "/uav1/camera_pose",
        "/tf",
        "/tf_static",
        "/uav1/guardian/state",
        "/uav1/guardian/said",
        "/uav1/agent/alive",
        "/uav1/command",
        "/uav1/command_ack",
        "/stop_all/report",
        "/diagnostics",
        "/uav1/diagnostics/worst",
        "/mocap/uav1/pose",
    ):
        assert topic in control.always
    assert not control.pictures


def test_a_part_of_this_flight_or_of_an_earlier_one(tmp_path):
    assert recording.begin(tmp_path, "uav1.bag", 1000.0) == (0, [])
    for name, written_s in (
        ("uav1.bag", 900.0),
        ("uav1.1.bag.active", 990.0),
        ("uav1.20260102T030405Z.bag", 990.0),
    ):
        (tmp_path / name).write_text("x")
        os.utime(tmp_path / name, (written_s, written_s))
    assert recording.begin(tmp_path, "uav1.bag", 1000.0) == (2, []), (
        "its recorder died ten seconds ago"
    )
    number, kept = recording.begin(tmp_path, "uav1.bag", 5000.0)
    assert number == 0 and [p.name for p in kept] == [
        "uav1.19700101T001500Z.bag",
        "uav1.19700101T001630Z.1.bag.active",
    ]
    assert not parts_in(tmp_path, "uav1.bag") and len(list(tmp_path.iterdir())) == 3


def test_further_parts_are_listed_once_and_in_order(root, tmp_path):
    session = new_session(
        load_mission(root / "config/missions/short.yaml"), ["uav1", "uav2"], "2026-01-02T03:04:05Z"
    )
    for bag in ("uav1.10.bag", "uav1.2.bag", "uav1.bag", "uav1.2.bag", "uav2.1.bag"):
        session = with_part(session, "uav1", bag)
    assert session.parts == {"uav1": ["uav1.2.bag", "uav1.10.bag"]}
    save_session(tmp_path, session)
    for name in ("uav1.bag", "uav2.bag", "control.bag", "uav1.2.bag", "uav1.10.bag"):
        (tmp_path / name).write_bytes(b"")
    assert load_session(tmp_path) == session


def test_earlier_files_keep_apart(tmp_path):
    names = set()
    for content in "abc":
        (tmp_path / "uav1.bag").write_text(content)
        os.utime(tmp_path / "uav1.bag", (0, 0))
        names.add(recording.keep_earlier(tmp_path / "uav1.bag").name)
    assert names == {f"uav1.19700101T000000Z{n}.bag" for n in ("", "-2", "-3")}
    assert recording.keep_earlier(tmp_path / "uav1.bag") is None

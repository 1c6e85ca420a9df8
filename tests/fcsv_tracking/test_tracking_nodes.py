# SPDX-License-Identifier: Apache-2.0
"""Clock, frames, calibration and tag nodes on a master: what they publish, refuse, count and
say."""

import itertools
import time
from pathlib import Path
from xmlrpc.client import ServerProxy

import numpy as np
import pytest
from support.waiting import within

from fcsv_geometry import transforms
from fcsv_sim.trials.formation import Formation, FormationParameters

ROBOT = Path(__file__).parents[2] / "config/robots/rescue.yaml"

until = within(10.0)

pytestmark = pytest.mark.ros


@pytest.fixture
def folder(tmp_path):
    """config/vehicles of three vehicles."""
    for n in (1, 2, 3):
        (tmp_path / f"uav{n}.yaml").write_text(
            f"name: uav{n}\nsystem_id: {n}\ntag_id: {n}\ntag_size_m: 0.16\ncamera: {{xyz_m: [0.11, 0.0, 0.03]}}\n"
            f"tracking_camera: {{xyz_m: [0.06, 0.0, -0.05], rpy_deg: [0.0, 90.0, 0.0]}}\n"
            f"tag: {{xyz_m: [-0.16, 0.0, 0.02], rpy_deg: [0.0, 0.0, 180.0]}}\n"
        )
    return str(tmp_path)


class Listener:
    """Keeps what comes on a topic."""

    def __init__(self, topic, kind):
        import rospy

        self.messages = []
        self._subscriber = rospy.Subscriber(topic, kind, self.messages.append, queue_size=100)

    def wait(self, condition=lambda m: True, seconds=60.0):  # a busy machine starts nodes slowly
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for message in list(self.messages):
                if condition(message):
                    return message
            time.sleep(0.05)
        return None

    def get_num_connections(self):
        return self._subscriber.get_num_connections()

    def close(self):
        self._subscriber.unregister()


@pytest.fixture
def listen(ros_master):
    opened = []

    def make(topic, kind):
        opened.append(Listener(topic, kind))
        return opened[-1]

    yield make
    for listener in opened:
        listener.close()


@pytest.fixture
def talk(ros_master):
    """talk(topic, type) -> a publisher; closed after the test, latched messages with it."""
    import rospy

    opened = []

    def make(topic, kind, **kwargs):
        opened.append(rospy.Publisher(topic, kind, queue_size=100, **kwargs))
        return opened[-1]

    yield make
    for publisher in opened:
        publisher.unregister()


def connected(*ends, seconds=60.0):  # a busy machine starts nodes slowly
    until(
        lambda: all(e.get_num_connections() for e in ends),
        seconds,
        lambda: f"connections: {[e.get_num_connections() for e in ends]}",
    )


def odometry(name, stamp_s, T_odom_body, frame=None):
    from nav_msgs.msg import Odometry

    from fcsv_geometry.ros import conversions

    message = Odometry(
        header=conversions.header(stamp_s, frame or f"{name}/odom"),
        child_frame_id=f"{name}/base_link",
    )
    message.pose.pose = conversions.transform_to_pose(T_odom_body)
    return message


def says(text):
    """A diagnostics message in which some status says so."""
    return lambda m: any(
        text in s.message or any(text in f"{v.key} {v.value}" for v in s.values) for s in m.status
    )


def test_clocks_are_measured_and_a_wrong_one_is_named(start_node, listen, talk):
    import rospy
    from diagnostic_msgs.msg import DiagnosticArray

    from fcsv_msgs.msg import ClockEcho, ClockOffset

    right, wrong = (
        listen("/uav1/clock/offset", ClockOffset),
        listen("/uav2/clock/offset", ClockOffset),
    )
    health = listen("/diagnostics", DiagnosticArray)
    answers = talk("/uav2/clock/pong", ClockEcho)

    def answer(message):  # a machine whose clock is 0.4 s ahead
        message.received = message.answered = rospy.Time.now() + rospy.Duration(0.4)
        answers.publish(message)

    ping = rospy.Subscriber("/uav2/clock/ping", ClockEcho, answer, queue_size=1)
    start_node(
        "fcsv_tracking", "clock", name="clock_uav1", params={"role": "vehicle", "name": "uav1"}
    )
    start_node(
        "fcsv_tracking",
        "clock",
        name="clock",
        params={"role": "control", "vehicles": ["uav1", "uav2", "uav3"]},
    )
    near = right.wait()
    far = wrong.wait()
    # one machine, one clock
    assert near is not None and abs(near.offset_s) <= near.uncertainty_s + 1e-4
    assert far is not None and abs(far.offset_s - 0.4) <= far.uncertainty_s + 1e-4
    assert health.wait(says("uav2's clock is 0.4")) is not None
    assert health.wait(says("uav3 does not answer")) is not None
    ping.unregister()


def test_frames_publish_covariance_that_grows_and_call_for_calibration(
    start_node, listen, talk, folder
):
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry
    from visualization_msgs.msg import MarkerArray

    from fcsv_geometry.ros import conversions
    from fcsv_msgs.msg import Calibration, Home
    from fcsv_tracking.column.calibration import Link
    from fcsv_tracking.ros import link_messages

    camera = listen("/uav3/camera_pose", PoseWithCovarianceStamped)
    health = listen("/diagnostics", DiagnosticArray)
    calibration, home = (
        talk("/calibration", Calibration, latch=True),
        talk("/home", Home, latch=True),
    )
    tracks = {n: talk(f"/{n}/odometry/state", Odometry) for n in ("uav1", "uav2", "uav3")}
    params = {
        "vehicles": ["uav1", "uav2", "uav3"],
        "vehicles_dir": folder,
        "age": {"most_position_std_m": 0.15},
    }
    start_node("fcsv_tracking", "frames", params=params)
    connected(*tracks.values(), calibration, home)
    link = np.diag([0.01, 0.01, 0.005, 0.004]) ** 2
    T = transforms.from_xyz_yaw([-3.5, 0.0, 0.0], 0.5)
    now_s = time.time()
    message = Calibration(header=conversions.header(now_s, "uav1/odom"))
    message.links = [
        link_messages.to_message(Link(a, b, T, link, 0.0, 0.0, 0.0, 40, 0))
        for a, b in (("uav1", "uav2"), ("uav2", "uav3"))
    ]
    calibration.publish(message)
    markers = listen("/tracking/markers", MarkerArray)
    start_node(
        "fcsv_tracking",
        "markers",
        params={"vehicles": ["uav1", "uav2", "uav3"], "vehicles_dir": folder},
    )
    home.publish(
        Home(
            header=message.header,
            reference="uav1",
            home_in_odom=conversions.transform_to_pose(np.eye(4)),
        )
    )
    for i in range(200):  # standing, until calibration and home have arrived
        tracks["uav3"].publish(odometry("uav3", now_s - 30.0 + 0.1 * i, np.eye(4)))
        if camera.wait(seconds=0.1) is not None:
            break
    for i in range(400):  # 40 m in two seconds of stamps, faster than it flies: only the way counts
        T_odom_body = transforms.from_xyz_yaw([0.1 * i, 0.0, 0.0], 0.0)
        tracks["uav3"].publish(odometry("uav3", now_s + 0.1 * i, T_odom_body))
        time.sleep(0.003)
    tracks["uav3"].publish(odometry("uav3", now_s + 41.0, np.eye(4), frame="uav1/odom"))
    assert camera.wait(lambda m: m.header.stamp.to_sec() > now_s + 39.0) is not None
    first, last = (np.reshape(camera.messages[i].pose.covariance, (6, 6)) for i in (0, -1))
    # at the beginning the chain's: 3.5 m of lever arm of the first yaw beside both positions, 0.11
    # m of camera
    assert np.sqrt(np.trace(first[:3, :3])) == pytest.approx(0.026, abs=0.006)
    assert last[5, 5] > first[5, 5] and np.sqrt(np.trace(last[:3, :3])) > 0.15
    assert np.linalg.eigvalsh(last).min() > -1e-12 and np.allclose(last, last.T)
    assert health.wait(says("calibrate again: uav3 is only known to")) is not None
    assert health.wait(says("dropped: odometry")) is not None
    expected = (
        T
        @ T
        @ transforms.from_xyz_yaw([39.9, 0, 0], 0.0)
        @ transforms.from_xyz_yaw([0.11, 0, 0.03], 0.0)
    )
    # standing again, until the markers' node, which may start late, has heard of it
    for i in range(40):
        tracks["uav3"].publish(odometry("uav3", now_s + 42.0 + 0.1 * i, T_odom_body))
        drawn = markers.wait(
            lambda m: any(k.ns == "covariance of uav3" for k in m.markers), seconds=0.5
        )
        if drawn is not None:
            break
    ball = next(k for k in drawn.markers if k.ns == "covariance of uav3")
    q = ball.pose.orientation
    R = transforms.from_xyz_quaternion(np.zeros(3), [q.x, q.y, q.z, q.w])[:3, :3]
    drawn_covariance = (
        R @ np.diag(np.square([ball.scale.x, ball.scale.y, ball.scale.z]) / 36.0) @ R.T
    )
    some = [np.reshape(m.pose.covariance, (6, 6))[:3, :3] for m in camera.messages]
    # three sigma either way of one that came
    assert min(np.abs(drawn_covariance - c).max() for c in some) < 1e-6
    p = camera.messages[-1].pose.pose.position
    assert np.allclose([p.x, p.y, p.z], expected[:3, 3], atol=1e-6)


def test_what_was_flown_before_the_calibration_is_heard_of_is_in_the_covariance(
    start_node, listen, talk, folder
):
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry

    from fcsv_geometry.ros import conversions
    from fcsv_msgs.msg import Calibration, Home
    from fcsv_tracking.column.calibration import Link
    from fcsv_tracking.ros import link_messages

    camera = listen("/uav2/camera_pose", PoseWithCovarianceStamped)
    calibration, home = (
        talk("/calibration", Calibration, latch=True),
        talk("/home", Home, latch=True),
    )
    track = talk("/uav2/odometry/state", Odometry)
    node = start_node(
        "fcsv_tracking", "frames", params={"vehicles": ["uav1", "uav2"], "vehicles_dir": folder}
    )
    connected(track, calibration, home, camera)
    now_s = time.time()
    for i in range(41):  # 20 m
        T_odom_body = transforms.from_xyz_yaw([0.5 * i, 0.0, 0.0], 0.0)
        track.publish(odometry("uav2", now_s - 4.0 + 0.1 * i, T_odom_body))
        time.sleep(0.01)
    time.sleep(0.5)
    message = Calibration(header=conversions.header(now_s - 4.0, "uav1/odom"))
    message.links = [
        link_messages.to_message(
            Link("uav1", "uav2", np.eye(4), 1e-6 * np.eye(4), 0.0, 0.0, 0.0, 40, 0)
        )
    ]
    calibration.publish(message)
    home.publish(
        Home(
            header=message.header,
            reference="uav1",
            home_in_odom=conversions.transform_to_pose(np.eye(4)),
        )
    )
    for i in range(200):  # standing, until calibration and home have arrived
        track.publish(odometry("uav2", now_s + 0.1 * (i + 1), T_odom_body))
        if camera.wait(seconds=0.1) is not None:
            break
    assert camera.messages, node.tail(40)
    covariance = np.reshape(camera.messages[0].pose.covariance, (6, 6))
    assert np.sqrt(covariance[2, 2]) == pytest.approx(0.012 * np.sqrt(20.0), rel=0.1)


def doubled(message):
    message.detections = message.detections * 2
    return message


def larger(message):
    message.detections[0].size_m = 0.2
    return message


def nan(message):
    message.detections[0].corners_normalized = [float("nan")] * 8
    return message


class Column:
    """Two vehicles and what comes of them over the radio, ten times as fast; one calibration after
    another."""

    def __init__(self, talk):
        from nav_msgs.msg import Odometry

        from fcsv_msgs.msg import ClockOffset, Epoch, TagDetections

        self.epochs = {n: talk(f"/{n}/odometry/epoch", Epoch, latch=True) for n in ("uav1", "uav2")}
        self.begin_epoch(7)
        self.flight = Formation(2, FormationParameters())
        self.begin_s = 0.0
        self.states = {n: talk(f"/{n}/odometry/state", Odometry) for n in self.flight.names}
        self.tags = talk("/uav2/tags/detections", TagDetections)
        self.clocks = {
            n: talk(f"/{n}/clock/offset", ClockOffset, latch=True) for n in self.flight.names
        }

    def wait_for_node(self):
        connected(*self.states.values(), self.tags, *self.clocks.values(), *self.epochs.values())

    def begin_epoch(self, number, message=None):
        """Both vehicles' odometry is in this epoch; ``message`` comes back."""
        from fcsv_msgs.msg import Epoch

        for publisher in self.epochs.values():
            publisher.publish(Epoch(epoch=number, reason="test"))
        return message

    def calibrate(self, spoil=lambda m: m, clock_offset_s=0.0):
        """The service's answer to a flight of which ``spoil`` spoils the detections."""
        from concurrent.futures import ThreadPoolExecutor

        import rospy

        from fcsv_msgs.msg import ClockOffset
        from fcsv_msgs.srv import Calibrate

        self.begin_s += 100.0  # after all that is kept of the one before
        for name, offset_s in (("uav1", 0.0), ("uav2", clock_offset_s)):
            self.clocks[name].publish(
                ClockOffset(vehicle=name, offset_s=offset_s, uncertainty_s=0.001)
            )
        calibrate = rospy.ServiceProxy("/calibrate", Calibrate)
        calibrate.wait_for_service(20.0)
        with ThreadPoolExecutor(1) as pool:
            answer = pool.submit(calibrate, ["uav1", "uav2"], 4.0)
            time.sleep(0.5)
            self.fly(spoil)
            return answer.result(timeout=60.0)

    def fly(self, spoil):
        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import TagDetection, TagDetections

        flight = self.flight
        for i in range(int(flight.end_s * 30) + 8):
            for k, name in enumerate(flight.names):
                stamp_s = i * 7 / 200.0
                if stamp_s <= flight.end_s + 0.2:
                    self.states[name].publish(
                        odometry(name, self.begin_s + stamp_s, flight.states[k].at(stamp_s))
                    )
            time.sleep(0.002)
        for d in {round(d.stamp_s, 3): d for d in flight.detections(1, 0)}.values():
            corners = d.corners_normalized.ravel().tolist()
            tag = TagDetection(id=1, size_m=d.size_m, corners_normalized=corners)
            message = TagDetections(
                header=conversions.header(self.begin_s + d.stamp_s, "uav2/camera_optical")
            )
            message.vehicle, message.focal_px, message.detections = "uav2", d.focal_px, [tag]
            message.camera_in_odom = conversions.transform_to_pose(d.T_odom_cam)
            self.tags.publish(spoil(message))
            time.sleep(0.005)


def test_what_spoils_a_calibration_is_named_and_a_good_one_follows(
    start_node, talk, listen, folder
):
    """On one node, so that nothing of what was refused is in the good one."""
    from fcsv_geometry.ros import conversions
    from fcsv_msgs.msg import Epochs

    held = {what: listen(f"/{what}_epochs", Epochs) for what in ("calibration", "home")}
    column = Column(talk)
    start_node(
        "fcsv_tracking",
        "calibration",
        params={"vehicles": ["uav1", "uav2"], "vehicles_dir": folder},
    )
    column.wait_for_node()
    for spoilt, words in (
        ({"clock_offset_s": 0.3}, ["clocks of uav1 and uav2 differ", "chrony"]),
        ({"spoil": doubled}, ["does not see uav1's tag"]),
        ({"spoil": larger}, ["takes uav1's tag to be 0.2 m wide"]),
        ({"spoil": nan}, [""]),
        (
            {"spoil": lambda m: column.begin_epoch(8, m)},
            ["odometry of uav1, uav2 began anew meanwhile"],
        ),
    ):
        answer = column.calibrate(**spoilt)
        assert not answer.success and all(w in answer.message for w in words), (
            spoilt,
            answer.message,
        )
    assert not held["calibration"].messages
    answer = column.calibrate()
    assert answer.success, answer.message
    epochs = held["calibration"].wait()
    assert dict(zip(epochs.vehicles, epochs.epochs)) == {"uav1": 8, "uav2": 8}
    T = conversions.pose_to_transform(answer.calibration.links[0].child_odom_in_parent_odom)
    estimated, true = column.flight.relative({"uav2": T}, 1)
    # docs/lab/tracking.md: at worst 0.018 m
    assert np.linalg.norm((estimated - true)[:3, 3]) < 0.05
    # the moment for which the links hold, not that at which they are told
    assert answer.calibration.header.stamp.to_sec() == pytest.approx(
        column.begin_s + column.flight.end_s, abs=1e-6
    )
    home_is_set_by_odometry_that_came_just_now(column)
    assert (held["home"].wait().vehicles, list(held["home"].messages[0].epochs)) == (["uav1"], [8])


def home_is_set_by_odometry_that_came_just_now(column):
    """Whatever its stamps say: here the vehicle's clock is decades behind."""
    import rospy

    from fcsv_msgs.srv import SetHome

    set_home = rospy.ServiceProxy("/set_home", SetHome)
    time.sleep(0.6)
    assert "s old: check its link" in set_home("uav1").message
    stamp_s = column.flight.end_s + 0.5
    column.states["uav1"].publish(
        odometry("uav1", column.begin_s + stamp_s, column.flight.states[0].at(1.0))
    )
    until(lambda: set_home("uav1").success, what="odometry that came just now")


def test_from_guided_on_neither_calibration_nor_home_may_change(start_node, talk, folder):
    """Both would move every place that the mission flies to."""
    import rospy

    from fcsv_msgs.msg import MissionState
    from fcsv_msgs.srv import Calibrate, SetHome

    state = talk("/mission/state", MissionState, latch=True)
    start_node(
        "fcsv_tracking",
        "calibration",
        params={"vehicles": ["uav1", "uav2"], "vehicles_dir": folder},
    )
    calibrate, set_home = (
        rospy.ServiceProxy("/calibrate", Calibrate),
        rospy.ServiceProxy("/set_home", SetHome),
    )
    set_home.wait_for_service(60.0)
    for phase in ("GUIDED", "CONFIGURATIONS", "LAND", "DONE"):
        state.publish(MissionState(phase_name=phase))
        words = (
            "calibrate the column"
            if phase == "DONE"
            else f"while the mission flies the vehicles ({phase})"
        )
        until(lambda words=words: words in set_home("uav1").message, what=phase)
        if phase != "DONE":
            answer = calibrate(["uav1", "uav2"], 0.1)
            assert not answer.success and words in answer.message


class TestTags:
    """The tag node between pictures and detections."""

    ahead_s = 0.0  # of the messages' stamps

    def running(self, start_node, listen, talk, folder):
        from diagnostic_msgs.msg import DiagnosticArray
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import CameraInfo, Image

        from fcsv_msgs.msg import TagDetections

        found, health = (
            listen("/uav2/tags/detections", TagDetections),
            listen("/diagnostics", DiagnosticArray),
        )
        out = [
            talk("/uav2/odometry/body", Odometry),
            talk("/uav2/camera/color/camera_info", CameraInfo),
            talk("/uav2/camera/color/image_raw", Image),
        ]
        params = {
            "vehicle": "uav2",
            "vehicles": ["uav1", "uav2"],
            "vehicles_dir": folder,
            "rate_hz": 30.0,
            "search_rate_hz": 30.0,
            "robot": str(ROBOT),
        }
        start_node("fcsv_tracking", "tags", ns="uav2", params=params)
        connected(*out)
        return found, health, out

    def show(
        self,
        out,
        picture,
        frame="uav2/camera_color_optical_frame",
        camera=None,
        odometry_frame=None,
        times=6,
    ):
        from support.tag_pictures import CAMERA

        from fcsv_geometry.ros import conversions

        body, info, image = out
        # on a connection of its own: of two that are sent together either may come first
        info.publish(conversions.info_from_camera(camera or CAMERA, time.time(), frame))
        time.sleep(0.5)
        for _ in range(times):
            now_s = time.time() + self.ahead_s
            info.publish(conversions.info_from_camera(camera or CAMERA, now_s, frame))
            image.publish(conversions.array_to_image(picture, "mono8", now_s, frame))
            for k in range(-2, 12):
                body.publish(odometry("uav2", now_s + 0.01 * k, np.eye(4), odometry_frame))
                time.sleep(0.005)
            time.sleep(0.1)

    def test_good_then_wrong(self, start_node, listen, talk, folder):
        from support.tag_pictures import pose, render

        from fcsv_geometry.camera import PinholeCamera
        from fcsv_msgs.msg import SceneMotion

        found, health, out = self.running(start_node, listen, talk, folder)
        motion = listen("/uav2/tags/scene_motion", SceneMotion)
        tag = render(pose(3.0))
        self.show(out, tag)
        assert found.wait(lambda m: len(m.detections) == 1) is not None
        self.show(out, render(pose(9.0), size_m=0.45, tag_id=40))  # the robot's
        seen = found.wait(lambda m: [d.id for d in m.detections] == [40])
        assert seen.detections[0].size_m == 0.45
        blocks = np.random.default_rng(1).integers(0, 256, (24, 32), np.uint8)
        self.show(out, np.kron(blocks, np.ones((20, 20), np.uint8)), times=10)
        assert motion.wait(lambda m: m.points >= 15 and m.span_s > 0.3) is not None
        # nothing moves, nor does its pose
        assert all(m.off_rad < 0.002 and m.turn_rad < 1e-6 for m in motion.messages)
        wrong_size = PinholeCamera.from_fov(320, 240, np.radians(56.0))
        for kwargs, word in (
            ({"frame": "uav1/camera_color_optical_frame"}, "dropped: picture"),
            ({"camera": wrong_size}, "dropped: picture"),
            ({"odometry_frame": "uav1/odom"}, "dropped: odometry"),
        ):
            del health.messages[:]
            self.ahead_s += 4.0  # what odometry is buffered is too old for these pictures
            begin_s = time.time() + self.ahead_s
            self.show(out, tag, **kwargs)
            assert health.wait(says(word)) is not None, kwargs
            assert not [m for m in found.messages if m.header.stamp.to_sec() >= begin_s], kwargs
        del found.messages[:]
        self.ahead_s += 4.0
        begin_s = time.time() + self.ahead_s
        both = np.concatenate(
            [render(pose(2.5, x=-0.4))[:, :320], render(pose(2.5, x=0.4))[:, 320:]], axis=1
        )
        self.show(out, both)
        assert health.wait(says("tags rejected: same id twice")) is not None
        came = [m for m in found.messages if m.header.stamp.to_sec() >= begin_s]
        assert came and not any(m.detections for m in came)


def test_previews_are_pictures_again_for_who_looks(start_node, listen, talk):
    import cv2
    import rospy
    from diagnostic_msgs.msg import DiagnosticArray
    from sensor_msgs.msg import CompressedImage, Image

    from fcsv_geometry.ros import conversions

    sent = talk("/uav2/camera/color/image_raw/compressed", CompressedImage)
    start_node("fcsv_tracking", "previews", params={"vehicles": ["uav1", "uav2"]})
    health = listen("/diagnostics", DiagnosticArray)
    seen = listen("/uav2/camera/color/image_raw", Image)
    connected(sent)
    bgr = np.full((48, 64, 3), (200, 100, 30), np.uint8)
    message = CompressedImage(format="jpeg", data=cv2.imencode(".jpg", bgr)[1].tobytes())
    message.header = conversions.header(rospy.Time.now().to_sec(), "uav2/camera_optical")
    told, in_turn = (
        says("preview"),
        itertools.cycle([CompressedImage(format="jpeg", data=b"\xff\xd8 cut off"), message]),
    )
    until(
        lambda: seen.messages and any(map(told, list(health.messages))),
        what="a picture, and that the other one is cut off",
        meanwhile=lambda: sent.publish(next(in_turn)),
        every_s=0.1,  # apart: the newest wins
    )
    picture = seen.wait()
    assert (
        picture.header.frame_id == "uav2/camera_optical"
        and picture.header.stamp == message.header.stamp
    )
    assert np.abs(conversions.image_to_array(picture, "bgr8").astype(int) - bgr).max() <= 4
    assert health.wait(told) is not None


def until_received(node, topic):
    """Waits until a node has a message of a topic, and some time for it to act."""
    import rosnode
    from rosgraph import Master

    proxy = ServerProxy(rosnode.get_api_uri(Master("/test"), node))

    def messages():
        of_topic = [links for name, links in proxy.getBusStats("/test")[2][1] if name == topic]
        return sum(number for links in of_topic for _, _, number, *_ in links)

    until(messages, what=f"a message on {topic}")
    time.sleep(0.3)


def test_pictures_of_a_vehicle_before_a_tracker_on_the_ground_go_to_the_map(
    folder, start_node, listen, talk
):
    """Only while the recorder takes pictures; the pose is that of the picture's stamp."""
    from diagnostic_msgs.msg import DiagnosticArray
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import CameraInfo, Image
    from std_msgs.msg import Bool

    from fcsv_geometry.camera import PinholeCamera
    from fcsv_geometry.ros import conversions
    from fcsv_msgs.msg import CapturedPicture

    params = {"vehicle": "uav1", "vehicles_dir": folder}
    start_node("fcsv_tracking", "ground_pictures", ns="uav1", params=params)
    captured = listen("/uav1/capture/picture", CapturedPicture)
    track, pictures, infos, recording = (
        talk("/uav1/odometry/body", Odometry),
        talk("/uav1/camera/color/image_raw", Image),
        talk("/uav1/camera/color/camera_info", CameraInfo),
        talk("/uav1/recorder/pictures", Bool, latch=True),
    )
    connected(captured, track, pictures, infos, recording)
    camera, frame = PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5), "uav1/camera_optical"
    bgr = np.full((48, 64, 3), 90, np.uint8)

    def shoot(stamp_s):
        infos.publish(conversions.info_from_camera(camera, stamp_s, frame))
        time.sleep(0.2)
        pictures.publish(conversions.array_to_image(bgr, "bgr8", stamp_s, frame))

    now_s = time.time()
    shoot(now_s)
    until_received("/uav1/ground_pictures", "/uav1/camera/color/image_raw")
    recording.publish(Bool(True))
    until_received("/uav1/ground_pictures", "/uav1/recorder/pictures")
    shoot(now_s + 0.25)
    for dt_s, x_m in (
        (0.0, 1.0),
        (0.5, 2.0),
    ):  # the tracker's poses come later, half a second apart
        T = transforms.from_xyz_yaw([x_m, 0.0, 1.0], 0.0)
        track.publish(odometry("uav1", now_s + dt_s, T))
    found = captured.wait()
    assert found is not None and found.vehicle == "uav1"
    assert found.header.stamp.to_sec() == pytest.approx(now_s + 0.25, abs=1e-6)
    at = found.camera_in_odom.position
    assert (at.x, at.y, at.z) == pytest.approx((1.5 + 0.11, 0.0, 1.03), abs=1e-6)
    assert len(captured.messages) == 1, "the first came before the recorder took pictures"
    pictures.publish(conversions.array_to_image(bgr, "bgr8", now_s + 9.0, frame))
    assert listen("/diagnostics", DiagnosticArray).wait(says("picture for the map")), (
        "said, and the next one comes"
    )

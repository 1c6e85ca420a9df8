# SPDX-License-Identifier: Apache-2.0
"""The simulated mocap and the tracker's node on a master: camera_pose and tf against the truth."""

import threading
import time

import numpy as np
import pytest
from support.ground_topics import GroundTopics
from support.tello_log import TelloLog
from support.waiting import within

from fcsv_geometry import transforms as tf
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.truth import TruthReader, TruthWriter

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.slow_motion]
NAMES = ("tello1", "tello2")
T_WORLD_MOCAP = tf.from_xyz_rpy([0.0, 0.0, 0.3], np.radians([0.0, -45.0, 0.0]))


STEP_S = 0.0025
# of its time the truth is written, so that a test that is kept waiting does not hold up the world
AHEAD_S = 0.5


class Hovering:
    """Two bodies that sway in view; the second leaves the view after leave()."""

    def __init__(self, folder):
        self.leaves_s = np.inf
        self._writers = {n: TruthWriter(folder, n) for n in NAMES}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._fly, daemon=True)
        self._thread.start()

    def leave(self):
        self.leaves_s = time.time() + AHEAD_S

    def _fly(self):
        began_s = stamp_s = time.time()
        before = {}
        while not self._stop.wait(STEP_S):
            while stamp_s < time.time() + AHEAD_S:
                stamp_s += STEP_S
                self._step(stamp_s, stamp_s - began_s, before)

    def _step(self, stamp_s, t, before):
        share = min(1.0, max(0.0, stamp_s - self.leaves_s) / 4.0)
        offset_m = 2.5 * (10 * share**3 - 15 * share**4 + 6 * share**5)
        for i, name in enumerate(NAMES):
            p = np.array(
                [
                    2.0 + 0.25 * np.sin(0.9 * t + i),
                    (0.7 - 1.4 * i) / 2 + 0.25 * np.cos(0.7 * t),
                    2.0,
                ]
            )
            p += [0.0, -offset_m * i, 0.0]
            T = tf.from_xyz_rpy(p, [0.02 * np.sin(t), 0.02 * np.cos(t), 0.1 * np.sin(0.3 * t)])
            self._writers[name].write(stamp_s, T, (p - before.get(name, p)) / STEP_S)
            before[name] = p

    def stop(self):
        self._stop.set()
        self._thread.join()


@pytest.fixture
def hovering(tmp_path):
    world = Hovering(tmp_path)
    yield world
    world.stop()


until = within(30.0)


def stamp_s(message):
    return message.header.stamp.to_sec()


def poses_up_to(got, end_s):
    """Wait until both cameras have a pose whose own stamp is past ``end_s``; no clock but the
    stamps is read."""
    until(
        lambda: all(got[n] and stamp_s(got[n][-1]) > end_s for n in NAMES),
        60.0,
        f"camera poses of {end_s:.1f} s",
    )


def test_camera_poses_of_both_whichever_is_in_view(hovering, start_node, root, tmp_path):
    import rospy
    import tf2_ros
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry

    from fcsv_geometry.ros import conversions
    from fcsv_msgs.srv import SetHome

    folder = str(root / "config" / "vehicles")
    vehicles = load_vehicles(folder, NAMES)
    got, heard, diagnostics = {n: [] for n in NAMES}, {n: [] for n in NAMES}, {}

    def on_diagnostics(message):
        for status in message.status:
            if "mocap_tracker" in status.name:
                diagnostics.update(
                    {v.key: v.value for v in status.values}, level=status.level, text=status.message
                )

    subscribers = [rospy.Subscriber("/diagnostics", DiagnosticArray, on_diagnostics)]
    for n in NAMES:
        subscribers.append(
            rospy.Subscriber(f"/{n}/camera_pose", PoseWithCovarianceStamped, got[n].append)
        )
        subscribers.append(rospy.Subscriber(f"/{n}/tello/odom", Odometry, heard[n].append))
    ground = GroundTopics(NAMES)
    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer)
    start_node(
        "fcsv_sim",
        "mocap",
        name="sim_mocap",
        params={"vehicles": list(NAMES), "sim_dir": str(tmp_path)},
    )
    logs = [TelloLog(n, tmp_path, i) for i, n in enumerate(NAMES)]
    tracker = start_node(
        "fcsv_tracking", "mocap_tracker", params={"vehicles": list(NAMES), "vehicles_dir": folder}
    )
    rospy.wait_for_service("/set_home", 20)
    set_home = rospy.ServiceProxy("/set_home", SetHome)
    assert not set_home("nobody").success
    until(lambda: set_home("tello1").success, what="home of tello1")

    # frames with another vehicle's name, NaN: counted, and nothing else happens
    bad = rospy.Publisher("/mocap/tello1/pose", PoseStamped, queue_size=10)
    odom = rospy.Publisher("/tello1/tello/odom", Odometry, queue_size=10)
    until(
        lambda: bad.get_num_connections() and odom.get_num_connections(),
        what="the tracker's subscriptions",
    )
    wrong = conversions.pose_stamped(np.eye(4), rospy.get_time(), "tello2/mocap")
    nan = conversions.pose_stamped(np.eye(4), rospy.get_time(), "mocap")
    nan.pose.position.x = float("nan")
    for _ in range(5):
        bad.publish(wrong)
        bad.publish(nan)
        time.sleep(0.05)
    until(lambda: all(got.values()), what="a pose of either camera")
    poses_up_to(got, stamp_s(got["tello1"][-1]) + 4.0)
    print(diagnostics)
    check(got, heard, vehicles, tmp_path, 0.02)
    ground.check(vehicles, 1e-6)
    ground.close()
    hovering.leave()
    poses_up_to(got, hovering.leaves_s + 7.0 - AHEAD_S)
    print(diagnostics)
    check(got, heard, vehicles, tmp_path, 0.15)  # 2.5 m at 2 %, and where home was a moment ago
    assert buffer.can_transform("home", "tello2/camera_optical", rospy.Time(0))
    found = conversions.transform_from_msg(
        buffer.lookup_transform(
            "home", "tello1/camera_optical", got["tello1"][-5].header.stamp
        ).transform
    )
    assert np.allclose(found, conversions.pose_to_transform(got["tello1"][-5].pose.pose), atol=0.01)
    until(lambda: "tello1 mocap: not a pose" in diagnostics, what="diagnostics")
    assert (
        int(diagnostics["tello1 mocap: not a pose"]) == 5
        and int(diagnostics["dropped: tello1 mocap: wrong frame"]) == 5
    )
    assert diagnostics["tello2 mocap streams an old pose"] == "True"
    assert tracker.returncode is None
    for log in logs:
        log.close()
    for s in subscribers:
        s.unregister()
    listener.unregister()


def check(got, heard, vehicles, folder, bound_m):
    """The newest pose of either camera relative to the other's, which needs no knowledge of home.

    It is less than a second older than the newest odometry, by their stamps.
    """
    from fcsv_geometry.ros import conversions

    T = {}
    for n in NAMES:
        recent = got[n][-3:]
        assert recent, f"no camera_pose of {n}"
        newest_s, message = stamp_s(heard[n][-1]), recent[0]
        assert newest_s - stamp_s(message) < 1.0
        true = TruthReader(folder, n).at(stamp_s(message)) @ vehicles[n].T_body_cam
        T[n] = conversions.pose_to_transform(message.pose.pose), true
        assert np.linalg.eigvalsh(np.array(message.pose.covariance).reshape(6, 6)).min() > 0
    found, true = (tf.invert(T["tello1"][k]) @ T["tello2"][k] for k in (0, 1))
    assert np.linalg.norm(found[:3, 3] - true[:3, 3]) < bound_m
    assert np.degrees(tf.rotation_angle(found, true)) < 1.5

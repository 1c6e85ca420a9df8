# SPDX-License-Identifier: Apache-2.0
"""The gimbal tracker's node on a master: simulated gimbals follow two vehicles; camera_pose and tf
against truth."""

import threading
import time

import numpy as np
import pytest
from support.ground_topics import GroundTopics
from support.waiting import within

from fcsv_geometry import transforms as tf
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.truth import TruthReader, TruthWriter

pytestmark = [pytest.mark.ros, pytest.mark.slow]
NAMES = ("tello1", "tello2")
ROBOT = [3.0, -2.0, 0.0, 0.5]
T_WORLD_GROUND = tf.from_xyz_yaw(ROBOT[:3], ROBOT[3])
until = within(60.0)


class Swaying:
    """Two bodies in front of the ground robot that move slowly to and fro."""

    def __init__(self, folder):
        self._writers = {n: TruthWriter(folder, n) for n in NAMES}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._fly, daemon=True)
        self._thread.start()

    def _fly(self):
        while not self._stop.wait(0.004):
            t = time.time()
            for i, writer in enumerate(self._writers.values()):
                sway, rate = 0.25 * np.sin(0.5 * t + i), 0.125 * np.cos(0.5 * t + i)
                T_G_D = tf.from_xyz_rpy([2.6, 0.5 - i + sway, 1.35], [0.01, 0.02, 0.7])
                writer.write(t, T_WORLD_GROUND @ T_G_D, T_WORLD_GROUND[:3, :3] @ [0.0, rate, 0.0])

    def stop(self):
        self._stop.set()
        self._thread.join()


@pytest.fixture
def swaying(tmp_path):
    world = Swaying(tmp_path)
    yield world
    world.stop()


@pytest.fixture
def robot_file(root):
    return str(root / "config" / "gimbal" / "ground_robot.yaml")


@pytest.mark.slow_motion
def test_both_are_followed_and_their_cameras_known(swaying, start_node, root, robot_file, tmp_path):
    import rospy
    import tf2_ros
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from sensor_msgs.msg import Image, JointState

    from fcsv_geometry.ros import conversions
    from fcsv_msgs.srv import SetHome

    folder = str(root / "config" / "vehicles")
    vehicles = load_vehicles(folder, NAMES)
    got, diagnostics = {n: [] for n in NAMES}, {}

    def on_diagnostics(message):
        for status in message.status:
            if "gimbal_tracker" in status.name:
                diagnostics.update({v.key: v.value for v in status.values})

    subscribers = [rospy.Subscriber("/diagnostics", DiagnosticArray, on_diagnostics)]
    for n in NAMES:
        subscribers.append(
            rospy.Subscriber(f"/{n}/camera_pose", PoseWithCovarianceStamped, got[n].append)
        )
    ground = GroundTopics(NAMES)
    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer)
    for n in NAMES:
        params = {
            "vehicle": n,
            "robot_file": robot_file,
            "sim_dir": str(tmp_path),
            "robot_xyz_yaw": ROBOT,
            "camera/rate_hz": 5.0,
        }
        start_node("fcsv_sim", "gimbal", name="sim_gimbal", ns=n, params=params)
    params = {"vehicles": list(NAMES), "vehicles_dir": folder, "robot_file": robot_file}
    params.update(base_odometry="/odom", base_pose="/robot_pose")
    tracker = start_node("fcsv_tracking", "gimbal_tracker", params=params)
    rospy.wait_for_service("/set_home", 30)
    set_home = rospy.ServiceProxy("/set_home", SetHome)
    assert "not a vehicle here" in set_home("nobody").message
    until(lambda: set_home("tello1").success, 120, "home")

    # what is of another gimbal or none: counted, and nothing else happens
    joints = rospy.Publisher("/tello1/gimbal/joint_states", JointState, queue_size=10)
    pictures = rospy.Publisher("/tello1/gimbal/camera/image_raw", Image, queue_size=10)
    until(
        lambda: joints.get_num_connections() and pictures.get_num_connections(), what="connections"
    )
    other = JointState(
        header=conversions.header(time.time(), "tello2/gimbal_base"),
        name=["pan", "tilt"],
        position=[0, 0],
    )
    short = JointState(
        header=conversions.header(time.time(), "tello1/gimbal_base"), name=["pan"], position=[0.1]
    )
    for message in (other, short):
        joints.publish(message)
    pictures.publish(
        conversions.array_to_image(
            np.zeros((9, 9), np.uint8), "mono8", time.time(), "tello2/gimbal_optical"
        )
    )
    until(lambda: all(len(got[n]) > 5 for n in NAMES), 120, "camera poses of both")
    check(got, vehicles, tmp_path)
    ground.check(vehicles, 1e-6)
    ground.close()
    until(
        lambda: int(diagnostics.get("dropped: tello1 joints: wrong frame", 0)) == 1,
        what="the wrong joints counted",
    )
    until(
        lambda: int(diagnostics.get("dropped: tello1 joints: not angles", 0)) == 1,
        what="half joints counted",
    )
    until(
        lambda: int(diagnostics.get("dropped: tello1 picture: wrong frame", 0)) == 1,
        what="the wrong picture counted",
    )

    def stands(message) -> bool:
        """In tf, too. A test that stood still for seconds has lost transforms: those about it are
        interpolated then."""
        stamp = message.header.stamp
        if not buffer.can_transform("home", "tello2/camera_optical", stamp):
            return False
        found = buffer.lookup_transform("home", "tello2/camera_optical", stamp).transform
        pose = conversions.pose_to_transform(message.pose.pose)
        return np.allclose(conversions.transform_from_msg(found), pose, atol=1e-3)

    # they differ by millimetres
    until(lambda: any(stands(m) for m in got["tello2"][-10:]), what="camera poses in tf")
    assert buffer.can_transform("home", "ground", rospy.Time(0))
    looks = buffer.lookup_transform("ground", "tello2/gimbal_optical", rospy.Time(0)).transform
    ahead = conversions.transform_from_msg(looks)[
        :3, 2
    ]  # the vehicle is at 2.6, -0.5, 1.35, the gimbal at 0.1, -0.2, 0.45
    assert ahead @ [0.93, -0.11, 0.33] > np.cos(np.radians(15.0))
    found = buffer.lookup_transform("home", "ground", rospy.Time(0)).transform
    move_robot(conversions.transform_from_msg(found))
    assert tracker.returncode is None
    for s in subscribers:
        s.unregister()
    listener.unregister()


def move_robot(T_home_start):
    """Its place in home says that it drove 1 m ahead and turned: what its gimbals see goes with it,
    and vehicles are given in the frame in which it stood."""
    import rospy
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from nav_msgs.msg import Odometry

    from fcsv_geometry.ros import conversions

    T_start_now = tf.from_xyz_yaw([1.0, 0.0, 0.0], 0.4)
    now, standing = {}, {}
    heard = [
        rospy.Subscriber(
            f"/tello1/{topic}", Odometry, lambda m, to=to: to.update({m.header.stamp: m})
        )
        for topic, to in (("gimbal/body", now), ("odometry/body", standing))
    ]
    places = rospy.Publisher("/robot_pose", PoseWithCovarianceStamped, queue_size=5)

    def moved() -> bool:
        message = PoseWithCovarianceStamped(header=conversions.header(time.time(), "home"))
        message.pose.pose = conversions.transform_to_pose(T_home_start @ T_start_now)
        message.pose.covariance = (np.eye(6) * 1e-4).ravel().tolist()
        places.publish(message)
        time.sleep(0.05)
        for stamp in set(now) & set(standing):
            T_now, T_start = (
                conversions.pose_to_transform(each[stamp].pose.pose) for each in (now, standing)
            )
            if np.allclose(T_start, T_start_now @ T_now, atol=1e-3):
                assert now[stamp].header.frame_id == "ground_now"
                assert standing[stamp].pose.covariance[0] > now[stamp].pose.covariance[0]
                return True
        return False

    until(moved, 120, "a vehicle in the frame in which the robot stood")
    for each in heard:
        each.unregister()
    places.unregister()


def check(got, vehicles, folder):
    """Either camera relative to the other's, which needs no knowledge of home; the last poses of
    both."""
    from fcsv_geometry.ros import conversions

    T = {}
    for n in NAMES:
        message = got[n][-1]
        true = TruthReader(folder, n).at(message.header.stamp.to_sec()) @ vehicles[n].T_body_cam
        T[n] = conversions.pose_to_transform(message.pose.pose), true
        assert np.linalg.eigvalsh(np.array(message.pose.covariance).reshape(6, 6)).min() > 0
    found, true = (tf.invert(T["tello1"][k]) @ T["tello2"][k] for k in (0, 1))
    # both cameras' 2 cm, and their lever arms' degree
    assert np.linalg.norm(found[:3, 3] - true[:3, 3]) < 0.05
    assert np.degrees(tf.rotation_angle(found, true)) < 3.0


def test_a_vehicle_that_no_gimbal_follows_is_refused(start_node, root, robot_file):
    params = {
        "vehicles": ["uav1"],
        "vehicles_dir": str(root / "config" / "vehicles"),
        "robot_file": robot_file,
    }
    process = start_node("fcsv_tracking", "gimbal_tracker", params=params)
    until(lambda: process.returncode is not None, what="the end of the node")
    assert (
        process.returncode == 2
        and "no gimbal follows uav1; it has tello1, tello2" in process.tail(20)
    )


@pytest.mark.slow_motion
def test_servos_on_a_simulated_bus(start_node, robot_file):
    """The driver's node, the protocol on a pseudo-terminal, and the MX-12W behind it: command in,
    joints out."""
    import rospy
    from sensor_msgs.msg import JointState

    from fcsv_sim.gimbal.dynamixel_bus import SimulatedBus
    from fcsv_tracking.gimbal.geometry import Angles
    from fcsv_tracking.ros import joint_messages

    got = []
    subscriber = rospy.Subscriber("/tello2/gimbal/joint_states", JointState, got.append)
    command = rospy.Publisher("/tello2/gimbal/command", JointState, queue_size=5)
    with SimulatedBus([1, 2, 3, 4]) as bus:
        process = start_node(
            "fcsv_tracking",
            "gimbal_servos",
            params={"robot_file": robot_file, "port": bus.port, "rate_hz": 20.0},
        )
        until(lambda: got and command.get_num_connections(), what="joints")
        command.publish(
            joint_messages.to_message(time.time(), "tello2/gimbal_base", Angles(0.4, 0.3))
        )
        until(
            lambda: np.allclose(got[-1].position, [0.4, 0.3], atol=0.003),
            what="the gimbal at its goal",
        )
        assert (
            got[-1].header.frame_id == "tello2/gimbal_base"
            and abs(time.time() - got[-1].header.stamp.to_sec()) < 2.0
        )
        process.stop(grace_s=10.0)
    subscriber.unregister()

# SPDX-License-Identifier: Apache-2.0
"""The node tello_link with unmodified tellopy flies a simulated Tello over its own protocol, in
real time.

Its poses come as a mocap gives them: 20 a second, 0.11 s late, with noise. A Tello has one address,
and the node is a process of its own; the simulated one runs here, so that a test can break things.
"""

import math
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from support.tello_air import until
from support.tello_loop import CONFIG, MOCAP, SeenPoses

from fcsv_geometry import transforms
from fcsv_geometry.rotations import wrap
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.tello.drone import DroneParameters

pytestmark = [pytest.mark.ros, pytest.mark.slow]
START = (1.0, 0.5, 0.0, 0.3)


class Tracker(threading.Thread):
    """A motion capture of the simulated Tello, until closed; silent while ``lost``."""

    def __init__(self, name, drone):
        from geometry_msgs.msg import PoseStamped
        from rospy import Publisher

        super().__init__(name="mocap", daemon=True)
        self._odom, self._drone, self.lost, self._over = (
            f"{name}/odom",
            drone,
            False,
            threading.Event(),
        )
        self._seen = SeenPoses(MOCAP, 5)
        self._poses = Publisher(
            f"/{name}/mavros/vision_pose/pose", PoseStamped, queue_size=5, tcp_nodelay=True
        )
        self.start()

    def run(self):
        from fcsv_geometry.ros import conversions

        while not self._over.wait(0.005):
            for stamp_s, T in self._seen.take(time.time(), self._drone.drone.body.T_world_body):
                if not self.lost:
                    self._poses.publish(conversions.pose_stamped(T, stamp_s, self._odom))

    def close(self):
        self._over.set()
        self.join()
        self._poses.unregister()


class Operator:
    """What a person sees of the vehicle, and asks of it, by the names that an ArduCopter has them
    under."""

    def __init__(self, name):
        import rospy
        from geometry_msgs.msg import PoseStamped
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import BatteryState, Imu, Joy

        from fcsv_msgs.msg import LinkHealth, Refusal
        from mavros_msgs.msg import RCIn, State, StatusText

        self.name, self.newest, self.texts = name, SimpleNamespace(), []
        self._heard = []
        for key, topic, kind in (
            ("state", "mavros/state", State),
            ("pose", "mavros/local_position/pose", PoseStamped),
            ("battery", "mavros/battery", BatteryState),
            ("health", "flight_link/health", LinkHealth),
            ("odom", "tello/odom", Odometry),
            ("imu", "tello/imu", Imu),
            ("rc", "mavros/rc/in", RCIn),
            ("refusal", "flight_link/refusal", Refusal),
        ):
            setattr(self.newest, key, None)
            keep = lambda m, key=key: setattr(self.newest, key, m)  # noqa: E731
            self._heard.append(rospy.Subscriber(f"/{name}/{topic}", kind, keep, queue_size=5))
        texts = rospy.Subscriber(
            f"/{name}/mavros/statustext/recv", StatusText, lambda m: self.texts.append(m.text)
        )
        self._heard.append(texts)
        self._points = rospy.Publisher(
            f"/{name}/mavros/setpoint_position/local", PoseStamped, queue_size=1
        )
        self._joy = rospy.Publisher(f"/{name}/pilot/joy", Joy, queue_size=1)

    def ask(self, service, kind, *request):
        import rospy

        rospy.wait_for_service(f"/{self.name}/mavros/{service}", 20.0)
        return rospy.ServiceProxy(f"/{self.name}/mavros/{service}", kind)(*request)

    def mode(self, mode):
        from mavros_msgs.srv import SetMode

        return self.ask("set_mode", SetMode, 0, mode).mode_sent

    def take_off(self, altitude_m):
        from mavros_msgs.srv import CommandTOL

        return self.ask("cmd/takeoff", CommandTOL, 0.0, 0.0, 0.0, 0.0, altitude_m).success

    def send(self, T):
        from fcsv_geometry.ros import conversions

        self._points.publish(conversions.pose_stamped(T, time.time(), f"{self.name}/odom"))

    def stick(self, **share):
        from sensor_msgs.msg import Joy

        self._joy.publish(Joy(axes=[share.get(k, 0.0) for k in ("turn", "up", "left", "forward")]))

    def hears(self):
        """Every topic has its publisher: what is said from now on is heard."""
        until(lambda: all(s.get_num_connections() for s in self._heard), 20.0, "all topics")

    def refused(self, why):
        """A refusal says this; it comes on a topic of its own, after the service's answer."""
        until(lambda: why in getattr(self.newest.refusal, "reason", ""), 10.0, why)

    def close(self):
        for each in (*self._heard, self._points, self._joy):
            each.unregister()


class Flight:
    """A simulated Tello, its tracker, the node under the name flight_link, and the operator."""

    def __init__(self, start_node, air, name, **drone):
        network = air.network()
        self.tello = air.drone(network, vehicle=name, start_xyz_yaw=START, **drone)
        self.tracker, self._start, self._name = Tracker(name, self.tello), start_node, name
        self._radio = {"network": f"{network}-pilot"}
        self.operator = Operator(name)
        self.link = self.begin_link()

    def begin_link(self):
        params = {
            "vehicle": self._name,
            "gains": str(CONFIG / "velocity.yaml"),
            "radio": self._radio,
        }
        return self._start(
            "fcsv_control", "tello_link", name="flight_link", ns=self._name, params=params
        )

    @property
    def p_m(self):
        return self.tello.position_m

    def off(self, T):
        """(m, degrees) from a target, by the truth."""
        now = self.tello.drone.body.T_world_body
        turned = wrap(transforms.yaw(now) - transforms.yaw(T))
        return float(np.linalg.norm(now[:3, 3] - T[:3, 3])), abs(math.degrees(turned))

    def hold(self, T, seconds):
        """The worst (m, degrees) while a set-point is repeated as an agent does."""
        worst, end_s = np.zeros(2), time.monotonic() + seconds
        while time.monotonic() < end_s:
            self.operator.send(T)
            time.sleep(0.1)
            worst = np.maximum(worst, self.off(T))
        return worst

    def settle(self, T, most_s=10.0):
        """Held for a second as well as set-points are; at most so long."""
        over_s = time.monotonic() + most_s
        while np.any(self.hold(T, 1.0) > (0.15, 5.0)) and time.monotonic() < over_s:
            pass

    def ready(self):
        """Connected, with poses for as long as GUIDED asks for."""
        self.operator.hears()
        until(
            lambda: getattr(self.operator.newest.state, "connected", False),
            20.0,
            "its Tello is connected",
        )
        until(
            lambda: getattr(self.operator.newest.health, "feed_rate_hz", 0.0) > 10.0,
            10.0,
            "the tracker sees it",
        )
        until(
            lambda: self.operator.newest.battery and self.operator.newest.battery.percentage > 0.9,
            5.0,
            "battery",
        )

    def guided(self, T):
        """Off the ground and held at a target."""
        self.ready()
        assert self.operator.take_off(float(T[2, 3])), self.operator.texts
        until(lambda: self.p_m[2] > T[2, 3] - 0.3, 20.0, "at its altitude")
        until(lambda: self.operator.mode("GUIDED"), 5.0, "GUIDED")
        self.settle(T)

    def landed(self, timeout_s=30.0):
        until(lambda: not self.tello.drone.flight.flying, timeout_s, "on the ground")
        until(lambda: not self.operator.newest.state.armed, 5.0, "says that it is")

    def close(self):
        self.tracker.close()
        self.operator.close()


@pytest.fixture
def flight(start_node, tello_air, request):
    flights = []

    def fly(**drone):
        flights.append(
            Flight(start_node, tello_air, f"t_{request.node.name[5:25].strip('_')}", **drone)
        )
        return flights[-1]

    yield fly
    for each in flights:
        each.close()


def target(x, y, z, yaw):
    return transforms.from_xyz_yaw([x, y, z], yaw)


def test_holds_a_set_point_and_lands_when_told(flight):
    f = flight()
    f.ready()
    o = f.operator
    assert (
        o.newest.state.mode == Mode.LOITER
        and not o.newest.state.armed
        and o.newest.health.in_the_air == 0
    )
    assert o.newest.imu.linear_acceleration.z == pytest.approx(9.81, abs=0.5)
    assert o.newest.odom.header.frame_id == f"{f._name}/tello_odom"
    assert not o.mode(Mode.STABILIZE)
    o.refused("has no mode 'STABILIZE'")
    first = target(1.0, 0.5, 1.5, 0.3)
    f.guided(first)
    second = target(2.0, 0.0, 1.8, -0.3)
    f.hold(second, 10.0)
    off_m, off_deg = f.hold(second, 15.0)
    print(f"off by at most {off_m:.3f} m, {off_deg:.2f} degrees")
    assert off_m < 0.15 and off_deg < 5.0
    T = o.newest.pose.pose.position
    assert np.linalg.norm([T.x, T.y, T.z] - f.p_m) < 0.15
    assert o.newest.odom.pose.pose.position.z == pytest.approx(f.p_m[2], abs=0.3)
    assert o.mode("LAND")
    f.landed()


def test_low_battery_and_a_link_that_is_started_again(flight):
    """A link that starts in flight holds it; a low battery refuses GUIDED and lands what is not in
    a pilot's hands."""
    f = flight()
    f.guided(target(1.0, 0.5, 1.5, 0.3))
    before = f.p_m
    f.link.stop(grace_s=0.0)
    f.operator.newest.state = None
    f.begin_link()
    until(
        lambda: getattr(f.operator.newest.state, "mode", "") == Mode.BRAKE,
        15.0,
        "the new link holds it",
    )
    time.sleep(3.0)
    assert np.linalg.norm(f.p_m - before) < 0.8
    battery = f.tello.drone.flight.battery
    # what is switched on takes a share, too
    battery.drain((1.0 - 8.0 / battery.percent) * battery.left_s / 1.15, 1.0)
    until(lambda: f.operator.newest.state.mode == Mode.LAND, 5.0, "LAND")
    f.landed()
    f.operator.hears()
    assert not f.operator.take_off(1.5)
    f.operator.refused("charge it")


def test_a_pilot_takes_it(flight):
    f = flight()
    place = target(1.0, 0.5, 1.5, 0.3)
    f.guided(place)
    for _ in range(15):
        f.operator.stick(forward=0.5)
        f.operator.send(place)
        time.sleep(0.1)
    assert f.operator.newest.state.mode == Mode.LOITER and f.operator.newest.state.manual_input
    assert f.off(place)[0] > 0.3
    assert list(f.operator.newest.rc.channels) == [1500, 1750, 1500, 1500]
    assert f.operator.mode("LAND")
    f.landed()


def test_another_firmware_is_refused_by_name(flight):
    """Its flight data cannot be read: nothing is known of its battery, so nobody takes off."""
    f = flight(drone=DroneParameters(other_firmware=True))
    until(lambda: getattr(f.operator.newest.state, "connected", False), 20.0, "packets")
    f.operator.hears()
    assert not f.operator.take_off(1.5)
    f.operator.refused("no flight data")
    assert not f.tello.drone.flight.flying


def test_a_namespace_that_is_not_there_ends_the_node_with_a_line(start_node):
    params = {
        "vehicle": "t_none",
        "gains": str(CONFIG / "velocity.yaml"),
        "radio": {"network": "fcsv-nowhere"},
    }
    node = start_node("fcsv_control", "tello_link", name="flight_link", ns="t_none", params=params)
    until(lambda: node.returncode is not None, 20.0, "ends")
    assert "network namespace fcsv-nowhere: No such file or directory; make it first" in node.tail(
        30
    )

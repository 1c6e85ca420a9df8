# SPDX-License-Identifier: Apache-2.0
"""One whole vehicle on a real master: tracker, odometry, flight link and agent fly the simulated
autopilot."""

import os
import signal
import socket
import time

import numpy as np
import pytest
import yaml
from support.autopilots import PROFILE, PROFILE_FILE
from support.mavros_package import path_to_mavros
from support.waiting import within

from fcsv_control.flight_check.vehicle import VEHICLE_CHECKS
from fcsv_control.ros.flight_link.mavros_process import MavrosProcess
from fcsv_geometry import transforms
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.autopilot.gps import geographic
from fcsv_sim.machines.machines import free_port

pytestmark = [pytest.mark.ros, pytest.mark.slow]
RELAYED = "odometry/vision_pose"  # what the odometry says, before the test passes it on
NAME = "f_one"  # not uav1: other tests may use that on the same master
until = within(20.0)


class ControlPc:
    """What a control PC hears of the vehicle, and its commands, repeated until acknowledged."""

    def __init__(self):
        import rospy
        from geometry_msgs.msg import PoseStamped

        from fcsv_msgs.msg import Command, CommandAck, FlightCheck, Heartbeat
        from mavros_msgs.msg import State, StatusText

        self.check = FlightCheck()
        self.state, self.T_odom_body, self.texts, self.acks, self.number = State(), None, [], {}, 0
        self.set_points, lives = [], []
        self.sender = f"test-{time.time():.0f}"
        on = lambda topic, kind, do: rospy.Subscriber(f"/{NAME}/{topic}", kind, do, queue_size=50)  # noqa: E731
        self.heard = [
            on("mavros/state", State, lambda m: setattr(self, "state", m)),
            on("mavros/local_position/pose", PoseStamped, self.on_pose),
            on("mavros/statustext/recv", StatusText, lambda m: self.texts.append(m.text)),
            on("guardian/said", StatusText, lambda m: self.texts.append(m.text)),
            on("command_ack", CommandAck, lambda m: self.acks.setdefault(m.number, []).append(m)),
            on("mavros/setpoint_position/local", PoseStamped, self.set_points.append),
            on("agent/alive", Heartbeat, lives.append),
            on("flight_check", FlightCheck, lambda m: setattr(self, "check", m)),
        ]
        self.commands = rospy.Publisher(f"/{NAME}/command", Command, queue_size=20)
        until(lambda: self.commands.get_num_connections(), what="agent")
        listened = lambda: lives and lives[-1].sent_s - lives[-1].started_s > 1.2  # noqa: E731
        until(listened, what="an agent that has listened for another one, which takes a second")

    def on_pose(self, message):
        from fcsv_geometry.ros import conversions

        self.T_odom_body = conversions.pose_to_transform(message.pose)

    def command(self, kind, times=1, lifetime_s=5.0, **fields):
        """(result, reason) of the acknowledgement."""
        import rospy

        from fcsv_msgs.msg import Command

        self.number += 1
        number = self.number
        c = Command(
            vehicle=NAME, sender=self.sender, number=number, kind=getattr(Command, kind), **fields
        )
        c.header.stamp, c.lifetime_s = rospy.Time.now(), lifetime_s
        c.ordered_s = c.sent_s = time.monotonic()
        # said again although it was answered, as when the answer got lost
        for answers in range(1, times + 1):
            self.commands.publish(c)
            said_s = [time.monotonic()]

            def answered(n=answers, said_s=said_s):
                # as a mission does: an agent that has just begun says nothing
                if time.monotonic() - said_s[0] > 1.0:
                    said_s[0] = time.monotonic()
                    self.commands.publish(c)
                return len(self.acks.get(number, [])) >= n

            until(answered, what=f"{answers} acknowledgements of {kind}")
        return self.acks[number][-1].result, self.acks[number][-1].reason

    def at(self, xyz):
        return self.T_odom_body is not None and np.linalg.norm(self.T_odom_body[:3, 3] - xyz) < 0.3

    def parameters(self):
        import rospy

        from fcsv_msgs.msg import ParameterReport

        reports = []
        heard = rospy.Subscriber(f"/{NAME}/flight_link/parameters", ParameterReport, reports.append)
        until(lambda: reports and reports[-1].complete, 40.0, "all parameters")
        heard.unregister()
        return reports[-1]

    def fix(self):
        import rospy
        from sensor_msgs.msg import NavSatFix

        topic = f"/{NAME}/mavros/global_position/raw/fix"
        return rospy.wait_for_message(topic, NavSatFix, 20.0)

    def found(self, name):
        """(state, what) of a line of the flight check, as it crosses the radio."""
        from fcsv_control.ros.checks.flight_check_messages import lines_of

        return {line.name: (line.state.word, line.what) for line in lines_of(self.check)}.get(name)

    def relay_poses(self):
        """Of the odometry, on their way to the flight link: ``jump_m`` elsewhere."""
        import rospy
        from geometry_msgs.msg import PoseStamped

        self.jump_m = np.zeros(3)
        on = rospy.Publisher(
            f"/{NAME}/mavros/vision_pose/pose", PoseStamped, queue_size=1, tcp_nodelay=True
        )

        def moved(message):
            for axis, off_m in zip("xyz", self.jump_m):
                setattr(message.pose.position, axis, getattr(message.pose.position, axis) + off_m)
            on.publish(message)

        self.heard += [
            rospy.Subscriber(
                f"/{NAME}/{RELAYED}", PoseStamped, moved, queue_size=1, tcp_nodelay=True
            ),
            on,
        ]

    def close(self):
        for each in self.heard:
            each.unregister()
        self.commands.unregister()


@pytest.fixture(params=["mavlink", "mavros"])
def vehicle(request, root, start_node, ros_master, tmp_path):
    """The nodes of uav.launch that fly, and a ControlPc; ``vehicle.tracker`` may be stopped."""
    document = yaml.safe_load((root / "config/vehicles/uav1.yaml").read_text())
    (tmp_path / f"{NAME}.yaml").write_text(yaml.safe_dump({**document, "name": NAME}))
    port = free_port(socket.SOCK_DGRAM)
    both = {"vehicle": NAME, "vehicles_dir": str(tmp_path)}
    simulated = {**both, "sim_dir": str(tmp_path / "sim"), "seed": 3}
    (tmp_path / "sim").mkdir()
    start_node(
        "fcsv_sim",
        "vehicle",
        ns=NAME,
        params={**simulated, "mavlink_port": port, "rc_port": 0, "ready_s": 2.0, "gps": True},
    )
    tracker = start_node("fcsv_sim", "t265", ns=NAME, params=simulated)
    start_node(
        "fcsv_tracking",
        "odometry",
        ns=NAME,
        params=both,
        remaps={"mavros/vision_pose/pose": RELAYED},
    )
    line, link = (
        {"fcu_url": f"udpin:127.0.0.1:{port}", "autopilot_profile": str(PROFILE_FILE)},
        None,
    )
    if request.param == "mavlink":
        start_node("fcsv_control", "flight_link", ns=NAME, params={**both, **line})
    else:
        path = path_to_mavros(root, tmp_path)
        link = ros_master.run(
            [
                "env",
                f"ROS_PACKAGE_PATH={path}",
                f"ROS_NAMESPACE=/{NAME}",
                "roslaunch",
                "fcsv_bringup",
                "flight_link_mavros.launch",
                f"uav:={NAME}",
                f"vehicles_dir:={tmp_path}",
                *(f"{key}:={value}" for key, value in line.items()),
            ],
            "flight_link_mavros",
        )
    rules = {"transmitter": False}  # nobody flies by hand here
    start_node(
        "fcsv_control",
        "guardian",
        ns=NAME,
        params={"vehicle": NAME, "vehicles": [NAME], "rules": rules},
    )
    start_node("fcsv_control", "agent", ns=NAME, params={"vehicle": NAME})
    start_node("fcsv_control", "vehicle_check", ns=NAME, params={"vehicle": NAME})
    try:
        pc = ControlPc()
        pc.relay_poses()
        pc.tracker, pc.by_mavros = tracker, request.param == "mavros"
        yield pc
        print("said:", *pc.texts, sep="\n  ")
        pc.close()
    finally:
        if link is not None:
            link.signal(signal.SIGINT)
            link.stop()
            print(link.tail(40))


def target(x, y, z, yaw, frame=f"{NAME}/odom"):
    from fcsv_geometry.ros import conversions

    return conversions.pose_stamped(transforms.from_xyz_yaw([x, y, z], yaw), time.time(), frame)


def arm_in_guided(pc):
    """Arming is possible once origin and fusion are there: as an operator, try until the reasons
    are gone."""
    until(
        lambda: pc.state.connected and pc.T_odom_body is not None,
        40.0,
        "connection and an estimate",
    )
    deadline, reason = time.monotonic() + 40.0, "never asked"
    while time.monotonic() < deadline:
        result, reason = pc.command("SET_MODE", mode=Mode.GUIDED)
        if result == 0:
            result, reason = pc.command("ARM", flag=True)
        if result == 0:
            return
        assert "refused" in reason or "the guardian forbids it" in reason, reason
        time.sleep(0.3)
    raise AssertionError(reason)


@pytest.mark.slow_motion
@pytest.mark.timeout(600)
def test_flights_by_command_a_landing_that_overtakes_and_a_dead_tracker(vehicle, ros_master):
    """One vehicle, started once: it is landed by command, takes off again, and loses its
    tracker."""
    pc = vehicle
    until(lambda: pc.state.connected, 40.0, "autopilot")
    report = pc.parameters()
    assert report.profile == PROFILE.name and not report.blocks and not report.advises
    assert dict(zip(report.limits, report.limit_values)) == FlightBounds().autopilot_parameters
    if not pc.by_mavros:  # the double of MAVROS tells no fixes
        fix = pc.fix()
        place = geographic((0.0, 0.0, 0.0))
        assert (fix.latitude, fix.longitude) == pytest.approx(place[:2], abs=2e-4)
        assert fix.altitude == pytest.approx(place[2], abs=30.0) and fix.status.status == 0
        assert fix.position_covariance[0] == 4.0 and fix.position_covariance_type == 2
    # not in GUIDED: refused, not queued
    assert pc.command("GOTO", target=target(0, 0, 3, 0.0))[0] == 1
    assert "GUIDED" in pc.acks[pc.number][-1].reason
    arm_in_guided(pc)

    assert pc.command("TAKEOFF", altitude_m=3.0) == (0, "")
    start = pc.T_odom_body[:3, 3].copy()
    above = np.array([start[0], start[1], 3.0])
    until(lambda: pc.at(above), 30.0, "3 m")

    there = target(*(above + [2.0, 1.0, 0.5]), 0.3)
    assert pc.command("GOTO", times=3, target=there) == (0, "")
    until(lambda: pc.at(above + [2.0, 1.0, 0.5]), 20.0, "the target")
    until(lambda: abs(transforms.yaw(pc.T_odom_body) - 0.3) < 0.05, what="the yaw")

    assert "not finite" in pc.command("GOTO", target=target(float("nan"), 0, 3, 0.0))[1]
    assert "uav9/odom" in pc.command("GOTO", target=target(0, 0, 3, 0.0, "uav9/odom"))[1]
    assert pc.command("GOTO", lifetime_s=-1.0, target=target(0, 0, 3, 0.0))[0] == 2  # came too late
    assert "mode 'ACRO' is for pilots" in pc.command("SET_MODE", mode="ACRO")[1]
    assert (
        "m above the take-off place"
        in pc.command("GOTO", target=target(start[0], start[1], -47.0, 0.0))[1]
    )
    pc.set_points.clear()
    until(lambda: len(pc.set_points) > 10, what="the target, which goes on without anybody asking")
    stamps_s = [p.header.stamp.to_sec() for p in pc.set_points[:11]]
    assert (stamps_s[-1] - stamps_s[0]) / 10 == pytest.approx(0.1, abs=0.02)  # 10 Hz
    assert np.allclose(pc.set_points[-1].pose.position.x, above[0] + 2.0)
    the_check_shows_what_this_vehicle_lacks(pc, ros_master)
    a_reset_of_a_metre_that_was_announced_is_adopted(pc, above + [2.0, 1.0, 0.5])
    if pc.by_mavros:
        a_mavros_that_hangs_is_ended_and_starts_again(pc)
    landing_overtakes_what_waits(pc)

    arm_in_guided(pc)
    assert pc.command("TAKEOFF", altitude_m=2.0) == (0, ""), pc.texts
    until(lambda: pc.T_odom_body[2, 3] > 1.8, 30.0, "2 m")
    pc.tracker.stop()
    until(
        lambda: pc.found("feed")[0] == pc.found("tracker")[0] == "RED",
        5.0,
        "what the flight check says of it",
    )
    until(lambda: pc.state.mode == Mode.LAND, 5.0, "the landing of guardian or watchdog")
    assert any("no poses of the tracker for 0.7 s" in t for t in pc.texts)
    until(lambda: not pc.state.armed, 60.0, "the ground")


def the_check_shows_what_this_vehicle_lacks(pc, ros_master):
    """It hovers; nobody started a camera, a recorder and a relay, and no transmitter is on."""
    lacks = {"camera", "recorder", "disk", "transmitter", "keys"}
    well = {check.name for check in VEHICLE_CHECKS} - lacks
    until(
        lambda: set(pc.check.green.split()) == well,
        what="a flight check that is green but for what is not there",
    )
    assert (
        pc.found("transmitter") == ("RED", "no transmitter is heard")
        and pc.found("camera")[0] == "RED"
    )
    command = ros_master.run(["rosrun", "fcsv_control", "flight_check"], "flight_check")
    until(lambda: command.returncode is not None, what="the table")
    assert command.returncode == 2 and "flight check: RED, 5 of 18 lines not green" in command.tail(
        60
    )


def a_reset_of_a_metre_that_was_announced_is_adopted(pc, here):
    """The autopilot ignores poses for 1.08 s. Before, the feed check compared meanwhile, and it was
    landed."""
    import rospy
    from std_srvs.srv import Trigger

    assert rospy.ServiceProxy(f"/{NAME}/flight_link/odometry_reset", Trigger)().success
    pc.jump_m[0] = 1.0
    pc.set_points.clear()
    until(lambda: pc.at(here + [1.0, 0.0, 0.0]), what="the autopilot in the new frame")
    until(
        lambda: np.isclose(pc.set_points[-1].pose.position.x, here[0] + 1.0, atol=0.3),
        what="the target, moved along",
    )
    end_s = time.monotonic() + 3.0
    until(lambda: time.monotonic() > end_s, what="three seconds")
    assert pc.state.mode == Mode.GUIDED and pc.state.armed and pc.at(here + [1.0, 0.0, 0.0])
    assert not any("apart" in t or "runs off" in t for t in pc.texts), pc.texts


def a_mavros_that_hangs_is_ended_and_starts_again(pc):
    """It hovers meanwhile: the autopilot goes on without poses for 8 s."""
    hung = mavros_pid()
    os.kill(hung, signal.SIGSTOP)
    until(
        lambda: any("MAVROS hung and was ended, it starts again" in t for t in pc.texts),
        what="the companion",
    )
    assert any("the flight link hears no autopilot" in t for t in pc.texts), pc.texts
    until(lambda: mavros_pid() not in (None, hung), what="another MAVROS")
    pc.T_odom_body, pc.state.mode = None, ""
    until(
        lambda: pc.T_odom_body is not None and pc.state.mode,
        what="what the autopilot says through it",
    )
    assert pc.state.mode == Mode.GUIDED and pc.state.armed


def mavros_pid():
    """Process id, None while it does not answer."""
    return MavrosProcess(f"/{NAME}/mavros").pid()


def landing_overtakes_what_waits(pc):
    """A service that hangs must not keep a vehicle in the air."""
    from fcsv_msgs.msg import Command

    times = {"ordered_s": time.monotonic(), "sent_s": time.monotonic(), "lifetime_s": 5.0}
    for number, (kind, fields) in enumerate(
        [("ARM", {"flag": True}), ("SET_MODE", {"mode": Mode.GUIDED}), ("HOLD", {}), ("LAND", {})],
        pc.number + 1,
    ):
        pc.commands.publish(
            Command(
                vehicle=NAME,
                sender=pc.sender,
                number=number,
                kind=getattr(Command, kind),
                **times,
                **fields,
            )
        )
    until(lambda: pc.state.mode == Mode.LAND, 6.0, "LAND")
    until(lambda: not pc.state.armed, 60.0, "the ground")
    pc.number += 4


def test_a_line_that_cannot_be_opened_ends_the_node_with_one_line(root, start_node):
    params = {
        "vehicle": "uav1",
        "fcu_url": "/dev/no_such_device:57600",
        "autopilot_profile": str(PROFILE_FILE),
    }
    node = start_node("fcsv_control", "flight_link", ns="f_two", params=params)
    until(lambda: node.returncode is not None, what="its end")
    assert node.returncode == 2
    said = [line for line in node.tail(20).splitlines() if "cannot be opened" in line]
    assert said and "Traceback" not in node.tail(50)


@pytest.mark.parametrize(
    "package, node, params, named",
    [
        (
            "fcsv_control",
            "agent",
            {"vehicle": "uav1", "set_point_rate_hz": 500.0},
            "set_point_rate_hz",
        ),
        ("fcsv_control", "agent", {"vehicle": "uav1", "colour": "red"}, "colour"),
        (
            "fcsv_control",
            "flight_link",
            {
                "vehicle": "uav1",
                "fcu_url": "udpin:127.0.0.1:0",
                "autopilot_profile": "",
                "link": {"rate": 3},
            },
            "rate",
        ),
    ],
)
def test_wrong_parameters_end_the_node_and_are_named(start_node, package, node, params, named):
    process = start_node(package, node, ns="f_three", params=params)
    until(lambda: process.returncode is not None, what="its end")
    assert (
        process.returncode == 2
        and named in process.tail(20)
        and "Traceback" not in process.tail(50)
    )

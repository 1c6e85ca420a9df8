# SPDX-License-Identifier: Apache-2.0
"""The mission as a node: a fleet of stand-ins on a real master, from WAIT_VEHICLES to a capture and
an abort."""

import threading
import time

import numpy as np
import pytest
import yaml
from support.waiting import within

from fcsv_geometry import transforms
from fcsv_geometry.missions.mission import load_mission
from fcsv_geometry.vehicles.modes import Mode
from fcsv_geometry.vehicles.vehicle import load_vehicles

pytestmark = pytest.mark.ros
NAMES = ("m_front", "m_back")  # not uav1, uav2: other tests may use those on the same master
until = within(15.0)


class StandIn:
    """A vehicle as the control PC hears it, and an agent that obeys; its odometry frame is
    anywhere."""

    def __init__(self, geometry, place_m, seed):
        import rospy
        from geometry_msgs.msg import PoseStamped
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import BatteryState

        from fcsv_msgs.msg import Command, CommandAck, Epoch, RecorderStatus, TagDetections
        from mavros_msgs.msg import State

        random = np.random.default_rng(seed)
        self.geometry, self.name = geometry, geometry.name
        self.T_home_odom = transforms.from_xyz_yaw(random.uniform(-9, 9, 3), random.uniform(-3, 3))
        self.T_home_body = transforms.from_xyz_yaw(place_m, 0.0)
        self.mode, self.armed, self.height_m, self.recording, self.sees = (
            Mode.STABILIZE,
            False,
            0.0,
            False,
            None,
        )
        self.commands, self.answers, self.pictures, self.check = [], {}, 0, None
        topic = lambda t, kind: rospy.Publisher(f"/{self.name}/{t}", kind, queue_size=20)  # noqa: E731
        self.odometry, self.state = topic("odometry/state", Odometry), topic("mavros/state", State)
        self.position = topic("mavros/local_position/pose", PoseStamped)
        self.recorder, self.battery = (
            topic("recorder/status", RecorderStatus),
            topic("mavros/battery", BatteryState),
        )
        self.epoch = rospy.Publisher(
            f"/{self.name}/odometry/epoch", Epoch, queue_size=1, latch=True
        )
        self.epoch.publish(Epoch(epoch=7, reason="start"))
        self.tags, self.acks = (
            topic("tags/detections", TagDetections),
            topic("command_ack", CommandAck),
        )
        self.commanded = rospy.Subscriber(
            f"/{self.name}/command", Command, self.on_command, queue_size=20
        )
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.talk)
        self.thread.start()

    def talk(self):
        import rospy
        from geometry_msgs.msg import PoseStamped
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import BatteryState

        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import RecorderStatus, TagDetection, TagDetections
        from mavros_msgs.msg import State

        while not self.over.wait(0.05):
            now = conversions.header(rospy.get_time(), "")
            T = transforms.invert(self.T_home_odom) @ self.T_home_body
            odometry = Odometry(header=conversions.header(rospy.get_time(), f"{self.name}/odom"))
            odometry.pose.pose = conversions.transform_to_pose(T)
            self.odometry.publish(odometry)
            position = PoseStamped(header=now)
            position.pose.position.z = 50.0 + self.height_m
            self.position.publish(position)
            self.state.publish(State(header=now, connected=True, armed=self.armed, mode=self.mode))
            self.battery.publish(BatteryState(header=now, percentage=0.9))
            self.pictures += 2 * self.recording
            self.recorder.publish(RecorderStatus(header=now, pictures=self.pictures))
            if self.sees is not None:
                self.tags.publish(
                    TagDetections(
                        header=now, vehicle=self.name, detections=[TagDetection(id=self.sees)]
                    )
                )

    def on_command(self, c):
        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import Command, CommandAck

        assert c.vehicle == self.name and c.ordered_s <= c.sent_s < c.ordered_s + c.lifetime_s
        if (c.sender, c.number) not in self.answers:
            self.answers[c.sender, c.number] = True
            self.commands.append(c)
            if len(self.commands) % 3 == 0:
                return  # lost on the radio; its repetition is not
        if c.kind == Command.GOTO:
            assert c.target.header.frame_id == f"{self.name}/odom"
            self.T_home_body = self.T_home_odom @ conversions.pose_to_transform(c.target.pose)
        elif c.kind == Command.SET_MODE:
            self.mode = c.mode
        elif c.kind == Command.RECORD:
            self.recording = c.flag
        elif c.kind == Command.LAND:
            self.mode, self.armed, self.height_m = Mode.LAND, False, 0.0
        self.acks.publish(
            CommandAck(vehicle=self.name, sender=c.sender, number=c.number, result=CommandAck.DONE)
        )

    def close(self):
        if self.check is not None:
            self.check.close()
        self.over.set()
        self.thread.join()
        for one in (
            self.odometry,
            self.state,
            self.position,
            self.recorder,
            self.battery,
            self.tags,
            self.acks,
            self.commanded,
            self.epoch,
        ):
            one.unregister()


class ControlPc:
    """Stands in for calibration, and watches the mission."""

    def __init__(self, fleet):
        import rospy
        from std_msgs.msg import String
        from std_srvs.srv import Trigger

        from fcsv_geometry.ros import fences
        from fcsv_msgs.msg import Calibration, Capture, Epochs, Fence, Home, MissionState
        from fcsv_msgs.srv import Calibrate, Control, Proceed, SetHome

        self.fleet, self.mission, self.captures, self.calibrations = fleet, MissionState(), [], 0
        self.calibration = rospy.Publisher("/calibration", Calibration, queue_size=1, latch=True)
        self.epochs = rospy.Publisher("/calibration_epochs", Epochs, queue_size=1, latch=True)
        self.home = rospy.Publisher("/home", Home, queue_size=1, latch=True)
        self.services = [
            rospy.Service("/calibrate", Calibrate, self.on_calibrate),
            rospy.Service("/set_home", SetHome, self.on_set_home),
        ]
        self.watches = [
            rospy.Subscriber("/mission/state", MissionState, lambda m: setattr(self, "mission", m)),
            rospy.Subscriber("/mission/capture", Capture, self.captures.append),
            rospy.Subscriber("/mission/file", String, lambda m: setattr(self, "file", m.data)),
            rospy.Subscriber(
                "/mission/fence", Fence, lambda m: setattr(self, "fence", fences.from_message(m))
            ),
        ]
        self.proceed = rospy.ServiceProxy("/mission/proceed", Proceed)
        self.abort = rospy.ServiceProxy("/mission/abort", Trigger)
        self.control = rospy.ServiceProxy("/mission/control", Control)

    def on_calibrate(self, request):
        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import Calibration, CalibrationLink, Epochs
        from fcsv_msgs.srv import CalibrateResponse

        assert tuple(request.column) == NAMES
        self.calibrations += 1
        if self.calibrations == 1:
            return CalibrateResponse(False, "too few detections", Calibration())
        front, back = self.fleet
        T = transforms.invert(front.T_home_odom) @ back.T_home_odom
        pose = conversions.transform_to_pose(T)
        message = Calibration(
            links=[CalibrationLink(parent=NAMES[0], child=NAMES[1], child_odom_in_parent_odom=pose)]
        )
        self.calibration.publish(message)
        self.epochs.publish(Epochs(vehicles=NAMES, epochs=[7, 7]))
        return CalibrateResponse(True, "calibrated", message)

    def on_set_home(self, request):
        from fcsv_geometry.ros import conversions
        from fcsv_msgs.msg import Home
        from fcsv_msgs.srv import SetHomeResponse

        pose = conversions.transform_to_pose(transforms.invert(self.fleet[0].T_home_odom))
        message = Home(reference=request.reference, home_in_odom=pose)
        self.home.publish(message)
        return SetHomeResponse(True, "home is set", message)

    def wait_for(self, phase, waits_for=None):
        until(
            lambda: self.mission.phase_name == phase and waits_for in (None, self.mission.waits_for)
        )

    def up_to_home(self):
        """What people do before "execute"; the first calibration fails."""
        _front, back = self.fleet
        self.wait_for("TAKE_OFF")
        for v in self.fleet:
            v.armed, v.mode = True, Mode.LOITER
        time.sleep(0.5)  # the ground is where they stood with motors off
        for v in self.fleet:
            v.height_m = 3.0
        back.sees = 1
        for _ in range(2):
            self.wait_for("COLUMN", "calibrate")
            self.confirm("calibrate")
        self.wait_for("MOVE_HOME", "set_home")
        self.confirm("set_home")
        self.wait_for("SET_HOME", "execute")

    def forget(self):
        """As after a reboot: nobody tells calibration and home any more."""
        self.calibration.unregister()
        self.home.unregister()

    def confirm(self, step):
        """As people do: again where the step before was confirmed a moment ago."""
        answers = []

        def accepted():
            answers.append(self.proceed(step))
            return answers[-1].success

        until(accepted, what=lambda: f"{step}: {answers[-1].message}; {self.mission.detail}")

    def close(self):
        for service in self.services:
            service.shutdown()
        for one in (self.calibration, self.epochs, self.home, *self.watches):
            one.unregister()


@pytest.fixture
def folder(tmp_path, root):
    """Vehicles of our names, and a short mission."""
    for name, other in zip(NAMES, ("uav1", "uav2")):
        document = yaml.safe_load((root / "config" / "vehicles" / f"{other}.yaml").read_text())
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump({**document, "name": name}))
    configurations = [{"axis": "horizontal", "baseline_m": 4.0, "tilt_deg": 5.0, "record_s": 0.5}]
    configurations.append({"axis": "vertical", "baseline_m": 5.0, "record_s": 60.0})
    mission = {
        "name": "node",
        "reference": NAMES[0],
        "configurations": configurations,
        "settle": {"time_s": 0.3},
    }
    (tmp_path / "mission.yaml").write_text(yaml.safe_dump(mission))
    return tmp_path


@pytest.mark.slow_motion
def test_from_the_ground_to_a_capture_and_down_again(ros_master, start_node, folder):
    geometry = load_vehicles(folder, NAMES)
    lever = geometry[NAMES[0]].T_body_cam[:3, 3]
    front, back = fleet = [
        StandIn(g, np.array([-3.5 * i, 0.0, 0.0]) - lever, i)
        for i, g in enumerate(geometry.values())
    ]
    pc = ControlPc(fleet)
    params = {
        "mission": str(folder / "mission.yaml"),
        "vehicles": list(NAMES),
        "vehicles_dir": str(folder),
    }
    try:
        start_node("fcsv_control", "mission", params=params)
        check = the_check_locks_take_off(pc)
        pc.wait_for("TAKE_OFF")
        assert pc.file == (folder / "mission.yaml").read_text()
        assert pc.fence == load_mission(folder / "mission.yaml").fence
        assert not pc.proceed("calibrate").success
        for v in fleet:
            v.armed, v.mode = True, Mode.LOITER
        time.sleep(0.5)
        assert pc.mission.phase_name == "TAKE_OFF", (
            "armed, but still on the ground (which is at 50 m in its odometry)"
        )
        for v in fleet:
            v.height_m = 3.0
        pc.wait_for("COLUMN")
        back.sees = 1
        pc.wait_for("COLUMN", "calibrate")
        pc.confirm("calibrate")
        until(lambda: pc.mission.detail == "too few detections")
        pc.wait_for("COLUMN", "calibrate")
        pc.confirm("calibrate")
        pc.wait_for("MOVE_HOME", "set_home")
        pc.confirm("set_home")
        pc.wait_for("SET_HOME", "execute")
        the_check_locks_guided(pc, check)
        pc.confirm("execute")
        until(lambda: pc.captures)
        c = pc.captures[0]
        assert (c.index, c.reference, c.vehicle) == (0, *NAMES) and c.position_error_m < 0.01
        assert (c.configuration.axis, c.configuration.baseline_m) == (
            c.configuration.HORIZONTAL,
            4.0,
        )
        assert c.configuration.tilt_rad == pytest.approx(np.radians(5.0))
        # what was wanted; up to four times that, where the pictures were counted late
        assert 0.499 < (c.stop - c.start).to_sec() < 2.1
        assert abs(c.stop.to_sec() - time.time()) < 5.0
        until(lambda: back.recording and pc.mission.configuration == 1)
        np.testing.assert_allclose(
            (back.T_home_body @ geometry[NAMES[1]].T_body_cam)[:3, 3], [0, 0, 5], atol=1e-6
        )
        began_anew_and_stopped(pc, back)
        assert pc.abort().success
        pc.wait_for("ABORTED")
        assert not back.recording and not front.armed and not back.armed
        assert np.linalg.norm((back.T_home_body - front.T_home_body)[:2, 3]) > 1.5, (
            "not down upon the reference"
        )
        assert not pc.abort().success
        numbers = [c.number for c in back.commands]
        assert (
            numbers == sorted(set(numbers))
            and len({c.sender for c in back.commands + front.commands}) == 1
        )
    finally:
        pc.close()
        for v in fleet:
            v.close()


class Check:
    """Stands in for fleet_check: one line, told ten times a second."""

    def __init__(self):
        import rospy

        from fcsv_control.conditions import Grade
        from fcsv_control.flight_check.lines import Line
        from fcsv_control.ros.checks.flight_check_messages import whole
        from fcsv_geometry.ros import node
        from fcsv_msgs.msg import FlightCheck

        self.state, self.accepted = "RED", False
        self.topic = rospy.Publisher("/flight_check", FlightCheck, queue_size=2)
        line = lambda: Line(NAMES[1], "battery", Grade[self.state], "31%", accepted=self.accepted)  # noqa: E731
        self.timer = node.every(0.1, lambda _event: self.topic.publish(whole([line()], 0.3)))

    def close(self):
        self.timer.shutdown()
        self.timer.join()
        self.topic.unregister()


def the_check_locks_take_off(pc):
    until(
        lambda: any("flight check is not heard" in p for p in pc.mission.problems),
        what="a mission that waits",
    )
    check = Check()
    pc.fleet[0].check = check  # closed with it
    named = f"flight check: {NAMES[1]} battery is RED"
    until(lambda: named in pc.mission.problems, what="the line that locks")
    assert pc.mission.phase_name == "WAIT_VEHICLES"
    check.state = "AMBER"
    return check


def the_check_locks_guided(pc, check):
    said = []

    def locked():
        """As people do: again where the step before was confirmed a moment ago."""
        said.append(pc.proceed("execute"))
        return "GUIDED is locked" in said[-1].message

    until(locked, what="a refusal of the flight check")
    assert (
        not any(answer.success for answer in said)
        and f"{NAMES[1]} battery is amber (31%)" in said[-1].message
    )
    assert "--accept VEHICLE LINE" in said[-1].message and pc.mission.phase_name == "SET_HOME"
    check.accepted = True


def began_anew_and_stopped(pc, vehicle):
    """The mission holds and says why, for either; the vehicle's next calibration would end the
    first."""
    import rospy
    from std_msgs.msg import String

    from fcsv_msgs.msg import Epoch

    vehicle.epoch.publish(Epoch(epoch=8, reason="the tracker was silent for 0.7 s"))
    named = f"{vehicle.name}: its odometry began anew (the tracker was silent for 0.7 s)"
    until(lambda: any(named in p for p in pc.mission.problems), what="the vehicle is named")
    until(lambda: vehicle.commands[-1].kind == vehicle.commands[-1].HOLD, what="HOLD")
    stop = rospy.Publisher("/stop_all", String, queue_size=1, latch=True)
    stop.publish(String("a test"))
    until(
        lambda: "everybody was stopped (a test)" in pc.mission.detail,
        what="the mission hears of a stop",
    )
    stop.unregister()


@pytest.fixture
def pair(ros_master, folder):
    """Two stand-ins in a column, and a control PC that knows them."""
    geometry = load_vehicles(folder, NAMES)
    lever = geometry[NAMES[0]].T_body_cam[:3, 3]
    fleet = [
        StandIn(g, np.array([-3.5 * i, 0.0, 0.0]) - lever, i)
        for i, g in enumerate(geometry.values())
    ]
    pc = ControlPc(fleet)
    yield pc
    pc.close()
    for v in fleet:
        v.close()


def started(start_node, folder, **more):
    params = {
        "mission": str(folder / "mission.yaml"),
        "vehicles": list(NAMES),
        "vehicles_dir": str(folder),
        "flight_check": "off",
        **more,
    }
    return start_node("fcsv_control", "mission", params=params)


@pytest.mark.slow_motion
def test_a_control_pc_that_is_gone_and_comes_back_goes_on(pair, start_node, folder):
    """Killed while it records the second configuration; calibration and home are gone with the
    computer."""
    import rospy

    from fcsv_geometry.ros import conversions
    from fcsv_msgs.msg import Calibration, Command, Home

    front, back = pair.fleet
    process = started(start_node, folder, memory_dir=str(folder / "memory"))
    pair.up_to_home()
    pair.confirm("execute")
    # not the first
    until(
        lambda: back.recording and pair.mission.configuration == 1 and back.T_home_body[2, 3] > 4.0
    )
    until(lambda: '"index": 0' in (folder / "memory" / "mission_memory.json").read_text())
    place = back.T_home_body.copy()
    process.kill()
    pair.forget()
    said = {"calibration": [], "home": []}
    watches = [
        rospy.Subscriber("/calibration", Calibration, said["calibration"].append),
        rospy.Subscriber("/home", Home, said["home"].append),
    ]
    before = {v.name: len(v.commands) for v in pair.fleet}
    begun_s = time.monotonic()
    started(start_node, folder, memory_dir=str(folder / "memory"))
    until(lambda: all(len(v.commands) > before[v.name] for v in pair.fleet))
    took_s = time.monotonic() - begun_s
    assert {v.commands[before[v.name]].kind for v in pair.fleet} == {Command.HOLD}
    assert took_s < 10.0  # 5 s of the node and the start of its interpreter on a busy machine
    until(lambda: said["calibration"] and said["home"])
    assert said["home"][-1].reference == NAMES[0]
    np.testing.assert_allclose(
        conversions.pose_to_transform(said["home"][-1].home_in_odom),
        transforms.invert(front.T_home_odom),
        atol=1e-9,
    )
    until(lambda: pair.mission.phase_name == "CONFIGURATIONS" and pair.mission.configuration == 1)
    until(lambda: back.commands[-1].kind == Command.RECORD and back.commands[-1].flag)
    np.testing.assert_allclose(back.T_home_body, place, atol=1e-6)
    until(lambda: [c.index for c in pair.captures] == [0, 0])  # told again, not flown again
    # two readings of two clocks: a moment on a busy machine, a fortieth of a picture's period
    assert abs((pair.captures[0].start - pair.captures[1].start).to_sec()) < 5e-3
    assert pair.abort().success
    pair.wait_for("ABORTED")
    for watch in watches:
        watch.unregister()


@pytest.mark.slow_motion
def test_pictures_that_show_another_place_land_everybody(pair, start_node, folder):
    """Two looks in a row: a tracker drifts."""
    import rospy

    from fcsv_msgs.msg import PairLook

    started(start_node, folder)
    pair.up_to_home()
    pair.confirm("execute")
    until(lambda: pair.captures, what="a recording")
    looks = rospy.Publisher("/pair_check", PairLook, queue_size=5)
    until(looks.get_num_connections, what="the mission listens")
    for _ in range(2):
        looks.publish(
            PairLook(
                reference=NAMES[0], vehicle=NAMES[1], matches=90, agree=80, off_m=2.0, off=True
            )
        )
    pair.wait_for("ABORTED")
    assert (
        f"pictures of it and {NAMES[0]} show another place than their trackers"
        in pair.mission.detail
    )
    looks.unregister()


@pytest.mark.slow_motion
def test_chosen_configurations_by_action_and_operations_by_service(pair, start_node, folder):
    import actionlib
    import rospy
    from actionlib_msgs.msg import GoalStatus

    from fcsv_msgs.msg import ExecuteAction, ExecuteGoal

    front, back = pair.fleet
    started(start_node, folder)
    pair.wait_for("TAKE_OFF")
    client, told = actionlib.SimpleActionClient("/mission/execute", ExecuteAction), []
    assert client.wait_for_server(rospy.Duration(15.0))
    client.send_goal_and_wait(ExecuteGoal([0]))
    assert (
        client.get_state() == GoalStatus.REJECTED
        and "not waited for in" in client.get_goal_status_text()
    )
    assert "this is TAKE_OFF" in pair.control("pause").message
    assert "is not one of" in pair.control("fly").message
    pair.up_to_home()
    time.sleep(1.2)
    client.send_goal(ExecuteGoal([1, 0]), feedback_cb=told.append)
    until(lambda: back.recording and pair.mission.configuration == 1)
    assert pair.control("skip").success
    until(lambda: pair.captures)
    assert client.wait_for_result(rospy.Duration(30.0))
    result = client.get_result()
    assert (list(result.captured), list(result.left_out)) == (
        [0],
        [1],
    ) and client.get_state() == GoalStatus.SUCCEEDED
    assert {f.phase for f in told} >= {"CONFIGURATIONS"} and max(f.progress for f in told) >= 0.5
    pair.wait_for("DONE")  # its state comes by another topic than the result
    assert not front.armed and not back.armed


@pytest.mark.slow_motion
def test_who_follows_goes_where_a_topic_asks(pair, start_node, folder):
    import actionlib
    import rospy
    from actionlib_msgs.msg import GoalStatus

    from fcsv_geometry.ros import conversions
    from fcsv_msgs.msg import ExecuteAction, ExecuteGoal, VehicleMove

    path = folder / "mission.yaml"
    follow = {"axis": "horizontal", "baseline_m": 3.0, "follow_s": 60.0}
    document = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump({**document, "configurations": [follow]}))
    back = pair.fleet[1]
    started(start_node, folder)
    moves = rospy.Publisher("/mission/follow", VehicleMove, queue_size=5)
    pair.up_to_home()
    client = actionlib.SimpleActionClient("/mission/execute", ExecuteAction)
    assert client.wait_for_server(rospy.Duration(15.0))
    time.sleep(1.2)
    client.send_goal(ExecuteGoal())
    until(lambda: pair.mission.stage == "follows" and moves.get_num_connections())
    for frame, x_m in (("home", 2.0), ("odom", 9.0)):
        header = conversions.header(rospy.get_time(), frame)
        moves.publish(VehicleMove(header, NAMES[1], x_m, -4.0, 0.0, 0.0, False))
    p_body_cam = back.geometry.T_body_cam[:3, 3]
    until(lambda: np.allclose((back.T_home_body[:3, 3] + p_body_cam)[:2], [2.0, -4.0], atol=0.01))
    until(lambda: pair.mission.detail.endswith("all hold"))
    assert pair.control("skip").success and client.wait_for_result(rospy.Duration(30.0))
    result = client.get_result()
    assert (list(result.captured), list(result.left_out)) == ([], [])
    assert client.get_state() == GoalStatus.SUCCEEDED and not pair.captures
    moves.unregister()


@pytest.mark.slow_motion
def test_a_goal_that_is_cancelled_brings_them_back_to_the_column(pair, start_node, folder):
    import actionlib
    import rospy
    from actionlib_msgs.msg import GoalStatus

    from fcsv_msgs.msg import ExecuteAction, ExecuteGoal

    _front, back = pair.fleet
    column = back.T_home_body.copy()
    started(start_node, folder)
    pair.up_to_home()
    client = actionlib.SimpleActionClient("/mission/execute", ExecuteAction)
    assert client.wait_for_server(rospy.Duration(15.0))
    time.sleep(1.2)
    client.send_goal(ExecuteGoal())
    until(lambda: back.recording and pair.mission.configuration == 1)
    client.cancel_goal()
    assert client.wait_for_result(rospy.Duration(30.0))
    assert client.get_state() == GoalStatus.PREEMPTED and list(client.get_result().left_out) == [1]
    np.testing.assert_allclose(back.T_home_body, column, atol=1e-6)


@pytest.mark.parametrize(
    "change, words",
    [
        ({"configurations": []}, "configurations: the list is empty"),
        ({"reference": "uav9"}, "reference 'uav9'"),
        ({"speed": 1}, "unknown key 'speed'"),
        (
            {"configurations": [{"axis": "vertical", "baseline_m": 60.0}]},
            "(vertical 60 m): 68 m above",
        ),
    ],
)
def test_a_mission_that_cannot_be_flown_ends_the_node_with_one_line(
    start_node, folder, change, words
):
    path = folder / "mission.yaml"
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **change}))
    params = {"mission": str(path), "vehicles": list(NAMES), "vehicles_dir": str(folder)}
    process = start_node("fcsv_control", "mission", name="mission_bad", params=params)
    until(lambda: process.returncode is not None, 20.0)
    assert (
        process.returncode == 2 and words in process.tail(2) and "Traceback" not in process.tail(30)
    )

# SPDX-License-Identifier: Apache-2.0
"""The console on a master: what it hears of a vehicle, and that what it asks for arrives and is
answered."""

import signal
import time

import pytest
from support.waiting import within

from fcsv_console.model.console import Console
from fcsv_geometry.vehicles.modes import Mode

pytestmark = pytest.mark.ros
until = within(15.0)


@pytest.fixture
def shell(ros_master, monkeypatch):
    import rospy

    from fcsv_console.ros.shell import ConsoleShell

    # this process is a node already
    monkeypatch.setattr(rospy, "init_node", lambda *_a, **_k: None)
    monkeypatch.setattr(rospy, "signal_shutdown", lambda *_a: None)
    made = ConsoleShell(Console(["c_one", "c_two"], {"c_one": 1, "c_two": 2}), "console")
    until(
        lambda: made._commands is not None and not made.view().actions["land"].why_not,
        what="the master",
    )
    yield made
    made.close()


@pytest.fixture
def publish(ros_master):
    import rospy

    made = []

    def publisher(topic, kind, latch=False):
        made.append(rospy.Publisher(topic, kind, queue_size=5, latch=latch))
        return made[-1]

    yield publisher
    for p in made:
        p.unregister()


def last(shell):
    return shell.view().events[-1]


def test_it_hears_a_vehicle_and_a_message_that_is_nonsense(shell, publish):
    import math

    from geometry_msgs.msg import PoseWithCovarianceStamped

    from mavros_msgs.msg import State

    state = publish("/c_one/mavros/state", State)
    camera = publish("/c_one/camera_pose", PoseWithCovarianceStamped)

    def mode():
        state.publish(State(connected=True, armed=True, mode=Mode.LOITER))
        return shell.view().vehicles[0].flier.words == "pilot, LOITER"

    until(mode, what="the state")
    bad = PoseWithCovarianceStamped()
    bad.pose.pose.position.x = math.nan

    def told():
        camera.publish(bad)
        return any("c_one camera_pose" in p for p in shell.view().problems)

    until(told, what="the pose with NaN")
    assert (
        shell.view().vehicles[0].place.value is None
        and shell.view().vehicles[1].state.value is None
    )


def test_stop_all_is_on_its_topic_at_once_and_nobody_listening_is_told(shell):
    import rospy
    from std_msgs.msg import String

    shell.do("stop_all")
    until(lambda: "NOBODY LISTENS" in last(shell).answer, what="the answer")
    heard = []
    subscriber = rospy.Subscriber(
        "/stop_all", String, lambda m: heard.append((time.monotonic(), m.data))
    )
    until(lambda: shell._commands._all["stop_all"].get_num_connections() > 0, what="a connection")
    shell.do("stop_all")
    until(lambda: heard, what="the topic")
    assert heard[0][1] == "the operator at the console"
    until(lambda: last(shell).answer == "sent; see the report of stop_all", what="the answer")
    subscriber.unregister()


def test_a_service_that_is_not_there_blocks_nobody_and_one_that_is_answers(shell):
    import rospy

    from fcsv_msgs.srv import Control, ControlResponse

    begun_s = time.monotonic()
    shell.do("pause")
    assert time.monotonic() - begun_s < 1.0, "three seconds are what the service is waited for"
    until(lambda: "/mission/control" in last(shell).answer, what="that it is not there")
    service = rospy.Service(
        "/mission/control", Control, lambda r: ControlResponse(True, f"done: {r.operation}")
    )
    shell.do("skip")
    until(lambda: last(shell).answer == "done: skip", what="the answer")
    service.shutdown("over")


def test_record_is_repeated_until_every_vehicle_answers(shell, publish):
    import rospy

    from fcsv_msgs.msg import Command, CommandAck

    acks = {n: publish(f"/{n}/command_ack", CommandAck) for n in ("c_one", "c_two")}
    heard = {n: [] for n in acks}

    def on(message, name):
        heard[name].append(message)
        if len(heard[name]) > 1:  # the first is lost
            acks[name].publish(
                CommandAck(vehicle=name, sender=message.sender, number=message.number)
            )

    subscribers = [rospy.Subscriber(f"/{n}/command", Command, on, n) for n in acks]
    until(
        lambda: all(p.get_num_connections() for p in shell._commands._commands.values()),
        what="connections",
    )
    until(lambda: all(p.get_num_connections() for p in acks.values()), what="connections")
    shell.do("record")
    until(lambda: last(shell).answer == "c_one: done; c_two: done", what="the answer")
    for messages in heard.values():
        assert {(m.number, m.kind, m.flag) for m in messages} == {
            (messages[0].number, Command.RECORD, True)
        }
    for subscriber in subscribers:
        subscriber.unregister()


def test_execute_answers_what_the_mission_says(shell):
    import actionlib

    from fcsv_msgs.msg import ExecuteAction, ExecuteResult

    asked = []

    def on_goal(goal):
        asked.append(list(goal.get_goal().configurations))
        goal.set_rejected(ExecuteResult(), "'execute' is not waited for in COLUMN")

    server = actionlib.ActionServer(
        "/mission/execute", ExecuteAction, on_goal, lambda _goal: None, auto_start=False
    )
    server.start()
    shell.do("execute", configurations=[2, 0])
    until(lambda: last(shell).answer == "'execute' is not waited for in COLUMN", what="the answer")
    assert asked == [[2, 0]]


@pytest.mark.slow
def test_the_window_ends_well_when_told_to_and_may_be_killed_and_opened_again(ros_master):
    import rosnode

    def opened(known, log):
        command = ["env", "QT_QPA_PLATFORM=offscreen", "rosrun", "fcsv_console", "console"]
        process = ros_master.run(command, log)
        until(lambda: ours() - known, 60.0, f"the window: {process.tail()}")
        return process

    def ours():
        return {n for n in rosnode.get_node_names() if n.startswith("/console_")}

    before, processes = ours(), []
    try:
        processes.append(opened(before, "console-1"))
        processes[0].kill()
        processes.append(opened(ours(), "console-2"))
        time.sleep(1.0)
        processes[1].signal(signal.SIGTERM)
        assert processes[1].wait(20.0) == 0, processes[1].tail()
    finally:
        for process in processes:
            process.kill()

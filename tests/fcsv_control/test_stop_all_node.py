# SPDX-License-Identifier: Apache-2.0
"""/stop_all with no mission on the master, agents on board, and a second agent that has nothing to
do there."""

import threading
import time

import pytest
from support.waiting import within

from fcsv_geometry import transforms
from fcsv_geometry.vehicles.modes import Mode

pytestmark = pytest.mark.ros
NAMES = ("s_one", "s_two", "s_three")  # the last one is never heard
until = within(20.0)


class FlightLink:
    """Stands in for a vehicle's flight link: it does what is asked and says so."""

    def __init__(self, name, mode):
        import rospy
        from geometry_msgs.msg import PoseStamped

        from mavros_msgs.msg import State
        from mavros_msgs.srv import SetMode

        self.mode, self.asked, self.slow_s = mode, [], 0.0
        self.state = rospy.Publisher(f"/{name}/mavros/state", State, queue_size=5, latch=True)
        self.pose = rospy.Publisher(
            f"/{name}/mavros/local_position/pose", PoseStamped, queue_size=5
        )
        self.service = rospy.Service(f"/{name}/mavros/set_mode", SetMode, self.on_set_mode)
        self.frame = f"{name}/odom"
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.talk)
        self.thread.start()

    def talk(self):
        from fcsv_geometry.ros import conversions
        from mavros_msgs.msg import State

        while not self.over.wait(0.1):
            self.state.publish(State(connected=True, armed=True, mode=self.mode))
            T = transforms.from_xyz_yaw([1.0, 2.0, 3.0], 0.0)
            self.pose.publish(conversions.pose_stamped(T, time.time(), self.frame))

    def on_set_mode(self, request):
        from mavros_msgs.srv import SetModeResponse

        self.asked.append(request.custom_mode)
        time.sleep(self.slow_s)
        self.mode = request.custom_mode
        return SetModeResponse(True)

    def close(self):
        self.over.set()
        self.thread.join()
        self.service.shutdown()
        self.state.unregister()
        self.pose.unregister()


@pytest.fixture
def fleet(ros_master):
    links = {"s_one": FlightLink("s_one", "GUIDED"), "s_two": FlightLink("s_two", Mode.LOITER)}
    yield links
    for link in links.values():
        link.close()


def test_everybody_who_is_not_flown_by_hand_stops_with_the_mission_dead(fleet, start_node):
    import rospy
    from std_msgs.msg import String
    from std_srvs.srv import Trigger

    from fcsv_msgs.msg import Command, CommandAck, Epoch, Epochs, Heartbeat, StopReport

    reports, told, alive, acks = [], [], {}, []
    heard = [
        rospy.Subscriber("/stop_all/report", StopReport, reports.append),
        rospy.Subscriber("/stop_all", String, lambda m: told.append(m.data)),
        rospy.Subscriber(
            "/s_one/agent/alive", Heartbeat, lambda m: alive.__setitem__(m.instance, m)
        ),
        rospy.Subscriber("/s_one/command_ack", CommandAck, acks.append),
    ]
    for name in fleet:
        start_node("fcsv_control", "agent", ns=name, params={"vehicle": name, "guardian": False})
    start_node("fcsv_control", "stop_all", params={"vehicles": list(NAMES)})
    until(lambda: reports and alive, what="the nodes")
    first = next(iter(alive.values()))
    until(
        lambda: next(iter(alive.values())).sent_s - first.started_s > 1.5,
        what="an agent that has listened",
    )

    params = {"vehicle": "s_one", "guardian": False}
    twin = start_node("fcsv_control", "agent", ns="s_one", name="agent_two", params=params)
    until(
        lambda: any("this second one does nothing" in m.problem for m in alive.values()),
        what="the second agent",
    )
    assert {bool(m.problem) for m in alive.values()} == {True, False}

    stop = rospy.ServiceProxy("/stop_all", Trigger)
    rospy.wait_for_service("/stop_all", 10.0)
    answer = stop()
    assert answer.success and "stop all" in answer.message
    until(lambda: fleet["s_one"].mode == Mode.BRAKE, 5.0, Mode.BRAKE)
    until(lambda: reports[-1].done == ["s_one"], 5.0, "the report")
    assert (reports[-1].by_hand, reports[-1].unheard) == (["s_two"], ["s_three"])
    assert told and fleet["s_two"].asked == [] and fleet["s_one"].asked == [Mode.BRAKE], (
        "once: the twin did nothing"
    )
    until(
        lambda: [a for a in acks if a.sender.startswith("stop_all")],
        5.0,
        "its acknowledgement, once BRAKE shows",
    )

    commands = rospy.Publisher("/s_one/command", Command, queue_size=5)
    until(lambda: commands.get_num_connections() >= 2, what="agents")
    now_s = time.monotonic()
    times = {"ordered_s": now_s - 60.0, "sent_s": now_s, "lifetime_s": 99.0}
    commands.publish(
        Command(
            vehicle="s_one",
            sender="m-1",
            number=1,
            kind=Command.SET_MODE,
            mode=Mode.GUIDED,
            **times,
        )
    )
    until(lambda: [a for a in acks if a.sender == "m-1"], what="an answer")
    assert "was stopped by stop_all" in [a for a in acks if a.sender == "m-1"][0].reason

    epoch = rospy.Publisher("/s_one/odometry/epoch", Epoch, queue_size=1, latch=True)
    epochs = rospy.Publisher("/calibration_epochs", Epochs, queue_size=1, latch=True)
    epoch.publish(Epoch(epoch=8, reason="the tracker was silent for 0.7 s"))
    epochs.publish(Epochs(vehicles=["s_two", "s_one"], epochs=[8, 7]))
    until(
        lambda: epoch.get_num_connections() >= 2 and epochs.get_num_connections() >= 3,
        what="agents",
    )
    time.sleep(0.7)
    times = {"ordered_s": time.monotonic(), "sent_s": time.monotonic(), "lifetime_s": 9.0}
    commands.publish(
        Command(
            vehicle="s_one",
            sender="m-1",
            number=2,
            kind=Command.SET_MODE,
            mode=Mode.GUIDED,
            **times,
        )
    )
    until(lambda: [a for a in acks if a.number == 2 and a.sender == "m-1"], what="an answer")
    assert (
        "began anew after the calibration" in acks[-1].reason and fleet["s_one"].mode == Mode.BRAKE
    )

    land = rospy.Publisher("/land_all", String, queue_size=5)
    until(lambda: land.get_num_connections(), what="the node")
    land.publish(String("the pilot of s_two asked for it"))
    until(lambda: fleet["s_one"].asked[-1] == "LAND", 5.0, "LAND, which no mission cares for")
    assert fleet["s_two"].asked == []
    over = rospy.Publisher("/stop_all/over", String, queue_size=5)
    until(lambda: over.get_num_connections(), what="the node")
    over.publish(String("test"))
    until(lambda: reports[-1].asked == "", 5.0, "the end")
    twin.stop()
    for each in (*heard, commands, land, over, epoch, epochs):
        each.unregister()


def test_without_vehicles_the_node_says_so(start_node):
    process = start_node("fcsv_control", "stop_all", name="stop_nobody", params={"vehicles": []})
    until(lambda: process.returncode is not None, what="its end")
    assert process.returncode == 2 and "vehicles: is empty" in process.tail(5)

# SPDX-License-Identifier: Apache-2.0
"""fleet_check on a real master: reports of two stand-ins become one table; lines are accepted; the
command shows it."""

import time

import pytest
import yaml
from support.waiting import within

pytestmark = pytest.mark.ros
NAMES = ("k_front", "k_back")  # not uav1, uav2: other tests may use those on the same master
LACKING = {("control", n) for n in ("mission", "stop-all", "recorder", "disk", "keys")}
until = within(15.0)


class StandIns:
    """Two vehicles as the control PC hears them; ``battery`` is the second one's state of that
    line."""

    def __init__(self):
        import rospy
        from nav_msgs.msg import Odometry

        from fcsv_geometry.ros import node
        from fcsv_msgs.msg import ClockOffset, FlightCheck, ParameterReport, TagDetections

        kinds = {
            "flight_check": FlightCheck,
            "odometry/state": Odometry,
            "clock/offset": ClockOffset,
            "tags/detections": TagDetections,
            "flight_link/parameters": ParameterReport,
        }
        self.topics = {
            (n, t): rospy.Publisher(f"/{n}/{t}", k, queue_size=5)
            for n in NAMES
            for t, k in kinds.items()
        }
        self.table, self.battery, self.sees, self.quiet = FlightCheck(), 1, [NAMES[0]], ()
        self.speed = 200.0  # cm/s, of the second one
        self.heard = rospy.Subscriber(
            "/flight_check", FlightCheck, lambda m: setattr(self, "table", m)
        )
        self.timer = node.every(0.05, self.talk)

    def talk(self, _event):
        import rospy
        from nav_msgs.msg import Odometry

        from fcsv_control.conditions import Grade
        from fcsv_control.flight_check.lines import Line
        from fcsv_control.ros.checks.flight_check_messages import small
        from fcsv_geometry.missions.flight_limits import FlightBounds
        from fcsv_msgs.msg import ClockOffset, ParameterReport, TagDetection, TagDetections

        for n in set(NAMES) - set(self.quiet):
            battery = self.battery if n == NAMES[1] else Grade.GREEN
            lines = [Line(n, "battery", Grade(battery), "31%"), Line(n, "feed", Grade.GREEN, "")]
            offset = ClockOffset(vehicle=n, offset_s=0.001, uncertainty_s=0.002)
            offset.header.stamp = rospy.Time.now()
            self.topics[n, "flight_check"].publish(small(n, lines, 0.2))
            limits = {
                **FlightBounds().autopilot_parameters,
                **({"WPNAV_SPEED": self.speed} if n == NAMES[1] else {}),
            }
            report = ParameterReport(
                complete=True, limits=list(limits), limit_values=list(limits.values())
            )
            self.topics[n, "flight_link/parameters"].publish(report)
            self.topics[n, "odometry/state"].publish(Odometry())
            self.topics[n, "clock/offset"].publish(offset)
        tags = [TagDetection(id=NAMES.index(n)) for n in self.sees]
        self.topics[NAMES[1], "tags/detections"].publish(
            TagDetections(vehicle=NAMES[1], detections=tags)
        )

    def lines(self):
        from fcsv_control.ros.checks.flight_check_messages import lines_of

        return {(li.vehicle, li.name): li for li in lines_of(self.table)}

    def wrong(self):
        from fcsv_control.conditions import Grade

        return {
            key for key, line in self.lines().items() if line.state is not Grade.GREEN
        } - LACKING

    def close(self):
        self.timer.shutdown()
        self.timer.join()
        for each in (*self.topics.values(), self.heard):
            each.unregister()


@pytest.fixture
def fleet(root, tmp_path, start_node):
    for tag, (name, source) in enumerate(zip(NAMES, ("uav1", "uav2"))):
        document = yaml.safe_load((root / f"config/vehicles/{source}.yaml").read_text())
        (tmp_path / f"{name}.yaml").write_text(
            yaml.safe_dump({**document, "name": name, "tag_id": tag})
        )
    fleet = StandIns()
    mission = str(root / "config/missions/short.yaml")
    start_node(
        "fcsv_control",
        "fleet_check",
        params={"vehicles": list(NAMES), "vehicles_dir": str(tmp_path), "mission": mission},
    )
    yield fleet
    fleet.close()


def command(ros_master, *arguments):
    """(exit status, what it printed)."""
    process = ros_master.run(
        ["rosrun", "fcsv_control", "flight_check", *arguments], f"flight_check-{time.time()}"
    )
    until(lambda: process.returncode is not None, what="the table")
    return process.returncode, process.tail(60)


def test_one_table_for_the_fleet(fleet, ros_master):
    until(
        lambda: fleet.lines() and not fleet.wrong(),
        what="a table that is green but for the control PC's programs",
    )
    assert LACKING <= set(fleet.lines()) and "sees k_front" in fleet.lines()[NAMES[1], "tags"].what

    fleet.speed = 500.0  # ArduCopter's default
    until(
        lambda: fleet.wrong() == {(NAMES[1], "speed")},
        what="an autopilot that flies faster than the mission plans",
    )
    assert "WPNAV_SPEED is 500, planned 200" in fleet.lines()[NAMES[1], "speed"].what

    fleet.battery, fleet.sees, fleet.speed = 2, [], 200.0
    until(
        lambda: fleet.wrong() == {(NAMES[1], "battery"), (NAMES[1], "tags")}, what="two amber lines"
    )
    assert fleet.lines()[NAMES[1], "battery"].remedy.startswith("change it")
    until(
        lambda: "does not see k_front, for 3 s" in fleet.lines()[NAMES[1], "tags"].what,
        what="since when",
    )
    status, said = command(ros_master, "--accept", NAMES[1], "battery")
    # red: the control PC's programs
    assert status == 2 and "(accepted)" in said and "-> start chrony" not in said
    assert (
        fleet.lines()[NAMES[1], "battery"].accepted and not fleet.lines()[NAMES[1], "tags"].accepted
    )
    status, said = command(ros_master, "--accept", "control", "mission")
    assert status == 2 and "only amber lines are accepted" in said

    fleet.battery = 3
    until(
        lambda: not fleet.lines()[NAMES[1], "battery"].passes,
        what="a red line, which nobody can accept",
    )
    fleet.battery = 2
    until(lambda: fleet.lines()[NAMES[1], "battery"].state == 2, what="amber again")
    assert not fleet.lines()[NAMES[1], "battery"].accepted

    fleet.quiet = (NAMES[1],)
    until(
        lambda: (NAMES[1], "battery") not in fleet.lines(),
        what="a vehicle that is not heard any more",
    )
    assert {(NAMES[1], "check"), (NAMES[1], "radio")} <= fleet.wrong()

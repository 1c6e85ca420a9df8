# SPDX-License-Identifier: Apache-2.0
"""The servos of a ground robot's gimbals as topics: joint_states out, command in. One serial bus
for all."""

import time
from dataclasses import dataclass
from typing import Dict, Optional

import rospy
from sensor_msgs.msg import JointState

from fcsv_geometry import frames
from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health
from fcsv_tracking.errors import SampleRejected
from fcsv_tracking.gimbal.config import load_ground_robot
from fcsv_tracking.gimbal.dynamixel import DynamixelBus, DynamixelGimbal
from fcsv_tracking.gimbal.geometry import Angles
from fcsv_tracking.gimbal.servos import GimbalServos, ServoError
from fcsv_tracking.ros import joint_messages

_AGAIN_S = 1.0  # between attempts while a servo does not answer


@dataclass(frozen=True)
class GimbalServosParameters:
    """Parameters of the node; the speeds are the servos' profile, and those of the tracker's follow
    rules."""

    robot_file: str
    port: str = "/dev/ttyUSB0"
    baud: int = 1000000
    rate_hz: float = 100.0
    speed_degps: float = 400.0
    acceleration_degps2: float = 2000.0

    def __post_init__(self):
        if not 10.0 <= self.rate_hz <= 200.0:
            raise ValueError(f"rate_hz: {self.rate_hz} is not in 10..200")
        for name in ("speed_degps", "acceleration_degps2"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: {getattr(self, name)} must be positive")


class ServoLoop:
    """Reads a gimbal, real or simulated, and tells it where to turn. Errors stand in diagnostics
    till it answers."""

    def __init__(self, name: str, servos: GimbalServos, health: Health):
        self._name, self._servos, self._health = name, servos, health
        self._goal: Optional[Angles] = None
        self._silent_until_s = 0.0
        self._joints = rospy.Publisher(
            f"/{name}/gimbal/joint_states", JointState, queue_size=20, tcp_nodelay=True
        )
        rospy.Subscriber(
            f"/{name}/gimbal/command", JointState, self._on_command, queue_size=1, tcp_nodelay=True
        )

    def _on_command(self, message: JointState) -> None:
        try:
            self._goal = joint_messages.from_message(message, frames.gimbal_base(self._name))
        except SampleRejected as error:
            self._health.drop(f"{self._name} command: {error.reason}", str(error))

    def pass_once(self) -> None:
        """One command, where there is one, and one reading."""
        if time.monotonic() < self._silent_until_s:
            return
        goal, self._goal = self._goal, None
        try:
            if goal is not None:
                self._servos.turn(goal)
            reading = self._servos.read()
        except ServoError as error:
            self._health.problem(self._name, str(error))
            self._silent_until_s = time.monotonic() + _AGAIN_S
            return
        self._health.problem(self._name, "")
        self._health.tick(f"{self._name} joints")
        base = frames.gimbal_base(self._name)
        self._joints.publish(joint_messages.to_message(reading.stamp_s, base, reading.angles))

    def report(self) -> None:
        for name, value in self._servos.health().items():
            self._health.value(f"{self._name} {name}", value)


class GimbalServosNode:
    """Real servos."""

    def __init__(self):
        self._parameters = p = node.parameters(GimbalServosParameters)
        gimbals = load_ground_robot(p.robot_file).by_vehicle
        self._health = Health(p.port, {f"{n} joints": 0.5 * p.rate_hz for n in gimbals})
        self._bus = DynamixelBus(p.port, p.baud)
        self._servos: Dict[str, DynamixelGimbal] = {
            n: DynamixelGimbal(
                self._bus, g.servo, rospy.get_time, p.speed_degps, p.acceleration_degps2
            )
            for n, g in gimbals.items()
        }
        self._loops = [ServoLoop(n, servos, self._health) for n, servos in self._servos.items()]

    def spin(self) -> None:
        """Runs until ROS shuts the node down; then without torque."""
        rate, reported_s = rospy.Rate(self._parameters.rate_hz, reset=True), 0.0
        while not rospy.is_shutdown():
            for loop in self._loops:
                loop.pass_once()
            if time.monotonic() - reported_s > 1.0:
                reported_s = time.monotonic()
                for loop in self._loops:
                    loop.report()
            try:
                rate.sleep()
            except rospy.ROSInterruptException:
                break
        for servos in self._servos.values():
            servos.close()
        self._bus.close()


def main() -> int:
    """Run the node."""
    return node.run("gimbal_servos", GimbalServosNode)

# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello beside a ROS master: parameters in, diagnostics out; it is flown by its own
protocol alone.

What goes wrong is told it by topics: for how long (s) its Wi-Fi is cut, and how full (%) its
battery is from now on.
"""

import contextlib
import time

import rospy
from std_msgs.msg import Float64

from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health
from fcsv_sim.tello.program import ProgramParameters, switched_on, words
from fcsv_sim.tello.udp import run


class TelloDroneNode:
    """Switched on as long as the node runs."""

    def __init__(self):
        p = node.parameters(ProgramParameters)
        self._open = contextlib.ExitStack()
        self._shell = self._open.enter_context(switched_on(p))
        self._health = Health(p.vehicle)
        self._timer = node.every(1.0, self._report)
        rospy.loginfo("%s", words(p))
        rospy.Subscriber("~cut_wifi_s", Float64, self._on_cut, queue_size=1)
        rospy.Subscriber("~battery_percent", Float64, self._on_battery, queue_size=1)

    def spin(self) -> None:
        """Runs until ROS shuts the node down."""
        with self._open:
            run(self._shell, rospy.is_shutdown)

    def _on_cut(self, message: Float64) -> None:
        self._shell.drone.radio.cut(time.time(), message.data)

    def _on_battery(self, message: Float64) -> None:
        try:
            self._shell.drone.flight.battery.change(message.data)
        except ValueError as error:
            self._health.drop("battery", str(error))

    def _report(self, _event) -> None:
        drone, client = self._shell.drone, self._shell.drone.link.client
        self._health.value("flown by", f"{client[0]}:{client[1]}" if client else "nobody")
        self._health.value("state", drone.flight.state)
        self._health.value("battery [%]", drone.flight.battery.percent)
        self._health.value("Wi-Fi strength", drone.radio.strength)
        if self._shell.camera is not None:
            self._health.value("pictures sent", self._shell.camera.sent)
            self._health.value("pictures too large", self._shell.camera.too_large)
        for reason, count in drone.link.counts.items():
            self._health.value(f"not understood: {reason}", count)


def main() -> int:
    """Run the node."""
    return node.run("tello_drone", TelloDroneNode)

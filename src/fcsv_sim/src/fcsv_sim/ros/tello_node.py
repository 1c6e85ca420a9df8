# SPDX-License-Identifier: Apache-2.0
"""A simulated Tello under the topics of its driver: tello/takeoff, tello/land, tello/cmd_vel in, tello/state out."""

import time

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import Empty

from fcsv_geometry.ros import conversions, node
from fcsv_sim.vehicles.tello import SimulatedTello, TelloParameters
from mavros_msgs.msg import State

_STATE_HZ = 5.0


class TelloNode:
    """Keeps a simulated Tello at the time of the clock; what comes in is kept until the next pass."""

    def __init__(self):
        p = node.parameters(TelloParameters)
        self._tello = SimulatedTello(p, time.time())
        self._state = rospy.Publisher("tello/state", State, queue_size=2)
        self._timer = node.every(1.0 / _STATE_HZ, self._publish)
        rospy.Subscriber("tello/takeoff", Empty, lambda _: self._tello.take_off(), queue_size=1)
        rospy.Subscriber("tello/land", Empty, lambda _: self._tello.land(), queue_size=1)
        rospy.Subscriber("tello/cmd_vel", Twist, self._on_sticks, queue_size=1, tcp_nodelay=True)

    def _on_sticks(self, message: Twist) -> None:
        v = message.linear
        self._tello.stick(time.time(), (v.x, v.y, v.z), message.angular.z)

    def _publish(self, _event) -> None:
        state = State(header=conversions.header(time.time(), ""), connected=True, guided=True)
        state.armed, state.mode = self._tello.flying, self._tello.mode
        self._state.publish(state)

    def spin(self) -> None:
        """Until ROS shuts the node down."""
        while not rospy.is_shutdown():
            self._tello.advance_to(time.time())
            time.sleep(max(0.001, self._tello.next_pass_s - time.time()))


def main() -> int:
    """Run the node."""
    return node.run("sim_tello", TelloNode)

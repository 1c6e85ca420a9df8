# SPDX-License-Identifier: Apache-2.0
"""Windows on one master tell each other that they are there, so that one of them has the goals in
rviz."""

import time
from typing import Any, Callable

import rospy
from std_msgs.msg import Header

from fcsv_console.model.goals import GoalsElsewhere
from fcsv_console.model.turns import Turns, Window

TOPIC = "/console/goals/window"


class WindowTurns:
    """``mine`` from one thread, as often as one likes; ``put`` is told who has the goals where that
    changes."""

    def __init__(self, put: Callable[[Any], None]):
        opened = rospy.Time.from_sec(time.time())
        self._put, self._before = put, ""
        self._turns = Turns(Window(opened.to_sec(), rospy.get_name()))
        self._word = Header(stamp=opened, frame_id=rospy.get_name())
        self._publisher = rospy.Publisher(TOPIC, Header, queue_size=2)
        self._subscriber = rospy.Subscriber(TOPIC, Header, self._on_window, queue_size=10)

    def mine(self) -> bool:
        """Whether this window has them now; on the way it tells that it is there."""
        now_s = time.monotonic()
        if self._turns.due(now_s):
            self._publisher.publish(self._word)
        before = self._turns.before(now_s)
        name = before.name if before is not None else ""
        if name != self._before:
            self._before = name
            self._put(GoalsElsewhere(name))
        return self._turns.mine(now_s)

    def close(self) -> None:
        """Silent from now on: another window has them soon."""
        self._subscriber.unregister()
        self._publisher.unregister()

    def _on_window(self, message: Header) -> None:
        self._turns.on_window(time.monotonic(), Window(message.stamp.to_sec(), message.frame_id))

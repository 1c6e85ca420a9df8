# SPDX-License-Identifier: Apache-2.0
"""What the relay of this machine measures of what it publishes here, for nodes that count ages."""

import rospy

from fcsv_geometry.streams.arrivals import Arrivals
from fcsv_msgs.msg import RelayAges


def subscribe_ages(arrivals: Arrivals, prefix: str = "") -> rospy.Subscriber:
    """``arrivals`` are told by the relay under ``prefix`` (a vehicle's namespace; empty on the
    control PC)."""
    take = lambda message: arrivals.on_sent(message.topics, message.sent_s)  # noqa: E731
    return rospy.Subscriber(f"{prefix}/relay/ages", RelayAges, take, queue_size=5, tcp_nodelay=True)


def publisher_of(message) -> str:
    """The node that published a message, as rospy gave it to a callback; empty where it is not
    known."""
    return (getattr(message, "_connection_header", None) or {}).get("callerid", "")

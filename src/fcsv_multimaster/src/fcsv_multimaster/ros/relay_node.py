# SPDX-License-Identifier: Apache-2.0
"""The relay of one machine: listed local topics out, listed topics of peers in, as raw messages."""

import threading
import time
import xmlrpc.client
from typing import Dict, Optional

import rosgraph
import roslib.message
import rospy

from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros.health import Health
from fcsv_multimaster.endpoints import parse_endpoint, parse_peers
from fcsv_multimaster.links import Rule, load_links
from fcsv_multimaster.transport import Parcel, Transport


class RelayNode:
    """What a rule does not name neither leaves nor enters; a machine sends only what it is the source of."""

    def __init__(self):
        self._name = rospy.get_param("~machine")
        links = load_links(rospy.get_param("~links"))
        peers = parse_peers(rospy.get_param("~peers", ""))
        listen = parse_endpoint(rospy.get_param("~listen"))
        self._exports: Dict[str, Rule] = {}
        for peer in peers:
            for topic, rule in links.crossing(self._name, peer).items():
                known = self._exports.get(topic)
                fastest = known is None or (rule.most_hz or 1e9) > (known.most_hz or 1e9)
                self._exports[topic] = rule if fastest else known
        self._imports = {peer: links.crossing(peer, self._name) for peer in peers}
        rospy.loginfo("relay of %s on %s, peers %s, sends %s", self._name, listen, peers, sorted(self._exports))
        self._lock = threading.RLock()
        self._last_sent_s: Dict[str, float] = {}
        self._last_events: Dict[str, rospy.AnyMsg] = {}
        self._publishers: Dict[str, Optional[rospy.Publisher]] = {}
        self._classes: Dict[str, type] = {}
        self._subscribers = []
        self._health = Health(self._name)
        self._transport = Transport(self._name, listen, peers, self._on_parcel, self._on_peer)
        rospy.on_shutdown(self._transport.close)
        self._subscribe()

    # ---- out -----------------------------------------------------------------------------------------------

    def _subscribe(self) -> None:
        self._subscribers = [
            rospy.Subscriber(t, rospy.AnyMsg, self._on_local, t, queue_size=20, tcp_nodelay=True) for t in self._exports
        ]

    def _on_local(self, message: rospy.AnyMsg, topic: str) -> None:
        rule = self._exports[topic]
        now_s = time.monotonic()
        if rule.traffic.latched:
            with self._lock:
                self._last_events[topic] = message
        if rule.most_hz is not None:
            if now_s - self._last_sent_s.get(topic, float("-inf")) < 0.9 / rule.most_hz:
                return
            self._last_sent_s[topic] = now_s
        self._send(topic, rule, message)

    def _send(self, topic: str, rule: Rule, message: rospy.AnyMsg) -> None:
        h = message._connection_header
        self._transport.send(topic, rule, h["type"], h["md5sum"], h.get("message_definition", ""), message._buff)
        self._health.tick(f"out {topic}")

    def _on_peer(self, peer: str, alive: bool) -> None:
        """A peer that comes (back) gets the last value of every event."""
        rospy.loginfo("%s: relay of %s is %s", self._name, peer, "there" if alive else "gone")
        self._health.value(f"peer {peer}", "there" if alive else "gone")
        if alive:
            with self._lock:
                events = dict(self._last_events)
            for topic, message in events.items():
                self._send(topic, self._exports[topic], message)

    # ---- in ------------------------------------------------------------------------------------------------

    def _on_parcel(self, parcel: Parcel) -> None:
        rule = self._imports.get(parcel.source, {}).get(parcel.topic)
        if rule is None:
            return  # meant for another machine, or for nobody
        max_age_s = rule.traffic.max_age_s
        if max_age_s is not None and time.time() - parcel.sent_s > max_age_s:
            self._health.drop("late message", parcel.topic)
            return
        with self._lock:
            publisher = self._publisher(parcel, rule)
            if publisher is None:
                return
        message = self._classes[parcel.topic]()
        message._buff = parcel.data
        try:
            publisher.publish(message)
        except rospy.ROSException:
            return  # shutting down
        self._health.tick(f"in {parcel.topic}")

    def _publisher(self, parcel: Parcel, rule: Rule) -> Optional[rospy.Publisher]:
        known = self._classes.get(parcel.topic)
        if known is not None:
            if known._md5sum != parcel.md5 or known._type != parcel.type:
                self._health.drop("message of another type", f"{parcel.topic}: {parcel.type} {parcel.md5}")
                return None
            return self._publishers[parcel.topic]
        installed = roslib.message.get_message_class(parcel.type)
        if installed is not None and installed._md5sum != parcel.md5:
            self._health.drop("another message version", f"{parcel.topic}: {parcel.source} has another {parcel.type}")
            return None
        text = installed._full_text if installed is not None else self._transport.definition(parcel.source, parcel.type)
        if text is None:
            self._health.drop("unknown message type", f"{parcel.topic}: {parcel.type}")
            return None
        self._classes[parcel.topic] = _raw_class(parcel.type, parcel.md5, text)
        self._publishers[parcel.topic] = self._advertise(parcel.topic, rule)
        return self._publishers[parcel.topic]

    def _advertise(self, topic: str, rule: Rule) -> rospy.Publisher:
        cls = self._classes[topic]
        return rospy.Publisher(topic, cls, queue_size=20, latch=rule.traffic.latched, tcp_nodelay=True)

    # ---- the local master ----------------------------------------------------------------------------------

    def spin(self) -> None:
        """Watch the local master: one that was restarted knows nothing of us and is told again."""
        known = _master_pid()
        while not rospy.is_shutdown():
            time.sleep(0.5)
            pid = _master_pid()
            if pid is not None and pid != known:
                if known is not None:
                    rospy.logwarn("%s: the ROS master was restarted; registering again", self._name)
                    self._register_again()
                known = pid

    def _register_again(self) -> None:
        with self._lock:
            for subscriber in self._subscribers:
                subscriber.unregister()
            self._subscribe()
            for source, rules in self._imports.items():
                for topic, rule in rules.items():
                    if self._publishers.get(topic) is not None:
                        self._publishers[topic].unregister()
                        self._publishers[topic] = self._advertise(topic, rule)
                        rospy.loginfo("%s of %s again", topic, source)


def _raw_class(type_name: str, md5: str, text: str) -> type:
    """A message class that passes bytes through."""
    return type("Raw", (rospy.AnyMsg,), {"_type": type_name, "_md5sum": md5, "_full_text": text, "_has_header": False})


def _master_pid() -> Optional[int]:
    try:
        return xmlrpc.client.ServerProxy(rosgraph.get_master_uri()).getPid(rospy.get_name())[2]
    except OSError:
        return None


def main() -> int:
    """Run the node."""
    rospy.init_node("relay")
    try:
        node = RelayNode()
    except FcsvError as error:
        rospy.logfatal("relay: %s", error)
        return 2
    node.spin()
    return 0

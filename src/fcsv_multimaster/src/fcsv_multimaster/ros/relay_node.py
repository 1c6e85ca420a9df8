# SPDX-License-Identifier: Apache-2.0
"""The relay of one machine: listed local topics out, listed topics of peers in, as raw messages."""

import datetime
import os
import sys
import time
from dataclasses import dataclass
from typing import Dict, List

import rospy
from diagnostic_msgs.msg import DiagnosticArray

from fcsv_geometry.ros import conversions, node
from fcsv_geometry.ros.health import Health
from fcsv_msgs.msg import RelayAges
from fcsv_multimaster.errors import EndpointError, RelayError
from fcsv_multimaster.keys.keyring import open_keyring
from fcsv_multimaster.links import TF_TOPICS, load_links
from fcsv_multimaster.network.addresses import AddressWatch
from fcsv_multimaster.network.endpoints import parse_endpoint, parse_peers
from fcsv_multimaster.network.joining import Joining
from fcsv_multimaster.relay.exchange import Exchange
from fcsv_multimaster.relay.parcel import Parcel
from fcsv_multimaster.ros import key_watch, link_report
from fcsv_multimaster.ros.inbox import Inbox
from fcsv_multimaster.ros.master_watch import master_knows_us, register_again
from fcsv_multimaster.ros.pictures import PicturePacker
from fcsv_multimaster.ros.tf_merge import TfOut

# what is urgent must not wait five milliseconds for a thread that handles pictures
_SWITCH_S = 0.0005
_TF_HZ = 10.0
_AGES_HZ = 20.0
# A process that slept for longer (SIGSTOP) has sessions that its peers closed. Zenoh's numbers for
# topics are a session's own; those of an old one were seen to be taken for another machine's.
_SLEPT_S = 3.0
_EXPOSURE_TICKS = 8  # of half a second


@dataclass(frozen=True)
class RelayParameters:
    """Parameters of the node. ``peers``: NAME=HOST:PORT,..., with ``discovery`` also bare names;
    ``keys``: this machine's folder of the fleet's keys."""

    machine: str
    links: str
    listen: str
    peers: str = ""
    keys: str = ""
    discovery: bool = False


class RelayNode:
    """What a rule does not name neither leaves nor enters; what this node published itself does not
    go back."""

    def __init__(self):
        parameters = node.parameters(RelayParameters)
        sys.setswitchinterval(_SWITCH_S)
        self._name = parameters.machine
        links, peers = (
            load_links(parameters.links),
            parse_peers(parameters.peers, parameters.discovery),
        )
        self._discovery = parameters.discovery
        keys = self._keys = open_keyring(parameters.keys, self._name) if parameters.keys else None
        if keys is not None:
            key_watch.refuse_while_exposed()
            if keys.warning(datetime.datetime.utcnow()):
                rospy.logwarn("%s: %s", self._name, keys.warning(datetime.datetime.utcnow()))
        self._health = Health(self._name)
        self._drop = self._health.drop
        self._packer = PicturePacker()
        self._inbox = Inbox(self._drop, self._definition)
        self._reports = rospy.Publisher("~links", DiagnosticArray, queue_size=1)
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=2)
        self._exchange = Exchange(
            self._name,
            links,
            parse_endpoint(parameters.listen),
            peers,
            keys,
            self._on_parcel,
            self._drop,
            self._health.problem,
            self._packer.pack,
            parameters.discovery,
        )
        rospy.on_shutdown(self._exchange.close)
        self._tf: Dict[str, Dict[str, TfOut]] = {
            topic: {
                p.name: TfOut(self._name, p.exports[topic].frames, topic == "/tf_static")
                for p in self._exchange.peers.values()
                if topic in p.exports
            }
            for topic in TF_TOPICS
        }
        self._tf_header: Dict[str, Dict[str, str]] = {}
        rospy.loginfo(
            "%s to %s sends %s", self._name, sorted(peers) or "nobody", self._exchange.exports
        )
        self._subscribers = self._subscribe()
        self._ages = rospy.Publisher("~ages", RelayAges, queue_size=5, tcp_nodelay=True)
        self._ages_timer = node.every(1.0 / _AGES_HZ, lambda _event: self._publish_ages())

    def _subscribe(self) -> List[rospy.Subscriber]:
        subscribers = []
        for topic in self._exchange.exports:
            on = self._on_tf if topic in TF_TOPICS else self._on_local
            rules = [p.exports[topic] for p in self._exchange.peers.values() if topic in p.exports]
            longest = max(rule.traffic.queue_size for rule in rules)
            options = {"queue_size": longest, "buff_size": 1 << 22, "tcp_nodelay": True}
            subscribers.append(rospy.Subscriber(topic, rospy.AnyMsg, on, topic, **options))
        if self._tf["/tf"]:
            self._tf_timer = node.every(1.0 / _TF_HZ, lambda _event: self._send_tf("/tf"))
        return subscribers

    def _definition(self, source: str, type_name: str):
        return self._exchange.definition(source, type_name)

    # ---- out -------------------------------------------------------------------------------------

    def _on_local(self, message: rospy.AnyMsg, topic: str) -> None:
        h = message._connection_header
        if h.get("callerid") == rospy.get_name():
            return  # it came from a peer
        taken = self._exchange.send(
            topic, h["type"], h["md5sum"], h.get("message_definition", ""), message._buff
        )
        if taken:
            self._health.tick(f"out {topic}")

    def _on_tf(self, message: rospy.AnyMsg, topic: str) -> None:
        h = message._connection_header
        if h.get("callerid") == rospy.get_name():
            return
        self._tf_header[topic] = h
        try:
            changed = [out.add(message._buff) for out in self._tf[topic].values()]
        except RelayError as error:
            self._drop("tf", str(error))
            return
        if topic == "/tf_static" and any(changed):
            self._send_tf(topic)

    def _send_tf(self, topic: str) -> None:
        h = self._tf_header.get(topic)
        for peer, out in self._tf[topic].items():
            data = out.drain() if h is not None else None
            if data is not None:
                self._exchange.send(
                    topic, h["type"], h["md5sum"], h.get("message_definition", ""), data, only=peer
                )
                self._health.tick(f"out {topic}")

    # ---- in --------------------------------------------------------------------------------------

    def _on_parcel(self, parcel: Parcel) -> bool:
        self._health.tick(f"in {parcel.topic}")
        return self._inbox.deliver(parcel)

    def _publish_ages(self) -> None:
        sent = self._inbox.sent.drain()
        if sent:
            self._ages.publish(
                RelayAges(conversions.header(rospy.get_time(), ""), list(sent), list(sent.values()))
            )

    # ---- what goes on by itself ------------------------------------------------------------------

    def spin(self) -> None:
        """Report the links, and watch the local master."""
        known, ticks, addresses, joining = True, 0, AddressWatch(), Joining()
        while not rospy.is_shutdown():
            before_s = time.monotonic()
            time.sleep(0.5)
            slept = time.monotonic() > before_s + _SLEPT_S
            knows_us = master_knows_us()
            if knows_us is None and known:
                rospy.logwarn(
                    "%s: the ROS master does not answer; what is connected goes on", self._name
                )
            if knows_us is False:
                rospy.logwarn("%s: the ROS master was restarted; registering again", self._name)
                register_again()
            known = knows_us is not None
            moved = self._discovery and addresses.changed()
            if moved:
                rospy.logwarn(
                    "%s: its addresses are others now; looking for its peers from there", self._name
                )
            if slept:
                rospy.logwarn("%s: it slept; joining its peers anew", self._name)
            if joining.due(slept, moved):
                joining.ended(self._join_anew())
            if joining.hopeless:
                rospy.logfatal(
                    "%s: after it slept its port does not get free; to be started again", self._name
                )
                # an orderly end would wait for the session that does not close; roslaunch respawns
                # it
                os._exit(1)
            ticks += 1
            if ticks % 2 == 0:
                self._report()
            if self._keys is not None and ticks % _EXPOSURE_TICKS == 0:
                # in flight the link is worth more than what a node that was started later opens:
                # said, not cut
                found = key_watch.exposures()
                self._health.value("exposed", bool(found))
                self._health.problem(
                    "exposed", f"ROS is open to the network: {'; '.join(found)}" if found else ""
                )

    def _join_anew(self) -> bool:
        """Whether it could; else it is to be tried again."""
        try:
            self._exchange.reopen()
        except EndpointError as error:
            self._health.problem("addresses", str(error))
            return False
        self._health.problem("addresses", "")
        return True

    def _report(self) -> None:
        now_s, statuses = time.monotonic(), []
        for peer in self._exchange.peers.values():
            report = peer.report(now_s)
            steps = {
                n: s for n, s in self._packer.steps().items() if n.endswith(f" to {peer.name}")
            }
            statuses.append(
                link_report.status_of(self._name, peer.name, report, self._keys is not None, steps)
            )
            self._health.value(f"peer {peer.name}", statuses[-1].message)
        message = link_report.array(rospy.Time.now(), statuses)
        self._reports.publish(message)
        if self._keys is not None:
            statuses.append(key_watch.status_of(self._name, self._keys, datetime.datetime.utcnow()))
        self._diagnostics.publish(link_report.array(message.header.stamp, statuses))


def main() -> int:
    """Run the node."""
    return node.run("relay", RelayNode)

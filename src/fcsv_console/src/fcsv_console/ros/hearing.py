# SPDX-License-Identifier: Apache-2.0
"""Subscribes to what the console shows. Facts wait in a queue until who shows them takes them: no
lock, no waiting."""

import threading
import time
from collections import deque
from typing import Any, Callable, Deque, Iterable, Iterator, List, Optional, Sequence, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray

from fcsv_console.model import facts as f
from fcsv_console.model.bags import Bags
from fcsv_console.ros import messages
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.ros.relay_ages import publisher_of, subscribe_ages
from fcsv_geometry.streams.arrivals import Arrivals
from fcsv_multimaster.ros.master_watch import master_knows_us, register_again

_MOST = 20000  # facts that wait: a window that hangs for a minute
_LOOK_S = 1.0
_UNUSABLE = (FcsvError, ValueError, TypeError, AttributeError, IndexError, ArithmeticError)
NO_MASTER = "the ROS master does not answer"


class Hearing:
    """``subscribe`` once rospy knows its master; ``drain`` from any thread, again and again.

    ``recorded``: a bag is played. Its pictures are those of the camera; in flight only compressed
    ones cross the radio. ``arrivals`` are told what the relay measures.
    """

    def __init__(
        self, vehicles: Sequence[str], recorded: bool = False, arrivals: Optional[Arrivals] = None
    ):
        self._arrivals = arrivals or Arrivals()
        self._vehicles = list(vehicles)
        self._of_vehicle = dict(messages.OF_VEHICLE, **(messages.RECORDED if recorded else {}))
        self._bags = Bags() if recorded else None
        self._waiting: Deque[Tuple[float, Any]] = deque(maxlen=_MOST)
        self._subscribers: List[rospy.Subscriber] = []
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._watch_master, name="master watch", daemon=True)

    def subscribe(self) -> None:
        """Subscribes to every topic, of every vehicle."""
        for name in self._vehicles:
            for topic, (kind, convert) in self._of_vehicle.items():
                self._subscribe(f"/{name}/{topic}", kind, name, topic, convert)
        for topic, (kind, convert) in messages.OF_CONTROL.items():
            self._subscribe(topic, kind, "", topic, convert)
        self._subscribers.append(subscribe_ages(self._arrivals))
        self._subscribers.append(
            rospy.Subscriber("/relay/links", DiagnosticArray, self._on_links, queue_size=2)
        )
        self._watch.start()

    def drain(self) -> Iterator[Tuple[float, Any]]:
        """(monotonic time at which it came, fact), the oldest first."""
        while self._waiting:
            yield self._waiting.popleft()

    def put(self, fact: Any) -> None:
        """A fact from elsewhere."""
        self._waiting.append((time.monotonic(), fact))

    def close(self) -> None:
        """End the watch and the subscriptions."""
        self._over.set()
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _subscribe(
        self, topic: str, kind: Any, name: str, short: str, convert: messages.Convert
    ) -> None:
        def on_message(message: Any) -> None:
            self._arrivals.came(topic, publisher_of(message))
            self._keep(lambda: [convert(name, message)], name, short)

        self._subscribers.append(
            rospy.Subscriber(topic, kind, on_message, queue_size=20, tcp_nodelay=True)
        )
        if name and self._bags is not None:
            self._bags.follow(name, short, self._subscribers[-1].get_num_connections)

    def _on_links(self, message: DiagnosticArray) -> None:
        self._keep(lambda: messages.radios(message), "", "/relay/links")

    def _keep(self, convert: Callable[[], Iterable[f.Fact]], name: str, topic: str) -> None:
        try:
            for fact in convert():
                self.put(fact)
        except _UNUSABLE as error:
            self.put(f.Unusable(name, topic, str(error) or type(error).__name__))

    def _watch_master(self) -> None:
        """A master that comes back is told of everything again; connections outlive it."""
        while not self._over.wait(_LOOK_S) and not rospy.is_shutdown():
            known = master_knows_us()
            if known is False:
                register_again()
            self.put(f.MasterReport(NO_MASTER if known is None else ""))
            self._look_at_bags()

    def _look_at_bags(self) -> None:
        for fact in self._bags.facts() if self._bags is not None else ():
            self.put(fact)

# SPDX-License-Identifier: Apache-2.0
"""Clocks: vehicles answer, the control PC asks once a second, publishes each offset, and says when
one is too large."""

from dataclasses import dataclass, field
from typing import Dict, List

import rospy

from fcsv_geometry.config import ConfigError
from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health
from fcsv_geometry.vehicles.thresholds import CLOCK_S
from fcsv_msgs.msg import ClockEcho
from fcsv_msgs.msg import ClockOffset as ClockOffsetMessage
from fcsv_tracking.devices.clocks import ClockExchange, ClockOffset, in_words

_SILENT_S = 10.0


@dataclass(frozen=True)
class ClockParameters:
    """Parameters of the node: ``role`` is "control" (asks ``vehicles``) or "vehicle" (answers as
    ``name``)."""

    role: str
    name: str = "control"
    vehicles: List[str] = field(default_factory=list)
    period_s: float = 1.0
    most_offset_s: float = CLOCK_S.fleet.amber  # a problem: 2 cm of calibration at 1 m/s of sway

    def __post_init__(self):
        if self.role not in ("control", "vehicle"):
            raise ValueError(f"role: '{self.role}' is neither control nor vehicle")
        for name in ("period_s", "most_offset_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: {getattr(self, name)} must be positive")


class ClockVehicle:
    """Answers at once."""

    def __init__(self, parameters: ClockParameters):
        self._name = parameters.name
        self._health = Health(self._name)
        self._pong = rospy.Publisher(
            f"/{self._name}/clock/pong", ClockEcho, queue_size=5, tcp_nodelay=True
        )
        rospy.Subscriber(
            f"/{self._name}/clock/ping", ClockEcho, self._on_ping, queue_size=1, tcp_nodelay=True
        )

    def _on_ping(self, message: ClockEcho) -> None:
        received = rospy.Time.now()
        if message.vehicle != self._name:
            self._health.drop("ping", f"asks '{message.vehicle}'")
            return
        message.received, message.answered = received, rospy.Time.now()
        self._pong.publish(message)


class ClockControl:
    """Asks, and publishes /uavN/clock/offset."""

    def __init__(self, parameters: ClockParameters):
        if not parameters.vehicles:
            raise ConfigError(
                f"{rospy.get_name()}: 'vehicles' is empty; name the vehicles whose clocks to watch"
            )
        self._parameters = parameters
        self._exchanges: Dict[str, ClockExchange] = {
            n: ClockExchange() for n in parameters.vehicles
        }
        self._health = Health("control")
        self._offsets = {
            n: rospy.Publisher(f"/{n}/clock/offset", ClockOffsetMessage, queue_size=1, latch=True)
            for n in parameters.vehicles
        }
        self._pings = {
            n: rospy.Publisher(f"/{n}/clock/ping", ClockEcho, queue_size=1, tcp_nodelay=True)
            for n in parameters.vehicles
        }
        for name in parameters.vehicles:
            rospy.Subscriber(
                f"/{name}/clock/pong",
                ClockEcho,
                self._on_pong,
                name,
                queue_size=5,
                tcp_nodelay=True,
            )
        self._timer = node.every(parameters.period_s, self._ask)

    def _ask(self, _event) -> None:
        for name, publisher in self._pings.items():
            publisher.publish(ClockEcho(vehicle=name, sent=rospy.Time.now()))
            offset = self._exchanges[name].offset()
            silent = offset is None or rospy.get_time() - offset.stamp_s > _SILENT_S
            self._health.problem(
                f"{name} silent", f"{name} does not answer about its clock" if silent else ""
            )

    def _on_pong(self, message: ClockEcho, name: str) -> None:
        returned_s = rospy.get_time()
        stamps_s = [t.to_sec() for t in (message.sent, message.received, message.answered)]
        if message.vehicle != name or not self._exchanges[name].add(*stamps_s, returned_s):
            self._health.drop(f"answer of {name}")
            return
        offset = self._exchanges[name].offset()
        self._offsets[name].publish(to_message(name, offset))
        self._health.value(
            f"{name} ahead [ms]", f"{offset.offset_s * 1e3:.1f} ± {offset.uncertainty_s * 1e3:.1f}"
        )
        too_far = offset.beyond(self._parameters.most_offset_s)
        self._health.problem(f"{name} offset", in_words(name, offset) if too_far else "")


def to_message(vehicle: str, offset: ClockOffset) -> ClockOffsetMessage:
    message = ClockOffsetMessage(
        vehicle=vehicle, offset_s=offset.offset_s, uncertainty_s=offset.uncertainty_s
    )
    message.header.stamp = rospy.Time.from_sec(offset.stamp_s)
    return message


def from_message(message: ClockOffsetMessage) -> ClockOffset:
    return ClockOffset(message.header.stamp.to_sec(), message.offset_s, message.uncertainty_s)


def _make():
    parameters = node.parameters(ClockParameters)
    return ClockControl(parameters) if parameters.role == "control" else ClockVehicle(parameters)


def main() -> int:
    """Run the node."""
    return node.run("clock", _make)

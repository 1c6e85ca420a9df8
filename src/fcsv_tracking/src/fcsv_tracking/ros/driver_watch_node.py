# SPDX-License-Identifier: Apache-2.0
"""Watches the drivers of camera and tracking camera, restarts what is silent, and tells."""

import threading
import time
from dataclasses import dataclass, field
from typing import Dict

import psutil
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_srvs.srv import Empty

from fcsv_geometry.errors import ConfigError
from fcsv_geometry.ros import node
from fcsv_geometry.ros.processes import ask_to_end, processes_of
from fcsv_tracking.devices.driver_watch import DeviceRules, DriverWatch, Level, Remedy
from fcsv_tracking.devices.usb_bus import findings, read_devices

_LEVELS = {
    Level.OK: DiagnosticStatus.OK,
    Level.WARN: DiagnosticStatus.WARN,
    Level.ERROR: DiagnosticStatus.ERROR,
}
_STEP_S = 0.1
_TELL_S = 1.0
_CALL_S = 3.0  # a driver that hangs may not answer


@dataclass(frozen=True)
class DriverWatchParameters:
    """Parameters of the node. ``devices``: by the launch files of the devices; ``usb``: where Linux
    lists USB."""

    vehicle: str
    devices: Dict[str, DeviceRules] = field(default_factory=dict)
    usb: str = "/sys/bus/usb/devices"


class DriverWatchNode:
    """A remedy runs in a thread of its own: a driver that hangs answers late, and the other is
    watched on."""

    def __init__(self):
        self._parameters = node.parameters(DriverWatchParameters)
        if not self._parameters.devices:
            raise ConfigError(
                f"{rospy.get_name()}: 'devices' is empty; a device's launch file fills it"
            )
        now_s = time.monotonic()
        self._watches = {
            name: DriverWatch(name, rules, now_s)
            for name, rules in self._parameters.devices.items()
        }
        self._lock = threading.Lock()
        self._said: Dict[str, str] = {}
        self._told_s = 0.0
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=2)
        self._subscribers = [
            rospy.Subscriber(w.rules.topic, rospy.AnyMsg, self._on_message, w, queue_size=100)
            for w in self._watches.values()
        ]

    def _on_message(self, _message: rospy.AnyMsg, watch: DriverWatch) -> None:
        with self._lock:
            watch.on_message(time.monotonic())

    def spin(self) -> None:
        """Runs by the monotonic clock, whatever is done to the time of day."""
        while not rospy.is_shutdown():
            now_s = time.monotonic()
            for watch in self._watches.values():
                with self._lock:
                    remedy = watch.step(now_s)
                if remedy is not None:
                    threading.Thread(target=self._apply, args=(watch, remedy), daemon=True).start()
            if now_s - self._told_s >= _TELL_S:
                self._told_s = now_s
                self._publish_diagnostics(now_s)
            time.sleep(_STEP_S)

    def _publish_diagnostics(self, now_s: float) -> None:
        usb = findings(
            read_devices(self._parameters.usb), {n: w.rules.usb for n, w in self._watches.items()}
        )
        message = DiagnosticArray()
        message.header.stamp = rospy.Time.now()
        for name, watch in self._watches.items():
            with self._lock:
                level, text = watch.status(now_s)
            if name in usb:
                level, text = (
                    (Level.WARN if level is Level.OK else level),
                    f"{text}; it {usb[name]}",
                )
                self._warn_once(f"usb {name}", f"{name} {usb[name]}")
            message.status.append(
                DiagnosticStatus(
                    level=_LEVELS[level],
                    name=f"driver {name}",
                    message=text,
                    hardware_id=self._parameters.vehicle,
                )
            )
        self._diagnostics.publish(message)

    def _warn_once(self, key: str, text: str) -> None:
        if self._said.get(key) != text:
            self._said[key] = text
            rospy.logwarn("%s: %s", self._parameters.vehicle, text)

    def _apply(self, watch: DriverWatch, remedy: Remedy) -> None:
        rospy.logerr("%s: %s is silent: %s", self._parameters.vehicle, watch.name, remedy.value)
        if remedy is Remedy.RESET:
            self._reset(watch.rules.reset)
            return
        for name in watch.rules.nodes:
            self._end(rospy.resolve_name(name), remedy)

    def _reset(self, service: str) -> None:
        try:
            rospy.wait_for_service(service, _CALL_S)
            rospy.ServiceProxy(service, Empty)()
        except (rospy.ROSException, rospy.ServiceException) as error:
            rospy.logwarn("%s: %s", service, error)

    def _end(self, name: str, remedy: Remedy) -> None:
        """Ask a node to end, or kill it; its launch file starts it again."""
        try:
            if remedy is Remedy.KILL:
                for process in processes_of(name):
                    process.kill()
            else:
                ask_to_end(rospy.get_name(), name, "it is silent", _CALL_S)
        except (OSError, psutil.Error) as error:
            rospy.logwarn("%s: could not be ended: %s", name, error)


def main() -> int:
    """Run the node."""
    return node.run("driver_watch", DriverWatchNode)

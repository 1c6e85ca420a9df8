# SPDX-License-Identifier: Apache-2.0
"""Processes on board that die, or are stopped for a while: what stands in their place until they run again."""

from typing import List

from fcsv_control.errors import LinkError
from fcsv_control.flight.core import LinkCore
from fcsv_control.flight.watchdog import Alarm, FeedWatchdog, WatchdogParameters
from fcsv_sim.rehearsal.board import new_link
from fcsv_sim.rehearsal.vehicle import RehearsedVehicle

_MOST_UNREAD = 2000  # what a socket keeps of a line that nobody reads


class _NoWatchdog:
    """Of a process that does not run."""

    def feed(self, _now_s: float) -> None:
        """Not heard."""

    def check(self, _now_s: float, _armed: bool, _mode: str, _ours: bool) -> Alarm:
        """Nobody looks."""
        return Alarm.NONE


class DeadLink:
    """A flight link that was killed. What others know of the autopilot is what it said last."""

    mode_is_ours = False

    def __init__(self, link: LinkCore):
        self.state, self.heard = link.state, link.heard

    def connected(self, _now_s: float) -> bool:
        """Nobody says so any more."""
        return False

    def take(self, _now_s: float, _message) -> None:
        """Nobody reads the line."""

    def step(self, _now_s: float) -> None:
        """Nothing is done."""

    def outgoing(self) -> List[object]:
        """Nothing is sent."""
        return []

    events = outgoing

    def send_pose(self, _stamp_s: float, _T_odom_body) -> None:
        """Lost."""

    def send_set_point(self, _T_odom_body) -> None:
        """Lost."""

    def note_reset(self) -> None:
        """Lost."""

    def set_mode(self, _now_s: float, _name: str):
        """Raises LinkError: a call of a service that is gone."""
        raise LinkError("the flight link does not run")

    arm = take_off = set_mode


class SleepingLink(DeadLink):
    """A flight link that was stopped (SIGSTOP): what comes waits, and so does who calls it; ``wake`` goes on."""

    def __init__(self, link: LinkCore, vehicle: RehearsedVehicle, now_s: float):
        super().__init__(link)
        self._link, self._vehicle, self._asleep_s = link, vehicle, now_s
        self._kept = vehicle.watchdog
        self._unread: List[object] = []

    def take(self, _now_s: float, message) -> None:
        """The line's buffer keeps it."""
        if len(self._unread) < _MOST_UNREAD:
            self._unread.append(message)

    def set_mode(self, now_s: float, name: str):
        """The call is answered when it wakes."""
        return self._link.set_mode(now_s, name)

    def arm(self, now_s: float, value: bool):
        """Likewise."""
        return self._link.arm(now_s, value)

    def take_off(self, now_s: float, altitude_m: float):
        """Likewise."""
        return self._link.take_off(now_s, altitude_m)

    def wake(self, now_s: float) -> None:
        """It reads what came meanwhile, and its watchdog knows that it slept."""
        for message in self._unread:
            self._link.take(now_s, message)
        self._kept.slept(now_s, now_s - self._asleep_s)
        self._vehicle.swap_link(self._link, self._kept)


def kill_agent(vehicle: RehearsedVehicle) -> None:
    """For good."""
    vehicle.agent_runs = False


def kill_link(vehicle: RehearsedVehicle) -> None:
    """Until ``start_link``."""
    vehicle.link_runs = False
    vehicle.swap_link(DeadLink(vehicle.link), _NoWatchdog(), died=True)


def start_link(vehicle: RehearsedVehicle, now_s: float) -> None:
    """A new process, which knows nothing of what was before."""
    vehicle.link_runs = True
    vehicle.swap_link(new_link(vehicle.geometry), FeedWatchdog(WatchdogParameters(), now_s), knows=False)


def stop_link(vehicle: RehearsedVehicle, now_s: float) -> SleepingLink:
    """SIGSTOP; SIGCONT is ``continue_link``."""
    asleep = SleepingLink(vehicle.link, vehicle, now_s)
    vehicle.link_runs = False
    vehicle.swap_link(asleep, _NoWatchdog())
    return asleep


def continue_link(vehicle: RehearsedVehicle, asleep: SleepingLink, now_s: float) -> None:
    """SIGCONT."""
    vehicle.link_runs = True
    asleep.wake(now_s)

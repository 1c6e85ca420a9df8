# SPDX-License-Identifier: Apache-2.0
"""MAVROS's process on this machine: asked for its id as `rosnode ping` asks, and ended where it
hangs."""

import socket
import time
from typing import Callable, Optional

import psutil

from fcsv_control.flight.mavros_watch import MavrosWatch
from fcsv_geometry.ros.processes import address_of, ask_pid, is_node

_ANSWER_S = 0.5  # of the master, and of MAVROS
_CALLER = "/flight_link"


class MavrosProcess:
    """Knows the process of the node ``name`` (resolved); ``look_up`` gives its address, or raises
    OSError where it is not known."""

    def __init__(self, name: str, look_up: Optional[Callable[[], str]] = None):
        self._name = name
        self._look_up = look_up or (lambda: address_of(_CALLER, name, _ANSWER_S))

    def pid(self) -> Optional[int]:
        """Finds the process of the node, where master and node answer within 0.5 s each and it is
        on this machine."""
        try:
            uri = self._look_up()
        except OSError:
            return None
        return ask_pid(_CALLER, uri, _ANSWER_S) if is_here(uri) else None

    def lives(self, pid: int) -> bool:
        """Whether the process is there, and is the node still: numbers are given again."""
        return self._process(pid) is not None

    def end(self, pid: int) -> str:
        """Why it could not be ended; empty where it was, or is gone."""
        process = self._process(pid)
        try:
            if process is not None:
                process.kill()
        except psutil.NoSuchProcess:
            return ""
        except psutil.Error as error:
            return str(error)
        return ""

    def _process(self, pid: int) -> Optional[psutil.Process]:
        try:
            process = psutil.Process(pid)
        except psutil.Error:
            return None
        return process if is_node(process, self._name) else None


def mind(
    watch: MavrosWatch,
    process: MavrosProcess,
    heard_s: Callable[[], float],
    clock: Callable[[], float] = time.monotonic,
) -> str:
    """One turn, to be taken every half second: ask, decide, end. What there is to say, else empty.

    ``heard_s``: when something of the autopilot came through MAVROS last.
    """
    watch.on_message(heard_s())
    if watch.asks(clock()):
        answer, before = process.pid(), watch.pid
        if answer is None and before is not None and not process.lives(before):
            watch.gone()
        else:
            watch.answered(answer)
    watch.on_message(heard_s())
    pid = watch.step(clock())
    if pid is None:
        return ""
    why = process.end(pid)
    return "MAVROS hung and " + (
        f"cannot be ended ({why}): take over" if why else "was ended, it starts again"
    )


def is_here(uri: str) -> bool:
    """Whether an address is of this machine: process ids mean nothing elsewhere."""
    host = uri.split("//")[-1].split(":")[0].strip("/")
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            probe.bind((socket.gethostbyname(host), 0))
    except OSError:
        return False
    return True

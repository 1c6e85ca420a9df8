# SPDX-License-Identifier: Apache-2.0
"""MAVROS's process on this machine: asked for its id as `rosnode ping` asks, and ended where it hangs."""

import http.client
import os
import signal
import socket
import time
import xmlrpc.client
from typing import Callable, Optional
from xml.parsers.expat import ExpatError

from fcsv_control.flight.mavros_watch import MavrosWatch
from fcsv_geometry.ros.calls import server_at

_ANSWER_S = 0.5
_CALLER = "/flight_link"


def ask_pid(uri: str) -> Optional[int]:
    """Process id of the node whose slave API (ROS 1) is at ``uri``; None where no sound answer comes within 0.5 s."""
    try:
        with server_at(uri, _ANSWER_S) as node:
            code, _, pid = node.getPid(_CALLER)
    except (OSError, http.client.HTTPException, xmlrpc.client.Error, ExpatError, ValueError, TypeError):
        return None
    return pid if code == 1 and isinstance(pid, int) and pid > 1 else None


class MavrosProcess:
    """``look_up`` gives the node's address, or raises OSError where it is not known; ``mark``: a piece of its command
    line, so that no other process is ended that got its number."""

    def __init__(self, look_up: Callable[[], str], mark: bytes = b"__name:=mavros"):
        self._look_up, self._mark = look_up, mark

    def pid(self) -> Optional[int]:
        """Of the node, where it answers within 0.5 s and is on this machine."""
        try:
            uri = self._look_up()
        except OSError:
            return None
        return ask_pid(uri) if is_here(uri) else None

    def lives(self, pid: int) -> bool:
        """Whether the process is there, and is the node still: numbers are given again."""
        try:
            with open(f"/proc/{pid}/cmdline", "rb") as file:
                return self._mark in file.read().split(b"\0")
        except OSError:
            return False

    def end(self, pid: int) -> str:
        """Why it could not be ended; empty where it was, or is gone."""
        try:
            if self.lives(pid):
                os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            return ""
        except OSError as error:
            return error.strerror or str(error)
        return ""


def mind(
    watch: MavrosWatch, process: MavrosProcess, heard_s: Callable[[], float],
    clock: Callable[[], float] = time.monotonic,
) -> str:  # fmt: skip
    """One turn, to be taken every half second: ask, decide, end. What there is to say, else empty.

    ``heard_s``: when something of the autopilot came through MAVROS last.
    """
    watch.heard(heard_s())
    if watch.asks(clock()):
        answer, before = process.pid(), watch.pid
        if answer is None and before is not None and not process.lives(before):
            watch.gone()
        else:
            watch.answered(answer)
    watch.heard(heard_s())
    pid = watch.step(clock())
    if pid is None:
        return ""
    why = process.end(pid)
    return "MAVROS hung and " + (f"cannot be ended ({why}): take over" if why else "was ended, it starts again")


def is_here(uri: str) -> bool:
    """Whether an address is of this machine: process ids mean nothing elsewhere."""
    host = uri.split("//")[-1].split(":")[0].strip("/")
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            probe.bind((socket.gethostbyname(host), 0))
    except OSError:
        return False
    return True

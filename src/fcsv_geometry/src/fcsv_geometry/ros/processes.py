# SPDX-License-Identifier: Apache-2.0
"""Processes of this master's nodes: where they are, whether they answer, and which they are on this
machine.

All calls end in time: a master or a node that hangs is what a watch is there for.
"""

import http.client
import os
import xmlrpc.client
from typing import List, Optional
from xml.parsers.expat import ExpatError

import psutil
import rosgraph

from fcsv_geometry.ros.calls import server_at

_NO_SOUND_ANSWER = (
    http.client.HTTPException,
    xmlrpc.client.Error,
    ExpatError,
    ValueError,
    TypeError,
)


def address_of(caller: str, name: str, timeout_s: float) -> str:
    """Gives the address of a node's own interface (ROS 1 slave API), as the master knows it. Raises
    OSError where the master does not answer for ``timeout_s``, or does not know the node."""
    try:
        with server_at(rosgraph.get_master_uri(), timeout_s) as master:
            code, text, uri = master.lookupNode(caller, name)
    except _NO_SOUND_ANSWER as error:
        raise OSError(f"the master's answer is not sound: {error}") from error
    if code != 1:
        raise OSError(str(text))
    return str(uri)


def ask_pid(caller: str, uri: str, timeout_s: float) -> Optional[int]:
    """Process id that the node at ``uri`` tells, as `rosnode ping` asks; None where no sound answer
    comes in time."""
    try:
        with server_at(uri, timeout_s) as node:
            code, _, pid = node.getPid(caller)
    except (OSError, *_NO_SOUND_ANSWER):
        return None
    return pid if code == 1 and isinstance(pid, int) and pid > 1 else None


def ask_to_end(caller: str, name: str, why: str, timeout_s: float) -> None:
    """Ask a node to shut down. Raises OSError where master or node does not answer, each for
    ``timeout_s``."""
    try:
        with server_at(address_of(caller, name, timeout_s), timeout_s) as node:
            node.shutdown(caller, why)
    except _NO_SOUND_ANSWER as error:
        raise OSError(f"its answer is not sound: {error}") from error


def processes_of(name: str) -> List[psutil.Process]:
    """Finds the processes of a node of this master (resolved ``name``) on this machine; one that
    hangs answers no call."""
    return [process for process in psutil.process_iter() if is_node(process, name)]


def is_node(process: psutil.Process, name: str) -> bool:
    """Whether a process is the node, by how roslaunch started it: its command line, namespace and
    master."""
    namespace, _, base = name.rpartition("/")
    try:
        if f"__name:={base}" not in process.cmdline():
            return False
        env = process.environ()
    except (psutil.Error, OSError):
        return False
    same = env.get("ROS_NAMESPACE", "/").strip("/") == namespace.strip("/")
    return same and env.get("ROS_MASTER_URI") == os.environ.get("ROS_MASTER_URI")

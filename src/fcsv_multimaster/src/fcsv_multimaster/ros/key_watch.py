# SPDX-License-Identifier: Apache-2.0
"""Refuses keys where ROS is open to the network, and says in time when they run out."""

import datetime
import http.client
import socket
import xmlrpc.client
from typing import Dict

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from fcsv_multimaster.errors import ExposedError
from fcsv_multimaster.keys.keyring import Keyring
from fcsv_multimaster.network.exposure import REMEDY, exposed, listening
from fcsv_multimaster.ros.master_watch import local_master


def exposures() -> list:
    """What of this machine's ROS others can reach, in words. A master that does not answer tells of
    no nodes."""
    return exposed(rosgraph.get_master_uri(), _nodes(), listening())


def refuse_while_exposed() -> None:
    """Raises ExposedError."""
    found = exposures()
    if found:
        raise ExposedError(
            f"keys protect nothing while ROS is open to the network: {'; '.join(found)}; {REMEDY}"
        )


def status_of(machine: str, keys: Keyring, now: datetime.datetime) -> DiagnosticStatus:
    """Whether the keys will last."""
    text = keys.warning(now)
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if text else DiagnosticStatus.OK,
        name=f"keys {machine}",
        message=text or "well",
        hardware_id=machine,
        values=[
            KeyValue("run out", f"{keys.runs_out:%Y-%m-%d}"),
            KeyValue("certificate", str(keys.certificate)),
            KeyValue("revoked", ", ".join(sorted(keys.revoked.last)) or "nobody"),
        ],
    )


def _nodes() -> Dict[str, str]:
    """Name to address of every node that the local master knows."""
    master, name = local_master(), rospy.get_name()
    try:
        state = master.getSystemState(name)[2]
        known = {node for kind in state for _, nodes in kind for node in nodes}
        found = {node: master.lookupNode(name, node) for node in known}
    except (OSError, socket.timeout, http.client.HTTPException, xmlrpc.client.Error):
        return {}
    return {node: uri for node, (code, _, uri) in found.items() if code == 1}

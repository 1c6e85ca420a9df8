# SPDX-License-Identifier: Apache-2.0
"""Registers this node again at a local master that was restarted, without cutting a connection."""

import http.client
import socket
import xmlrpc.client
from typing import Optional

import rosgraph
import rospy
from rospy.impl import registration

from fcsv_geometry.ros.calls import server_at

_TIMEOUT_S = 2.0


def local_master() -> xmlrpc.client.ServerProxy:
    """Calls to it fail after two seconds without an answer."""
    return server_at(rosgraph.get_master_uri(), _TIMEOUT_S)


def master_knows_us() -> Optional[bool]:
    """None where the master does not answer, be it down or hung.

    Asked by a service that every rospy node has: by its mere name a new master may know a node that
    reads a parameter.
    """
    try:
        return (
            local_master().lookupService(rospy.get_name(), f"{rospy.get_name()}/get_loggers")[0]
            == 1
        )
    except (OSError, socket.timeout, http.client.HTTPException, xmlrpc.client.Error):
        return None


def register_again() -> None:
    """Everything that this node publishes, subscribes and serves, as rospy registers it at the
    start.

    Connections between nodes outlive the master, so they stay; rospy has no public call for this.
    """
    topics, services = registration.get_topic_manager(), registration.get_service_manager()
    listeners = registration.get_registration_listeners()
    for name, kind in topics.get_publications():
        listeners.notify_added(name, kind, registration.Registration.PUB)
    for name, kind in topics.get_subscriptions():
        listeners.notify_added(name, kind, registration.Registration.SUB)
    for name, uri in services.get_services():
        listeners.notify_added(name, uri, registration.Registration.SRV)

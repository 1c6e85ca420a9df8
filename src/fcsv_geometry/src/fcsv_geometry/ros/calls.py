# SPDX-License-Identifier: Apache-2.0
"""Calls to a ROS master or to a node's own interface (XML-RPC) that do not wait for ever."""

import xmlrpc.client


class _Transport(xmlrpc.client.Transport):
    def __init__(self, timeout_s: float):
        super().__init__()
        self._timeout_s = timeout_s

    def make_connection(self, host):
        connection = super().make_connection(host)
        connection.timeout = self._timeout_s
        return connection


def server_at(uri: str, timeout_s: float) -> xmlrpc.client.ServerProxy:
    """Its calls raise OSError where no answer comes for ``timeout_s``."""
    return xmlrpc.client.ServerProxy(uri, transport=_Transport(timeout_s))

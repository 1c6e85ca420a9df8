# SPDX-License-Identifier: Apache-2.0
"""Addresses of machines: HOST:PORT for what is urgent; what is bulky uses the port after it, or HOST:PORT/PORT."""

from dataclasses import dataclass
from typing import Dict

from fcsv_multimaster.errors import EndpointError


@dataclass(frozen=True)
class Endpoint:
    """Where a machine's relay listens, one TCP port per link."""

    host: str
    urgent_port: int
    bulk_port: int

    def locator(self, link: str) -> str:
        """Zenoh's form of the address of one link."""
        return f"tcp/{self.host}:{self.urgent_port if link == 'urgent' else self.bulk_port}"


def parse_endpoint(text: str) -> Endpoint:
    """Raises EndpointError."""
    host, colon, ports = text.strip().rpartition(":")
    urgent, slash, bulk = ports.partition("/")
    try:
        urgent_port = int(urgent)
        bulk_port = int(bulk) if slash else urgent_port + 1
    except ValueError:
        urgent_port = bulk_port = 0
    if not colon or not host or not (0 < urgent_port < 65536 and 0 < bulk_port < 65536):
        raise EndpointError(f"'{text}' is not an address; write HOST:PORT or HOST:PORT/PORT")
    return Endpoint(host, urgent_port, bulk_port)


def parse_peers(text: str) -> Dict[str, Endpoint]:
    """NAME=HOST:PORT,NAME=... Raises EndpointError, also on a name twice."""
    peers: Dict[str, Endpoint] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, equals, address = part.partition("=")
        if not equals or not name.isidentifier():
            raise EndpointError(f"'{part}' is not a peer; write NAME=HOST:PORT")
        if name in peers:
            raise EndpointError(f"peer '{name}' is given twice")
        peers[name] = parse_endpoint(address)
    return peers

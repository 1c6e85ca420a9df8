# SPDX-License-Identifier: Apache-2.0
"""Addresses of machines: HOST:PORT for what is urgent; what is bulky uses the port after it, or
HOST:PORT/PORT."""

import ipaddress
from dataclasses import dataclass
from typing import Dict, Iterable, Optional

from fcsv_multimaster.errors import EndpointError


@dataclass(frozen=True)
class Endpoint:
    """Where a machine's relay listens: UDP and TCP on ``urgent_port`` (datagrams, urgent), TCP on
    ``bulk_port``."""

    host: str
    urgent_port: int
    bulk_port: int

    def locator(self, link: str, encrypted: bool) -> str:
        """Zenoh's form of the address of one link."""
        if link == "datagram":
            return f"{'quic' if encrypted else 'udp'}/{self.host}:{self.urgent_port}?rel=0"
        port = self.urgent_port if link == "urgent" else self.bulk_port
        return f"{'tls' if encrypted else 'tcp'}/{self.host}:{port}"

    @property
    def is_any(self) -> bool:
        """Whether it stands for every address of this machine."""
        return self.host == "0.0.0.0"

    @property
    def stays_on_this_machine(self) -> bool:
        """Whether it is a loopback address."""
        return is_loopback(self.host)


def is_loopback(host: str) -> bool:
    """Judges the host of an address or a host name."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


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
        raise EndpointError(
            f"'{text}' is not an address; write HOST:PORT or HOST:PORT/PORT, as in listen:=192.168.8.10:7447"
        )
    if urgent_port == bulk_port:
        raise EndpointError(f"'{text}' names one port for two links; give two")
    return Endpoint(host, urgent_port, bulk_port)


def parse_peers(text: str, discovery: bool = False) -> Dict[str, Optional[Endpoint]]:
    """NAME=HOST:PORT,NAME=...; with discovery a bare NAME, too (None). Raises EndpointError, also
    on a name twice."""
    peers: Dict[str, Optional[Endpoint]] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, equals, address = part.partition("=")
        if not name.isidentifier():
            raise EndpointError(f"'{part}' is not a peer; write NAME=HOST:PORT")
        if not equals and not discovery:
            raise EndpointError(
                f"peer '{name}' has no address; write {name}=HOST:PORT, or start with discovery:=true"
            )
        if name in peers:
            raise EndpointError(f"peer '{name}' is given twice")
        peers[name] = parse_endpoint(address) if equals else None
    return peers


def refuse_open_networks(endpoints: Iterable[Endpoint], keys: bool, discovery: bool) -> None:
    """Raises EndpointError where a relay without ``keys`` would listen or connect beyond this
    machine."""
    if keys:
        return
    if discovery:
        raise EndpointError(
            "discovery:=true talks to the whole network, and this relay has no keys; give it keys:="
        )
    for endpoint in endpoints:
        if not endpoint.stays_on_this_machine:
            raise EndpointError(
                f"{endpoint.host} is on a network, and this relay has no keys: make them with"
                " `rosrun fcsv_multimaster keys FOLDER control uav1 ...` and give it keys:=FOLDER/ITS_NAME"
            )

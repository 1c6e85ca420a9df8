# SPDX-License-Identifier: Apache-2.0
"""Whether this machine's ROS is open to the network: whoever reaches its ports needs no keys to
command."""

import socket
import struct
from pathlib import Path
from typing import Dict, Iterable, List, Tuple
from urllib.parse import urlsplit

from fcsv_multimaster.network.endpoints import is_loopback

_TABLES = Path("/proc/net/tcp"), Path("/proc/net/tcp6")  # of the process's own network namespace
_LISTENS = "0A"
REMEDY = "start all of ROS with ROS_IP=127.0.0.1 and ROS_MASTER_URI=http://127.0.0.1:11311"


def listening() -> List[Tuple[str, int]]:
    """(address, port) of every TCP socket that listens here."""
    return [end for path in _TABLES if path.exists() for end in parse_table(path.read_text())]


def parse_table(text: str) -> List[Tuple[str, int]]:
    """Reads the lines of the kernel's table.

    >>> parse_table("  sl  local_address\\n   0: 0100007F:2C2F 00000000:0000 0A 0\\n   1: 00000000:0016 0:0 01 0\\n")
    [('127.0.0.1', 11311)]
    """
    out = []
    for words in (line.split() for line in text.splitlines()[1:]):
        if len(words) > 3 and words[3] == _LISTENS:
            address, _, port = words[1].partition(":")
            octets = b"".join(
                struct.pack("=I", int(address[i : i + 8], 16)) for i in range(0, len(address), 8)
            )
            family = socket.AF_INET if len(octets) == 4 else socket.AF_INET6
            out.append((socket.inet_ntop(family, octets), int(port, 16)))
    return out


def exposed(master_uri: str, nodes: Dict[str, str], ends: Iterable[Tuple[str, int]]) -> List[str]:
    """What of ROS can be reached from another machine, in words. ``nodes``: name to the address it
    announces.

    A node follows ROS_IP in what it announces and in where it takes connections for topics. What
    roscpp cannot be told is here in no case: its XML-RPC port is open whatever ROS_IP says, which
    only a firewall closes.
    """
    master = urlsplit(master_uri)
    addresses = [a for a, port in ends if port == master.port]
    open_at = [a for a in addresses if not is_loopback(a)]
    out = [f"the ROS master listens on {a}:{master.port}" for a in open_at]
    if not addresses and not is_loopback(master.hostname or ""):
        out.append(f"the ROS master is on another machine ({master_uri})")
    announced = {name: urlsplit(uri).hostname or "" for name, uri in sorted(nodes.items())}
    return out + [
        f"{name} announces itself as {host}"
        for name, host in announced.items()
        if not is_loopback(host)
    ]

# SPDX-License-Identifier: Apache-2.0
"""The same topic list for fkie_multimaster, on machines that have it: parameters of its discovery
and sync nodes."""

from typing import Dict, List, Optional

from fcsv_multimaster.links import Links
from fcsv_multimaster.network.endpoints import Endpoint

# measured: back within 2 s of a 15 s cut, with nothing stale
HEARTBEAT_HZ, TIMEOUT_FACTOR = 2.0, 1.0


def discovery(peers: Dict[str, Optional[Endpoint]]) -> Dict[str, object]:
    """Parameters of master_discovery: the peers by address; multicast only where one has none."""
    hosts = [p.host for p in peers.values() if p is not None]
    mcast = len(hosts) < len(peers)
    return {
        "robot_hosts": hosts,
        "send_mcast": mcast,
        "listen_mcast": mcast,
        "heartbeat_hz": HEARTBEAT_HZ,
        "timeout_factor": TIMEOUT_FACTOR,
    }


def sync(machine: str, links: Links, peers: Dict[str, Optional[Endpoint]]) -> Dict[str, object]:
    """Parameters of master_sync: what crosses to or from this machine, and no service, node or
    other topic."""
    topics: List[str] = sorted(
        {t for p in peers for pair in ((machine, p), (p, machine)) for t in links.crossing(*pair)}
    )
    return {
        "sync_topics": topics,
        "ignore_services": ["/*"],
        "sync_remote_nodes": False,
        "sync_topics_on_demand": False,
    }

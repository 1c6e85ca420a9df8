# SPDX-License-Identifier: Apache-2.0
"""Starts fkie's discovery and sync with parameters from the links file, in place of the relay."""

import os
import subprocess
import time
from dataclasses import dataclass
from typing import List

import rospkg
import rospy

from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health
from fcsv_multimaster import fkie
from fcsv_multimaster.errors import RelayError
from fcsv_multimaster.links import load_links
from fcsv_multimaster.network.endpoints import parse_peers

_NODES = (("fkie_master_discovery", "master_discovery"), ("fkie_master_sync", "master_sync"))


@dataclass(frozen=True)
class FkieParameters:
    """Holds parameters as the relay's; ``keys`` and the ports are not for fkie, which is open: use
    it inside a VPN alone."""

    machine: str
    links: str
    listen: str = ""
    peers: str = ""
    keys: str = ""
    discovery: bool = False


class FkieNode:
    """Two processes of fkie's; ends when one of them ends, so that roslaunch starts both again."""

    def __init__(self):
        parameters = node.parameters(FkieParameters)
        for package, _ in _NODES:
            try:
                rospkg.RosPack().get_path(package)
            except rospkg.ResourceNotFound as error:
                raise RelayError(
                    f"link:=fkie needs the package {package}, which is not installed; use link:=relay"
                ) from error
        links, peers = (
            load_links(parameters.links),
            parse_peers(parameters.peers, parameters.discovery),
        )
        rospy.set_param("/master_discovery", fkie.discovery(peers))
        rospy.set_param("/master_sync", fkie.sync(parameters.machine, links, peers))
        rospy.logwarn(
            "link:=fkie neither authenticates nor encrypts: anybody on this network can command the vehicles"
        )
        env = dict(os.environ)
        env.pop("ROS_NAMESPACE", None)
        self._processes: List[subprocess.Popen] = [
            subprocess.Popen(["rosrun", package, name, f"__name:={name}"], env=env)
            for package, name in _NODES
        ]
        self._health = Health("fkie")
        self._health.value("machine", parameters.machine)
        self._health.value("peers", ", ".join(sorted(peers)))
        rospy.on_shutdown(self._stop)

    def spin(self) -> None:
        while not rospy.is_shutdown() and all(p.poll() is None for p in self._processes):
            time.sleep(0.2)
        for (_, name), process in zip(_NODES, self._processes):
            if process.poll() is not None and not rospy.is_shutdown():
                self._health.problem(
                    name, f"{name} of fkie ended with {process.returncode}; both are started again"
                )
        self._stop()

    def _stop(self) -> None:
        for process in self._processes:
            process.terminate()
        for process in self._processes:
            process.wait()


def main() -> int:
    """Run the node."""
    return node.run("relay", FkieNode)

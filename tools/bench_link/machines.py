# SPDX-License-Identifier: Apache-2.0
"""Machines in network namespaces of their own, with a master and a relay each, and the keys that
they share."""

import sys
import textwrap
import time
from pathlib import Path
from typing import Callable, Dict, List, Optional

from radio import Conditions, Radio, in_namespace

from fcsv_multimaster.keys.keyring import make_fleet
from fcsv_sim.machines.machines import Machine, Process, start_together, stop_together

PORT, BULK_PORT = 7447, 7448
MASTER_PORT = 11311


class NamespaceMachine(Machine):
    """A machine whose loopback is its own: every one has its master on the same port."""

    def __init__(self, name: str, folder, namespace: str):
        super().__init__(name, folder, port=MASTER_PORT)
        self.namespace = namespace
        self.prefix: List[str] = []  # of every command: env, for example

    def master_alive(self) -> bool:
        return in_namespace(self.namespace, super().master_alive)

    def python(self, code: str, log: str = "script") -> Process:
        """A rospy script on this machine; it runs until the machine stops."""
        path = self.folder / f"{log}-{time.time()}.py"
        path.write_text(
            "import rospy, sys, time\nfrom fcsv_geometry.ros import node\nnode.begin('t', anonymous=True)\n"
            + textwrap.dedent(code)
        )
        return self.run([sys.executable, str(path)], path.stem)

    def _inside(self, command):
        return ["ip", "netns", "exec", self.namespace, *self.prefix, *command]


class Net:
    """Machines with relays over an emulated radio, whose delays go by ``clock`` (s).

    ``masters``: who has ROS, and is told to the relays as a peer; all by default.
    """

    def __init__(
        self,
        folder,
        links,
        names=("control", "uav1"),
        conditions=None,
        congestion="",
        masters=None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.folder, self.links = Path(folder), Path(links)
        self.keys = self.folder / "keys"
        make_fleet(self.keys, names)
        self.radio = Radio(names, conditions or Conditions(), congestion=congestion, clock=clock)
        self._with_ros = tuple(names if masters is None else masters)
        self.machines: Dict[str, NamespaceMachine] = {}
        self.relays: Dict[str, Process] = {}
        self._others: List[Process] = []
        try:
            for name in self._with_ros:
                machine = NamespaceMachine(name, self.folder, self.radio.namespace(name))
                self.machines[name] = machine
            start_together(self.machines.values())
            for name in self.machines:
                self.start_relay(name)
        except BaseException:
            self.stop()
            raise

    def peers(self, name: str) -> str:
        """As the relay of ``name`` takes them."""
        others = (n for n in self._with_ros if n != name)
        return ",".join(f"{n}={self.radio.addresses[n]}:{PORT}" for n in others)

    def start_relay(
        self,
        name: str,
        peers: Optional[str] = None,
        listen: Optional[str] = None,
        discovery: bool = False,
    ) -> Process:
        """The relay node of a machine, with its keys."""
        listen = listen or f"0.0.0.0:{PORT}"
        peers = self.peers(name) if peers is None else peers
        self.relays[name] = self.machines[name].run(
            [
                "rosrun",
                "fcsv_multimaster",
                "relay",
                f"_machine:={name}",
                f"_links:={self.links}",
                f"_listen:={listen}",
                f"_peers:={peers}",
                f"_keys:={self.keys / name}",
                f"_discovery:={str(discovery).lower()}",
            ],
            "relay",
        )
        return self.relays[name]

    def stop(self) -> None:
        for process in self._others:
            process.stop()
        stop_together(self.machines.values())
        self.radio.close()

    def __enter__(self) -> "Net":
        return self

    def __exit__(self, *_exc) -> None:
        self.stop()


def vehicle_ports(index: int) -> int:
    """The first port of a vehicle that shares its address with others."""
    return 7500 + 2 * index


class FleetNet(Net):
    """A control PC with a master and a relay; all vehicles behind one address, without ROS."""

    def __init__(self, folder, links, vehicles, conditions=None):
        self._vehicles = tuple(vehicles)
        super().__init__(folder, links, ("control", "vehicles"), conditions, masters=("control",))

    def peers(self, name: str) -> str:
        make_fleet(self.keys, self._vehicles)
        address = self.radio.addresses["vehicles"]
        return ",".join(f"{v}={address}:{vehicle_ports(i)}" for i, v in enumerate(self._vehicles))

    def run_in(self, name: str, command) -> Process:
        """A process in a namespace that has no master."""
        inside = ["ip", "netns", "exec", self.radio.namespace(name), *command]
        self._others.append(Process(inside, self.folder / f"{name}-{len(self._others)}.log"))
        return self._others[-1]

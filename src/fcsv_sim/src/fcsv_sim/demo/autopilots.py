# SPDX-License-Identifier: Apache-2.0
"""ArduCopter's own simulation in the place of the simulated autopilots: ``make demo
AUTOPILOT=...``"""

import re
from typing import Sequence, Tuple

from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.autopilot.simulation_line import require_simulation
from fcsv_sim.bringup import vehicles_folder
from fcsv_sim.machines.machines import MachineError

_ADDRESS = re.compile(r"tcp:(127\.0\.0\.1|localhost):(\d{1,5})")
# of instance 0; an instance is ten ports further on, in both
_FIRST_PORT, _FIRST_RC_PORT = 5760, 5501
_LAST_PORT = 65000


def addresses(words: str) -> Tuple[str, ...]:
    """Those of AUTOPILOT, as ``tcp:127.0.0.1:PORT``. Raises MachineError.

    >>> addresses("tcp:127.0.0.1:5760,tcp:localhost:5770"), addresses("")
    (('tcp:127.0.0.1:5760', 'tcp:127.0.0.1:5770'), ())
    """
    found = []
    for word in filter(None, (w.strip() for w in words.split(","))):
        match = _ADDRESS.fullmatch(word)
        if match is None or not _FIRST_PORT <= int(match.group(2)) <= _LAST_PORT:
            raise MachineError(
                f"--autopilot {word}: give tcp:127.0.0.1:PORT, {_FIRST_PORT} or a port above it"
            )
        found.append(f"tcp:127.0.0.1:{match.group(2)}")
    twice = next((a for a in found if found.count(a) > 1), None)
    if twice is not None:
        raise MachineError(
            f"--autopilot {words}: {twice} stands there twice; each vehicle has its own"
        )
    return tuple(found)


def rc_port(address: str) -> int:
    """The UDP port on which the simulation at an address hears a transmitter.

    >>> rc_port("tcp:127.0.0.1:5770")
    5511
    """
    return _FIRST_RC_PORT + int(address.rpartition(":")[2]) - _FIRST_PORT


def require_there(autopilots: Sequence[str], vehicles: Sequence[str], speed: float) -> None:
    """Raises MachineError or ElsewhereError unless each vehicle's ArduCopter is there, is the right
    one, and simulates at ``speed``, a share of real time."""
    if len(autopilots) != len(vehicles):
        names = ", ".join(vehicles)
        raise MachineError(
            f"--autopilot names {len(autopilots)} autopilots, the mission flies {len(vehicles)}: {names}"
        )
    known = load_vehicles(vehicles_folder(), vehicles)
    for address, vehicle in zip(autopilots, vehicles):
        require_simulation(address, vehicle, known[vehicle].system_id, speed)

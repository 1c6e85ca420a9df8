# SPDX-License-Identifier: Apache-2.0
"""Whose heartbeats are the vehicle's. A script on the companion computer often speaks with the
autopilot's own system and component id; a vehicle is who it was met as, by type and autopilot."""

import logging
from dataclasses import dataclass
from typing import Dict, Set, Tuple

from pymavlink import mavutil

from fcsv_control.flight.mavlink import firmware
from fcsv_control.flight.mavlink.keeper import CONNECTED_S

_M = mavutil.mavlink
_LOG = logging.getLogger(__name__)
_TOLD_S = 5.0  # so long after it was heard last somebody else is told of

Kind = Tuple[int, int]  # MAV_TYPE, MAV_AUTOPILOT


@dataclass
class _Met:
    kind: Kind
    is_copter: bool
    heard_s: float


class Identities:
    """Knows the heartbeats of the autopilots on a line, by system id."""

    def __init__(self):
        self._met: Dict[int, _Met] = {}
        self._named: Set[Tuple[int, Kind]] = set()
        self._imitated: Dict[int, Tuple[Kind, float]] = {}  # by whom last, and when

    def is_own(self, now_s: float, heartbeat) -> bool:
        """Whether a HEARTBEAT of the autopilot's component is that of the vehicle which was met
        first with its system id. After 3 s of that one's silence another may take its place, an
        ArduCopter that of another firmware at once."""
        system, kind = heartbeat.get_srcSystem(), (heartbeat.type, heartbeat.autopilot)
        met = self._met.get(system)
        is_copter = (
            firmware.is_vehicles(heartbeat) and firmware.name_of(heartbeat) == firmware.COPTER
        )
        stays = (
            met is not None
            and now_s - met.heard_s < CONNECTED_S
            and (met.is_copter or not is_copter)
        )
        if not firmware.is_vehicles(heartbeat) or (stays and kind != met.kind):
            self._imitated[system] = (kind, now_s)
            self._name(system, kind)
            return False
        self._met[system] = _Met(kind, is_copter, now_s)
        return True

    def imitated(self, now_s: float, system: int) -> str:
        """Who else speaks as this vehicle, and what to do; empty where nobody does."""
        kind, heard_s = self._imitated.get(system, ((0, 0), float("-inf")))
        return _in_words(system, kind) if now_s - heard_s < _TOLD_S else ""

    def _name(self, system: int, kind: Kind) -> None:
        """Once."""
        if (system, kind) not in self._named:
            self._named.add((system, kind))
            _LOG.warning("%s", _in_words(system, kind))


def _in_words(system: int, kind: Kind) -> str:
    """
    >>> _in_words(1, (18, 8))
    "heartbeat of ONBOARD_CONTROLLER, INVALID has the autopilot's ids (1, 1): give that program another component id"
    """
    names = ", ".join(
        _name_of(enum, number) for enum, number in zip(("MAV_TYPE", "MAV_AUTOPILOT"), kind)
    )
    return f"heartbeat of {names} has the autopilot's ids ({system}, 1): give that program another component id"


def _name_of(enum: str, number: int) -> str:
    known = _M.enums[enum].get(number)
    return known.name[len(enum) + 1 :] if known else str(number)

# SPDX-License-Identifier: Apache-2.0
"""Which lines a vehicle has behind each flight link: our own and MAVROS's to an ArduCopter, and a
Tello's.

What differs is what can be heard, how bad it is, and what to do about it.
"""

from dataclasses import replace
from typing import Dict, Tuple

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Check, Found
from fcsv_control.flight_check.rules import VehicleCheckRules
from fcsv_control.flight_check.vehicle import VEHICLE_CHECKS, VehicleFacts, guardian, link_now
from fcsv_control.guardian.messages import Cause

_AS_OF_OTHERS = ("transmitter", "battery", "camera", "recorder", "disk")
MAVLINK, MAVROS, TELLO = "mavlink", "mavros", "tello"
_MAVROS_REMEDIES = {
    "link": "look at mavros in /diagnostics; check cable and fcu_url",
    "streams": "free the serial line; plugins sys_status and local_position of MAVROS must run",
    "signing": "a cable, or flight_link:=mavlink with signing_key:=FILE: MAVROS does not sign",
}
_TELLO_REMEDIES = {
    "feed": "bring it before the tracker on the ground; is that running?",
    "transmitter": "start joy_node; plug the gamepad in: without it nobody takes it over",
    "battery": "change it",
    "camera": "calibration:=FILE of tello.launch; look at its Wi-Fi",
}


def _flight_data(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    link = link_now(now_s, f, r)
    if link is None:
        return Grade.UNKNOWN, "nothing is heard of the Tello"
    if link.in_the_air is None:
        return Grade.RED, "it does not say whether it flies"
    return Grade.GREEN, "it flies" if link.in_the_air else "it stands"


def _stands(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> bool:
    link = link_now(now_s, f, r)
    return link is not None and link.in_the_air is False


def _poses(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    """A mocap looks up, and gimbals find their vehicle in the air: who stands need not be seen."""
    state, what = _OF["feed"].grade(now_s, f, r)
    if state is Grade.RED and _stands(now_s, f, r) and not f.link.value.doubt:
        return Grade.AMBER, f"it stands, and {what}"
    return state, what


def _guardian(now_s: float, f: VehicleFacts, r: VehicleCheckRules) -> Found:
    no_poses = (Cause.NO_POSES,) if _stands(now_s, f, r) else ()
    return guardian(now_s, f, r, (Cause.STICK, *no_poses))


_OF: Dict[str, Check] = {check.name: check for check in VEHICLE_CHECKS}


def _remedied(check: Check, remedies: Dict[str, str]) -> Check:
    return replace(check, remedy=remedies.get(check.name, check.remedy))


#: A Tello has no pre-arm checks, parameters, origin and filter to ask; its tracker and relay are
#: the control PC's.
TELLO_CHECKS: Tuple[Check, ...] = (
    Check(
        "link",
        "packets come from the Tello",
        "is it on? look at its Wi-Fi, and network:= of tello.launch",
        _OF["link"].grade,
    ),
    Check(
        "flight data",
        "its flight data can be read",
        "wait; if it stays so, its firmware is another one",
        _flight_data,
    ),
    replace(
        _remedied(_OF["feed"], _TELLO_REMEDIES),
        must="the tracker's poses come, and are believed",
        grade=_poses,
    ),
    *(_remedied(_OF[name], _TELLO_REMEDIES) for name in _AS_OF_OTHERS),
    replace(_OF["guardian"], grade=_guardian),
    _OF["agent"],
)
CHECKS: Dict[str, Tuple[Check, ...]] = {
    MAVLINK: VEHICLE_CHECKS,
    MAVROS: tuple(_remedied(check, _MAVROS_REMEDIES) for check in VEHICLE_CHECKS),
    TELLO: TELLO_CHECKS,
}

# SPDX-License-Identifier: Apache-2.0
"""Which firmware speaks: this flies ArduCopter; others use the same messages and mean something
else by them."""

from pymavlink import mavutil

_M = mavutil.mavlink
COPTER = "ArduCopter"
_COPTERS = frozenset(
    {
        _M.MAV_TYPE_QUADROTOR,
        _M.MAV_TYPE_COAXIAL,
        _M.MAV_TYPE_HELICOPTER,
        _M.MAV_TYPE_HEXAROTOR,
        _M.MAV_TYPE_OCTOROTOR,
        _M.MAV_TYPE_TRICOPTER,
        _M.MAV_TYPE_DODECAROTOR,
        _M.MAV_TYPE_DECAROTOR,
    }
)
_ARDUPILOTS = {
    _M.MAV_TYPE_GROUND_ROVER: "ArduRover",
    _M.MAV_TYPE_SURFACE_BOAT: "ArduRover",
    _M.MAV_TYPE_SUBMARINE: "ArduSub",
    _M.MAV_TYPE_AIRSHIP: "Blimp",
    _M.MAV_TYPE_ANTENNA_TRACKER: "AntennaTracker",
}
_VTOLS = frozenset(
    number for number, t in _M.enums["MAV_TYPE"].items() if t.name.startswith("MAV_TYPE_VTOL_")
)
_VEHICLES = (
    _COPTERS | _VTOLS | frozenset(_ARDUPILOTS) | {_M.MAV_TYPE_GENERIC, _M.MAV_TYPE_FIXED_WING}
)


def is_vehicles(heartbeat) -> bool:
    """Whether a HEARTBEAT is a vehicle's autopilot's. Gimbals, cameras, ground stations, ADS-B
    receivers and companions send heartbeats of other types, or say that they are no autopilot
    (INVALID)."""
    return heartbeat.autopilot != _M.MAV_AUTOPILOT_INVALID and heartbeat.type in _VEHICLES


def name_of(heartbeat) -> str:
    """The firmware that sent a HEARTBEAT: ArduCopter, ArduPlane, PX4 and so on."""
    if heartbeat.autopilot != _M.MAV_AUTOPILOT_ARDUPILOTMEGA:
        known = _M.enums["MAV_AUTOPILOT"].get(heartbeat.autopilot)
        return known.name[len("MAV_AUTOPILOT_") :] if known else f"autopilot {heartbeat.autopilot}"
    return COPTER if heartbeat.type in _COPTERS else _ARDUPILOTS.get(heartbeat.type, "ArduPlane")


def version_of(autopilot_version) -> str:
    """The version that an AUTOPILOT_VERSION tells, as 4.6.2."""
    number = autopilot_version.flight_sw_version
    return f"{number >> 24 & 255}.{number >> 16 & 255}.{number >> 8 & 255}"

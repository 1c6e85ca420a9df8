# SPDX-License-Identifier: Apache-2.0
"""What the flight controller says of itself."""

from dataclasses import dataclass, replace
from typing import Optional

from pymavlink import mavutil

_M = mavutil.mavlink
_PREARM_BIT = 0x10000000
_LANDED = {_M.MAV_LANDED_STATE_ON_GROUND: True, _M.MAV_LANDED_STATE_IN_AIR: False,
           _M.MAV_LANDED_STATE_TAKEOFF: False, _M.MAV_LANDED_STATE_LANDING: False}  # fmt: skip
_MODE_NAMES = dict(mavutil.mode_mapping_acm)
#: ArduCopter's modes by name, e.g. MODES["GUIDED"] == 4.
MODES = {name: number for number, name in _MODE_NAMES.items()}


@dataclass(frozen=True)
class FlightState:
    """Replaced as a whole on every message, so that a reader in another thread sees one moment."""

    armed: bool = False
    mode: str = ""
    guided: bool = False
    manual_input: bool = False
    system_status: int = 0
    landed: Optional[bool] = None
    prearm_ok: Optional[bool] = None
    voltage_v: float = float("nan")
    current_a: float = float("nan")
    battery_share: float = float("nan")
    ekf_flags: int = 0

    def with_heartbeat(self, m) -> "FlightState":
        """After a HEARTBEAT of the autopilot."""
        return replace(
            self,
            armed=bool(m.base_mode & _M.MAV_MODE_FLAG_SAFETY_ARMED),
            guided=bool(m.base_mode & _M.MAV_MODE_FLAG_GUIDED_ENABLED),
            manual_input=bool(m.base_mode & _M.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED),
            mode=_MODE_NAMES.get(m.custom_mode, f"MODE{m.custom_mode}"),
            system_status=m.system_status,
        )

    def with_sys_status(self, m) -> "FlightState":
        """After a SYS_STATUS; what it does not know is NaN."""
        return replace(
            self,
            prearm_ok=bool(m.onboard_control_sensors_health & _PREARM_BIT),
            voltage_v=m.voltage_battery / 1000.0 if m.voltage_battery != 65535 else float("nan"),
            current_a=m.current_battery / 100.0 if m.current_battery >= 0 else float("nan"),
            battery_share=m.battery_remaining / 100.0 if m.battery_remaining >= 0 else float("nan"),
        )

    def with_extended(self, m) -> "FlightState":
        """After an EXTENDED_SYS_STATE."""
        return replace(self, landed=_LANDED.get(m.landed_state))

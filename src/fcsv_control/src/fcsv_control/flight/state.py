# SPDX-License-Identifier: Apache-2.0
"""What the flight controller says of itself."""

import math
from operator import attrgetter
from typing import Optional, Tuple

from pymavlink import mavutil

from fcsv_geometry.frozen import changed, frozen
from fcsv_geometry.vehicles.modes import Mode

_M = mavutil.mavlink
_PREARM_BIT = 0x10000000
_LANDED = {
    _M.MAV_LANDED_STATE_ON_GROUND: True,
    _M.MAV_LANDED_STATE_IN_AIR: False,
    _M.MAV_LANDED_STATE_TAKEOFF: False,
    _M.MAV_LANDED_STATE_LANDING: False,
}
_FILTER_RUNS, _FILTER_NOT_BEGUN = 0x001, 0x400  # EKF_STATUS_FLAGS: attitude, uninitialised
_CHANNELS = attrgetter(*(f"chan{k + 1}_raw" for k in range(18)))
_THROTTLE = 2  # index of the throttle's channel, as RCMAP_THROTTLE is by default
_MODES = {number: Mode(name) for number, name in mavutil.mode_mapping_acm.items()}
#: The numbers of ArduCopter's modes, e.g. MODES[Mode.GUIDED] == 4.
MODES = {mode: number for number, mode in _MODES.items()}


@frozen
class FlightState:
    """Replaced as a whole on every message, so that a reader in another thread sees one moment."""

    armed: bool = False
    mode: Mode = Mode.UNHEARD
    guided: bool = False
    manual_input: bool = False
    system_status: int = 0
    landed: Optional[bool] = None
    prearm_ok: Optional[bool] = None
    voltage_v: float = float("nan")
    current_a: float = float("nan")
    battery_share: float = float("nan")
    ekf_flags: int = 0
    # of EKF_STATUS_REPORT: test ratios, about 1 where the filter rejects
    velocity_variance: float = float("nan")
    pos_horiz_variance: float = float("nan")
    pos_vert_variance: float = float("nan")
    compass_variance: float = float("nan")
    ekf_heard_s: float = float("-inf")  # when, on the receiver's monotonic clock
    # the pilot's stick, -1 (down) to 1; NaN where no transmitter is heard
    throttle: float = float("nan")
    throttle_heard_s: float = float("-inf")  # when, on the receiver's monotonic clock
    rc_channels: Tuple[int, ...] = ()  # pulse widths (us)
    rc_rssi: int = 255  # 0..254; 255 is unknown

    @property
    def ekf_variance(self) -> float:
        """The largest of the filter's variances that are known; NaN where none is."""
        all_four = (
            self.velocity_variance,
            self.pos_horiz_variance,
            self.pos_vert_variance,
            self.compass_variance,
        )
        return max((v for v in all_four if not math.isnan(v)), default=float("nan"))

    @property
    def booting(self) -> bool:
        """Whether the firmware itself is still starting: nothing that it says of its sensors counts
        yet."""
        return self.system_status == _M.MAV_STATE_BOOT

    @property
    def filter_runs(self) -> bool:
        """Whether the filter has begun: an origin that was set before that is lost."""
        begun = bool(self.ekf_flags & _FILTER_RUNS) and not self.ekf_flags & _FILTER_NOT_BEGUN
        return begun and not self.booting

    def with_ekf(self, now_s: float, m) -> "FlightState":
        """Gives the state after an EKF_STATUS_REPORT."""
        return changed(
            self,
            ekf_flags=m.flags,
            velocity_variance=m.velocity_variance,
            pos_horiz_variance=m.pos_horiz_variance,
            pos_vert_variance=m.pos_vert_variance,
            compass_variance=m.compass_variance,
            ekf_heard_s=now_s,
        )

    def with_rc(self, now_s: float, m) -> "FlightState":
        """Gives the state after an RC_CHANNELS; a channel that is not heard has a pulse of 0 or
        65535."""
        channels = _CHANNELS(m)[: m.chancount]
        pulse = channels[_THROTTLE] if len(channels) > _THROTTLE else 0
        heard = 800 <= pulse <= 2200
        throttle = max(-1.0, min(1.0, (pulse - 1500) / 500.0)) if heard else float("nan")
        heard_s = now_s if heard else self.throttle_heard_s
        return changed(
            self, throttle=throttle, throttle_heard_s=heard_s, rc_channels=channels, rc_rssi=m.rssi
        )

    @property
    def in_the_air(self) -> Optional[bool]:
        """Says, as the autopilot says; None: it has not said."""
        return None if self.landed is None else not self.landed

    def with_heartbeat(self, m) -> "FlightState":
        """Gives the state after a HEARTBEAT of the autopilot."""
        return changed(
            self,
            armed=bool(m.base_mode & _M.MAV_MODE_FLAG_SAFETY_ARMED),
            guided=bool(m.base_mode & _M.MAV_MODE_FLAG_GUIDED_ENABLED),
            manual_input=bool(m.base_mode & _M.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED),
            mode=_MODES.get(m.custom_mode) or Mode(f"MODE{m.custom_mode}"),
            system_status=m.system_status,
        )

    def with_sys_status(self, m) -> "FlightState":
        """Gives the state after a SYS_STATUS; what it does not know is NaN."""
        return changed(
            self,
            prearm_ok=None
            if self.booting
            else bool(m.onboard_control_sensors_health & _PREARM_BIT),
            voltage_v=m.voltage_battery / 1000.0 if m.voltage_battery != 65535 else float("nan"),
            current_a=m.current_battery / 100.0 if m.current_battery >= 0 else float("nan"),
            battery_share=m.battery_remaining / 100.0 if m.battery_remaining >= 0 else float("nan"),
        )

    def with_extended(self, m) -> "FlightState":
        """Gives the state after an EXTENDED_SYS_STATE."""
        return changed(self, landed=_LANDED.get(m.landed_state))

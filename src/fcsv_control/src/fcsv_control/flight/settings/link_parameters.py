# SPDX-License-Identifier: Apache-2.0
"""Parameters of the flight link."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LinkParameters:
    """``target_system`` 0: the first autopilot heard. Origin: any place will do without GPS, but
    not altitude 0, with which ArduCopter resets its height datum every second until it is armed."""

    target_system: int = 0
    position_rate_hz: float = 30.0
    command_timeout_s: float = 1.0
    command_tries: int = 3
    origin_lat_deg: float = 35.0
    origin_lon_deg: float = 135.0
    origin_alt_m: float = 10.0
    set_parameters: bool = False

    def __post_init__(self):
        if not 0 <= self.target_system <= 255:
            raise ValueError(f"target_system: {self.target_system} is not in 0..255")
        if not 1.0 <= self.position_rate_hz <= 200.0:
            raise ValueError(f"position_rate_hz: {self.position_rate_hz} is not in 1..200")
        if not (0.1 <= self.command_timeout_s <= 5.0 and 1 <= self.command_tries <= 10):
            raise ValueError("command_timeout_s: must be in 0.1..5, command_tries in 1..10")
        if not (abs(self.origin_lat_deg) <= 89.0 and abs(self.origin_lon_deg) <= 180.0):
            raise ValueError("origin_lat_deg: must be in -89..89, origin_lon_deg in -180..180")
        if not 1.0 <= abs(self.origin_alt_m) <= 8000.0:
            raise ValueError(
                f"origin_alt_m: {self.origin_alt_m} is not 1..8000 or below -1: at 0 the height runs away"
            )

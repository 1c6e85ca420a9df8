# SPDX-License-Identifier: Apache-2.0
"""The airframe of a Tello; what flies it is in fcsv_sim/tello."""

from fcsv_sim.vehicles.dynamics import Airframe


def tello_airframe() -> Airframe:
    """87 g with markers or tags (table 4.1)."""
    return Airframe(
        mass_kg=0.1,
        max_thrust_n=2.0,
        drag_per_s=0.4,
        motor_lag_s=0.04,
        attitude_rate_per_s=9.0,
        vibration_rms_deg=0.1,
    )

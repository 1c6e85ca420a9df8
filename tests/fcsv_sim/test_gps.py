# SPDX-License-Identifier: Apache-2.0
"""The simulated GPS receiver: as wrong as it says, for minutes in the same way."""

import numpy as np
import pytest
from pyproj import Geod

from fcsv_sim.autopilot.core import Autopilot
from fcsv_sim.autopilot.gps import HEIGHT_SIGMA_M, SIGMA_M, GpsReceiver, geographic
from fcsv_sim.autopilot.mavlink_server import MavlinkServer

PLACE = (30.0, -12.0, 8.0)


def off_m(fix):
    """(3,) east, north, up of where the receiver is."""
    true = geographic(PLACE)
    azimuth, _, away_m = Geod(ellps="WGS84").inv(true[1], true[0], fix[1], fix[0])
    turn = np.radians(azimuth)
    return np.array([away_m * np.sin(turn), away_m * np.cos(turn), fix[2] - true[2]])


def fixes(seed, times_s):
    receiver = GpsReceiver(seed)
    receiver.feel(PLACE)
    return [receiver.fix(t) for t in times_s]


def test_errors_are_as_large_as_it_says():
    found = np.array([off_m(fixes(seed, [0.0])[0]) for seed in range(400)])
    rms = np.sqrt(np.square(found).mean(axis=0))
    assert rms == pytest.approx([SIGMA_M, SIGMA_M, HEIGHT_SIGMA_M], rel=0.12)


def test_they_stay_for_a_flight_and_change_over_an_hour():
    soon, later = [], []
    for seed in range(60):
        first, second, third = map(off_m, fixes(seed, [0.0, 20.0, 3600.0]))
        soon.append(np.linalg.norm(second - first))
        later.append(np.linalg.norm(third - first))
    assert np.median(soon) < 2.0 < 4.0 < np.median(later)


def gps_raw(receiver):
    pilot = Autopilot(0.5, 1)
    pilot.gps = receiver
    server = MavlinkServer(pilot, 1)
    server.step(10.0, (0.0, 0.0, 0.0))
    server._gps_raw()
    return [m for m in server.outgoing() if m.get_type() == "GPS_RAW_INT"][0]


def test_an_autopilot_without_a_receiver_says_so_as_the_real_one_does():
    assert gps_raw(None).fix_type == 0
    receiver = GpsReceiver(3)
    receiver.feel(PLACE)
    told = gps_raw(receiver)
    assert told.fix_type == 3 and told.h_acc == 2000 and told.alt_ellipsoid - told.alt == 46000
    assert abs(told.lat / 1e7 - geographic(PLACE)[0]) < 1e-4

# SPDX-License-Identifier: Apache-2.0
"""The pair check's port: what it wants looked at, when it rests, and what it cannot use."""

import cv2
import numpy as np
import pytest
from support.radio_pictures import PLACES, T_HOME_ODOM
from support.scenes import CAMERA, camera_pose

from fcsv_geometry import transforms
from fcsv_geometry.home import OdomLink
from fcsv_geometry.vehicles import telemetry as tm
from fcsv_stereo.in_flight.pair_check import PairLook
from fcsv_stereo.in_flight.pair_check_port import LookAt, PairCheckPort, PairSeen
from fcsv_stereo.model import LivePicture

ONE, TWO, THREE = NAMES = tuple(PLACES)
GREY = cv2.imencode(".jpg", np.full((CAMERA.height, CAMERA.width, 3), 99, np.uint8))[1].tobytes()


def picture(name, stamp_s, jpeg=None):
    T_home_cam = camera_pose(PLACES[name])
    T_odom_cam = transforms.invert(T_HOME_ODOM[name]) @ T_home_cam
    return LivePicture(name, stamp_s, GREY if jpeg is None else jpeg, CAMERA, T_odom_cam)


def tell_frames(port, children=(TWO, THREE)):
    links = [
        OdomLink(ONE, n, transforms.invert(T_HOME_ODOM[ONE]) @ T_HOME_ODOM[n], np.zeros((4, 4)))
        for n in children
    ]
    port.receive(0.0, tm.CalibrationFound(0.0, links))
    port.receive(0.0, tm.HomeFound(0.0, ONE, transforms.invert(T_HOME_ODOM[ONE])))


def seen(look_at, off=False):
    b = look_at.b
    return PairSeen(look_at.a.vehicle, b.vehicle, b.stamp_s, PairLook(60, 50, 0.1, 1.0, off))


@pytest.fixture
def port():
    return PairCheckPort(NAMES, rate_hz=2.0, most_share=0.25)


def test_nothing_is_looked_at_before_home_is_known(port):
    for name in (ONE, TWO):
        port.receive(1.0, picture(name, 10.0))
    assert port.step(1.0) == []
    tell_frames(port)
    (look_at,) = port.step(1.1)
    assert (look_at.a.vehicle, look_at.b.vehicle) == (ONE, TWO)
    assert np.allclose(look_at.b.T_home_cam, camera_pose(PLACES[TWO]))


def test_it_waits_for_who_looks_then_tells_and_rests_three_times_as_long(port):
    tell_frames(port)
    for name in NAMES:
        port.receive(1.0, picture(name, 10.0))
    (first,) = port.step(1.0)
    assert port.step(1.3) == [], "one at a time"
    port.receive(1.4, seen(first))
    assert port.step(1.4) == [seen(first)]
    assert port.step(2.5) == [], "it looked for 0.4 s: a quarter of the time"
    (second,) = port.step(2.6)
    assert isinstance(second, LookAt)
    assert {first.b.vehicle, second.b.vehicle} == {TWO, THREE}


def test_whom_the_calibration_leaves_out_is_dropped_and_named(port):
    tell_frames(port, children=(TWO,))
    for name in (ONE, THREE):
        port.receive(1.0, picture(name, 10.0))
    (dropped,) = port.step(1.0)
    assert isinstance(dropped, tm.Dropped) and f"where {THREE} is in home" in dropped.why
    port.receive(1.0, picture(TWO, 10.0))
    assert isinstance(port.step(1.0)[0], LookAt), "the others are looked at"


def test_a_picture_that_is_none_is_dropped_and_the_next_is_looked_at(port):
    tell_frames(port)
    for jpeg, kind in ((b"no jpeg at all", tm.Dropped), (None, LookAt)):
        for name in (ONE, TWO):
            port.receive(1.0, picture(name, 10.0 if jpeg else 12.0, jpeg))
        (found,) = port.step(1.0)
        assert isinstance(found, kind)


@pytest.mark.parametrize("off", [False, True])
def test_what_is_off_is_said(off):
    look = PairLook(60, 50, 1.5, 20.0, off)
    assert (f"{ONE} and {TWO}" in PairSeen(ONE, TWO, 1.0, look).problem) == off


def test_what_it_does_not_know_is_refused(port):
    with pytest.raises(TypeError, match="takes no str"):
        port.receive(0.0, "a text")

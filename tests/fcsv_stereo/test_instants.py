# SPDX-License-Identifier: Apache-2.0
"""Which pictures of several cameras are of one instant."""

import numpy as np
import pytest

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo import cli, instants
from fcsv_stereo.errors import InputError
from fcsv_stereo.joint.method import choose_pictures
from fcsv_stereo.model import Configuration, ConfigurationInput, MapInput, Picture

CAMERA = PinholeCamera.from_fov(4, 3, np.radians(56.0))
IMAGE = np.zeros((3, 4, 3), np.uint8)


def pictures(vehicle, stamps):
    return [Picture(f"{vehicle}/{s:.3f}", vehicle, s, IMAGE, CAMERA, np.eye(4)) for s in stamps]


def recorded(vehicle, axis, references, others):
    return ConfigurationInput(
        Configuration(axis, 4.0), pictures("uav1", references), pictures(vehicle, others)
    )


def session(*configurations, kind="session"):
    return MapInput(kind, list(configurations))


def stamps(given):
    return [[p.stamp_s for p in (*c.references, *c.others)] for c in given.configurations]


@pytest.fixture
def flown():
    """2 m and 4 m at once, uav2 is apart; then 4 m and 8 m, where uav2 is late at first and uav3
    misses a picture."""
    return session(
        recorded("uav2", "horizontal", [10.0, 10.2, 10.4], [10.09, 10.29]),
        recorded("uav3", "vertical", [10.0, 10.2, 10.4], [10.0, 10.2, 10.4]),
        recorded("uav2", "horizontal", [20.0, 20.2, 20.4, 20.6], [20.03, 20.205, 20.41, 20.6]),
        recorded("uav3", "vertical", [20.0, 20.2, 20.4, 20.6], [20.0, 20.21, 20.6]),
    )


def test_configurations_that_were_recorded_together_are_one_group(flown):
    assert [len(g) for g in instants.at_once(flown.configurations)] == [2, 2]


def test_an_instant_has_one_reference_picture_and_the_nearest_of_each(flown):
    found = instants.instants(flown.configurations[2:])
    # of uav2, uav3, uav3 (it missed one), nobody
    assert [round(1e3 * i.skew_s) for i in found] == [30, 10, 190, 0]
    assert {c.references[0].name for c in found[1].configurations} == {"uav1/20.200"}


def test_a_map_of_an_instant_is_of_the_middle_of_the_last_recording_or_of_a_stamp(flown):
    # of two that serve the later
    assert stamps(instants.of_one_instant(flown)) == [[20.6, 20.6], [20.6, 20.6]]
    assert stamps(instants.of_one_instant(flown, 20.0)) == [[20.2, 20.205], [20.2, 20.21]]


def test_cameras_that_are_apart_by_more_are_refused_with_the_figure(flown):
    free = session(*flown.configurations[:2])
    with pytest.raises(InputError, match="90 ms apart, at most 20"):
        instants.of_one_instant(free)
    with pytest.raises(InputError, match="nearest picture is 2.0 s off"):
        instants.of_one_instant(flown, 8.0)
    # that recording has none, though a later one has
    with pytest.raises(InputError, match="90 ms apart"):
        instants.of_one_instant(flown, 10.1)


def test_photographs_have_no_instants(flown):
    photographs = session(*flown.configurations, kind="photographs")
    with pytest.raises(InputError, match="do not say when"):
        instants.of_one_instant(photographs)
    assert instants.skews(photographs) == {}


def test_skew_is_told_of_every_picture(flown):
    told = instants.skews(flown)
    assert told["uav2/10.090"] == pytest.approx(0.09) and told["uav3/20.210"] == pytest.approx(0.01)


def test_a_map_of_all_takes_the_picture_next_to_the_middle_that_has_a_reference_of_its_instant(
    flown,
):
    _, others = choose_pictures(flown.configurations)
    assert [o.stamp_s for o in others] == [10.29, 10.2, 20.41, 20.21]
    apart = recorded("uav2", "horizontal", [1.0, 1.2, 1.4], [1.0, 1.1, 1.3])
    assert choose_pictures([apart])[1][0].stamp_s == 1.0  # 1.1, the middle one, is 100 ms from any


@pytest.mark.parametrize("word", ["first", "nan", "inf"])
def test_an_instant_that_is_none_is_refused_before_anything_is_read(word, tmp_path, capsys):
    assert (
        cli.main([str(tmp_path / "nowhere"), "-o", str(tmp_path / "out"), "--instant", word]) == 2
    )
    assert f"--instant {word}" in capsys.readouterr().err

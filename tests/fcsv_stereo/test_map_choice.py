# SPDX-License-Identifier: Apache-2.0
"""What is mapped when in flight: first looks and whole maps of a mission, instants while
monitoring."""

import numpy as np
import pytest
from support.live_pictures import picture, window

from fcsv_geometry import transforms
from fcsv_stereo.errors import InputError
from fcsv_stereo.in_flight.map_choice import MapKind, MissionMaps, Monitoring, WatchedMaps
from fcsv_stereo.model import ImageEntry

FRAMES = {"uav1": np.eye(4), "uav2": transforms.from_xyz_yaw([1.0, 0.0, 0.0], 0.0)}


def recorded(choice, index, from_s):
    """A configuration, its pictures and its end."""
    for k in range(3):
        choice.on_picture(picture("uav1", from_s + 0.5 * k))
        choice.on_picture(picture("uav2", from_s + 0.5 * k, y_m=-2.0))
    choice.on_window(window(index, from_s, from_s + 1.0, f"number {index}"))


def kinds(choice):
    """What is mapped until it waits."""
    found = []
    while not choice.waits:
        task = choice.next()
        found += [task.kind] if task is not None else []
    return found


def test_a_new_configuration_is_looked_at_first_and_mapped_whole_once_nothing_comes():
    choice = MissionMaps()
    assert choice.waits and choice.next() is None
    choice.on_frames(FRAMES)
    recorded(choice, 0, 10.0)
    task = choice.next()
    assert task.kind is MapKind.FIRST_LOOK and task.names == "number 0" and task.newest_s == 11.0
    assert len(task.given.configurations[0].references) == 1
    recorded(choice, 1, 20.0)
    assert choice.next().kind is MapKind.FIRST_LOOK, (
        "the second comes before the whole of the first"
    )
    whole = choice.next()
    assert whole.kind is MapKind.WHOLE and whole.names == "number 0, number 1"
    assert len(whole.given.configurations[0].references) == 3
    assert choice.waits and choice.next() is None


def test_a_picture_outside_of_every_recording_maps_nothing_again():
    choice = MissionMaps()
    choice.on_frames(FRAMES)
    recorded(choice, 0, 10.0)
    assert kinds(choice) == [MapKind.FIRST_LOOK, MapKind.WHOLE]
    choice.on_picture(picture("uav1", 30.0))
    assert kinds(choice) == []


def test_a_recording_that_is_said_again_is_mapped_again():
    choice = MissionMaps()
    choice.on_frames(FRAMES)
    recorded(choice, 0, 10.0)
    kinds(choice)
    choice.on_window(window(0, 10.0, 10.6, "shorter"))
    assert kinds(choice) == [MapKind.FIRST_LOOK, MapKind.WHOLE]


def test_without_home_it_says_what_is_missing_and_goes_on_once_that_comes():
    choice = MissionMaps()
    recorded(choice, 0, 10.0)
    with pytest.raises(InputError, match="set home"):
        choice.next()
    assert choice.waits, "it is not tried again until something comes"
    choice.on_frames(FRAMES)
    assert kinds(choice) == [MapKind.FIRST_LOOK, MapKind.WHOLE]


def instant(choice, stamp_s, late_s=0.0):
    choice.on_picture(picture("uav1", stamp_s))
    choice.on_picture(picture("uav2", stamp_s + late_s, y_m=-2.0))
    return choice.next()


def learnt(choice, task):
    """As after a map that moved uav2 by 0.1 m."""
    (other,) = task.given.configurations[0].others
    T = transforms.from_xyz_yaw([0.1, 0.0, 0.0], 0.0) @ other.T_home_cam
    entry = ImageEntry(other.name, other.vehicle, other.stamp_s, T, other.T_home_cam, refined=True)
    choice.learn(task, type("Found", (), {"images": [entry]})())


def test_monitoring_takes_the_newest_instant_once():
    choice = Monitoring(["uav1", "uav2"])
    choice.on_frames(FRAMES)
    task = instant(choice, 10.0, 0.01)
    assert task.kind is MapKind.INSTANT and task.newest_s == 10.01
    assert choice.waits and choice.next() is None


def test_monitoring_refines_one_of_so_many_and_corrects_the_others():
    choice = Monitoring(["uav1", "uav2"], refine_every=3)
    choice.on_frames(FRAMES)
    first = instant(choice, 10.0)
    learnt(choice, first)
    tasks = [instant(choice, 11.0 + k) for k in range(3)]
    assert [t.kind for t in tasks] == [
        MapKind.INSTANT_CORRECTED,
        MapKind.INSTANT_CORRECTED,
        MapKind.INSTANT,
    ]
    places = [t.given.configurations[0].others[0].T_home_cam[:3, 3] for t in (first, tasks[0])]
    assert places[1] - places[0] == pytest.approx([0.1, 0.0, 0.0])


def test_a_method_that_refines_no_poses_is_given_none_that_are_corrected():
    choice = Monitoring(["uav1", "uav2"], refine_every=3, refines_poses=False)
    choice.on_frames(FRAMES)
    learnt(choice, instant(choice, 10.0))
    assert instant(choice, 11.0).kind is MapKind.INSTANT


def test_pictures_that_are_never_of_one_instant_are_named_after_a_while():
    choice = Monitoring(["uav1", "uav2"])
    choice.on_frames(FRAMES)
    assert instant(choice, 10.0, 0.2) is None
    assert instant(choice, 12.0, 0.2) is None
    with pytest.raises(InputError, match=r"200 ms apart \(apart_s:=0.02\): trigger the cameras"):
        instant(choice, 14.0, 0.2)


def test_who_watches_maps_first_and_then_takes_the_newest_instants():
    choice = WatchedMaps(Monitoring(["uav1", "uav2"], refines_poses=False))
    choice.on_frames(FRAMES)
    recorded(choice, 0, 10.0)
    assert choice.next().kind is MapKind.FIRST_LOOK
    choice.on_picture(picture("uav1", 20.0))
    choice.on_picture(picture("uav2", 20.0, y_m=-2.0))
    whole = choice.next()
    assert whole.kind is MapKind.WHOLE, "no map is whole yet: nothing is watched"
    choice.learn(whole, None)
    for stamp_s in (21.0, 22.0):
        choice.on_picture(picture("uav1", stamp_s))
        choice.on_picture(picture("uav2", stamp_s, y_m=-2.0))
        task = choice.next()
        assert task.kind is MapKind.INSTANT and task.newest_s == stamp_s
        assert choice.next() is None, "nothing new"
    recorded(choice, 1, 30.0)
    assert choice.next().kind is MapKind.FIRST_LOOK, "a map that is due comes first"

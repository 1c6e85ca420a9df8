# SPDX-License-Identifier: Apache-2.0
"""What every node begins with."""

import threading
import time

import pytest

from fcsv_geometry.ros import node
from fcsv_geometry.ros.health import Health, without_numbers


@pytest.mark.ros
def test_what_is_done_again_and_again_outlives_a_defect(ros_master):
    """rospy's own timer ends at the first exception: a watchdog would be gone without a word."""
    turns, enough = [], threading.Event()

    def work(_event):
        turns.append(len(turns))
        if len(turns) == 1:
            raise ZeroDivisionError("a defect")
        enough.set()

    timer = node.every(0.01, work)
    try:
        assert enough.wait(10.0) and turns[:2] == [0, 1]
    finally:
        timer.shutdown()


@pytest.mark.ros
def test_what_is_done_again_and_again_outlives_simulated_time_that_goes_back(ros_master):
    """A bag that is played again: rospy's own timer ends there, and the node stays without it."""
    from rospy import rostime

    turns, at_s = [], 1000.0
    rostime._set_rostime(rostime.Time.from_sec(at_s))
    timer = node.every(0.1, lambda event: turns.append(event.current_real.to_sec()))
    try:
        for step_s in (0.05,) * 20 + (-50.0,) + (0.05,) * 40:
            at_s += step_s
            rostime._set_rostime(rostime.Time.from_sec(at_s))
            time.sleep(0.01)
        assert timer.is_alive() and max(turns) > 1000.5
        assert len([turn_s for turn_s in turns if turn_s < 960.0]) > 5
    finally:
        rostime.switch_to_wallclock()
        timer.shutdown()


@pytest.mark.ros
def test_a_problem_is_logged_once_while_its_seconds_count_up(ros_master, monkeypatch):
    import rospy

    logged = []
    monkeypatch.setattr(rospy, "logerr", lambda _form, text: logged.append(text))
    health = Health("test")
    for age_s in range(3):
        health.problem("place", f"uav1: no fix for {age_s} s and 0.{age_s} m of its way")
    health.problem("place", "uav2: no fix for 3 s and 0.3 m of its way")
    assert logged == [
        f"uav{k}: no fix for {s} s and 0.{s} m of its way" for k, s in ((1, 0), (2, 3))
    ]
    assert without_numbers("") == ""

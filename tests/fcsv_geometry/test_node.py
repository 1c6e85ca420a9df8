# SPDX-License-Identifier: Apache-2.0
"""What every node begins with."""

import threading

import pytest

from fcsv_geometry.ros import node


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

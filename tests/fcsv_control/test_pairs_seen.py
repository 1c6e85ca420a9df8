# SPDX-License-Identifier: Apache-2.0
"""Pictures of two vehicles show them where both trackers say, or one of the trackers drifts."""

from dataclasses import replace

import numpy as np
import pytest

from fcsv_control.mission.snapshot import VehicleView
from fcsv_control.mission.watches.pairs_seen import PairsSeen, PairsSeenRules

SAID = "pictures of it and uav1 show another place than their trackers: one drifts"


class Told:
    """Three vehicles, and looks at uav2 and uav3 beside uav1."""

    def __init__(self):
        self.now_s, self.pairs = 10.0, PairsSeen()
        self.views = {n: VehicleView() for n in ("uav1", "uav2", "uav3")}
        self.home = {n: np.eye(4) for n in self.views}

    def look(self, off, vehicle="uav2", after_s=0.5):
        self.now_s += after_s
        self.pairs.looked(self.now_s, "uav1", vehicle, off)
        return self.said

    @property
    def said(self):
        judged = self.pairs.check_views(self.views, self.home)
        assert not judged["uav1"].sighted_off and not judged["uav3"].sighted_off
        return judged["uav2"].sighted_off


def test_two_looks_in_a_row_say_it_for_good():
    told = Told()
    assert told.look(True) == ""
    assert told.look(True) == SAID
    assert told.look(False) == SAID and told.look(False, after_s=100.0) == SAID


def test_until_it_is_calibrated_or_home_is_set_anew():
    told = Told()
    told.look(True), told.look(True)
    told.home["uav2"] = np.eye(4) + 1e-9
    assert told.said == ""
    assert told.look(True) == "" and told.look(True) == SAID


@pytest.mark.parametrize(
    "what", ["a look between", "another pair", "long ago", "began anew", "lost", "no home", "gone"]
)
def test_what_says_nothing(what):
    told = Told()
    told.look(True)
    if what == "a look between":
        told.look(False)
    elif what == "began anew":
        told.views["uav1"] = replace(told.views["uav1"], frame_problem="its odometry began anew")
    elif what == "lost":
        told.views["uav2"] = replace(told.views["uav2"], lost=True)
    elif what == "no home":
        told.home.clear()
    elif what == "gone":
        del told.views["uav2"], told.home["uav2"]
        assert told.pairs.check_views(told.views, told.home) == told.views
        return
    vehicle, after_s = (
        ("uav3" if what == "another pair" else "uav2"),
        (10.1 if what == "long ago" else 0.5),
    )
    assert told.look(True, vehicle, after_s) == ""


def test_what_was_seen_while_its_place_was_not_known_does_not_count_later():
    told = Told()
    told.views["uav2"] = replace(told.views["uav2"], lost=True)
    told.look(True), told.look(True)
    told.views["uav2"] = VehicleView()
    assert told.look(True) == ""


def test_what_the_tag_in_front_says_stays():
    told = Told()
    told.views["uav2"] = replace(told.views["uav2"], sighted_off="it does not see uav1")
    told.look(True)
    assert told.look(True) == "it does not see uav1"


@pytest.mark.parametrize("rules", [{"looks": 0}, {"gap_s": -1.0}, {"gap_s": float("nan")}])
def test_bounds_that_are_none_are_refused(rules):
    with pytest.raises(ValueError, match=next(iter(rules))):
        PairsSeenRules(**rules)

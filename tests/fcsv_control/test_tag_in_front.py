# SPDX-License-Identifier: Apache-2.0
"""A vehicle sees the one in front where both trackers say that it is, or one of the trackers
drifts."""

import numpy as np
import pytest

from fcsv_control.mission.snapshot import Snapshot, VehicleView
from fcsv_control.mission.watches import watch
from fcsv_control.mission.watches.pause_timers import Pause
from fcsv_control.mission.watches.tag_in_front import TagInFront, TagInFrontRules
from fcsv_control.mission.watches.telemetry import VehicleTelemetry
from fcsv_geometry import transforms
from fcsv_geometry.errors import MissionError
from fcsv_geometry.missions.mission import Mission, StereoConfiguration
from fcsv_geometry.vehicles.modes import Mode

STEP_S = 0.1
T_BODY_TAG = transforms.from_xyz_yaw([-0.1, 0.0, 0.05], np.pi)
T_HOME_ODOM = {
    "uav1": transforms.from_xyz_yaw([1.0, 2.0, 0.0], 0.7),
    "uav2": transforms.from_xyz_yaw([5.0, 0.0, 1.0], 2.0),
}
T_HOME_BODY = {"uav1": np.eye(4), "uav2": transforms.from_xyz_yaw([-3.5, 0.1, 0.0], 0.05)}


class Column:
    """Two vehicles, heard ten times a second; ``drift_m`` (3,; home): by how much each tracker is
    wrong."""

    def __init__(self):
        self.now_s, self.speed_mps, self.sees, self.drift_m = (
            50.0,
            {"uav1": 0.1, "uav2": 0.1},
            True,
            {},
        )
        self.home, self.tag_in_front = dict(T_HOME_ODOM), TagInFront()
        self.heard = {n: VehicleTelemetry(np.eye(4), T_body_tag=T_BODY_TAG) for n in T_HOME_ODOM}

    def _told(self, name):
        T_home_body = T_HOME_BODY[name].copy()
        T_home_body[:3, 3] += self.drift_m.get(name, 0.0)
        return transforms.invert(T_HOME_ODOM[name]) @ T_home_body

    def run(self, seconds):
        """What is said at the end."""
        for _ in range(int(round(seconds / STEP_S))):
            self.now_s += STEP_S
            for name, heard in self.heard.items():
                heard.odometry(self.now_s, self._told(name), (self.speed_mps[name], 0.0, 0.0))
                heard.state(self.now_s, Mode.GUIDED, True, True)
            if self.sees:
                T_uav2_uav1 = transforms.invert(T_HOME_BODY["uav2"]) @ T_HOME_BODY["uav1"]
                self.heard["uav2"].front_tag(
                    self.now_s, (self._told("uav2") @ T_uav2_uav1 @ T_BODY_TAG)[:3, 3]
                )
            views = {n: h.view(self.now_s, self.home.get(n)) for n, h in self.heard.items()}
            self.views = self.tag_in_front.check_views(self.now_s, views, self.home)
        assert not self.views["uav1"].sighted_off, "nobody is in front of the first"
        return self.views["uav2"].sighted_off


def test_who_is_seen_where_the_trackers_say_is_right():
    assert Column().run(20.0) == ""


@pytest.mark.parametrize("who", ["uav1", "uav2"])
def test_a_drift_of_either_is_said_within_a_second_and_stays(who):
    column = Column()
    column.run(1.0)
    column.drift_m[who] = np.array([0.3, 0.5, -0.1])
    assert column.run(0.4) == ""
    assert column.run(0.6) == "it does not see uav1 where their trackers say: one of them drifts"
    column.sees = False
    assert column.run(30.0), "the tag goes out of view as it drifts"


def test_until_both_are_calibrated_anew():
    column = Column()
    column.drift_m["uav2"] = np.array([0.0, 0.7, 0.0])
    assert column.run(1.0)
    column.drift_m.clear()
    column.home["uav2"] = T_HOME_ODOM["uav2"] + 1e-9
    assert column.run(1.0) == ""


@pytest.mark.parametrize(
    "what", ["a little", "unseen", "flies", "lost", "began anew", "no home", "for a moment"]
)
def test_what_says_nothing(what):
    column = Column()
    column.run(1.0)
    column.drift_m["uav2"] = (
        np.array([0.3, 0.0, 0.0]) if what == "a little" else np.array([0.0, 2.0, 0.0])
    )
    if what == "unseen":
        column.sees = False
    elif what == "flies":
        column.speed_mps["uav1"] = 1.0
    elif what == "lost":
        column.heard["uav2"].guardian(column.now_s, "LAND", True)
    elif what == "began anew":
        column.heard["uav2"].epochs.now, column.heard["uav2"].epochs.calibration = 2, 1
    elif what == "no home":
        column.home.clear()
    elif what == "for a moment":
        assert column.run(0.4) == ""
        column.drift_m.clear()
    assert column.run(3.0) == ""


def test_a_bound_that_is_none_is_refused():
    with pytest.raises(ValueError, match="off_m"):
        TagInFrontRules(off_m=0.0)


def test_a_mission_that_flies_lands_everybody_and_one_that_is_set_up_waits():
    mission = Mission("m", [StereoConfiguration("horizontal", 2.0)])
    view = VehicleView(
        pose_age_s=0.1,
        state_age_s=0.1,
        connected=True,
        armed=True,
        battery_share=0.9,
        recorder_age_s=0.1,
        sighted_off="it does not see uav1",
    )
    snapshot = Snapshot(0.0, {"uav2": view})
    for phase in ("GUIDED", "CONFIGURATIONS"):
        with pytest.raises(MissionError, match="uav2: it does not see uav1: landing everybody"):
            watch.require_flyable(mission, phase, snapshot)
    watch.require_flyable(mission, "SET_HOME", snapshot)
    assert watch.found(mission, "SET_HOME", snapshot) == [
        (Pause.LOST, "uav2: it does not see uav1; land by hand, or calibrate anew")
    ]
    assert not watch.found(mission, "TAKE_OFF", snapshot)

# SPDX-License-Identifier: Apache-2.0
"""playback.launch: what it starts for a session, with and without the operator's window."""

import shlex

import pytest

pytest.importorskip("roslaunch")

from support.launched import launched


@pytest.fixture
def played(root):
    """played(*arguments) -> nodes by name."""

    def load(*arguments):
        found = launched(root / "launch/playback.launch", "session:=/s", *arguments)
        assert "error" not in found, found
        assert found["params"]["/use_sim_time"] is True
        return found["nodes"]

    return load


def test_the_window_opens_where_there_is_a_screen(played, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":7")
    nodes = played()
    assert nodes["/console"]["type"] == "fcsv_console/console" and not nodes["/console"]["respawn"]
    monkeypatch.delenv("DISPLAY")
    assert "/console" not in played() and "/console" in played("console:=true")


def test_it_shows_the_session_s_vehicles_and_the_pictures_that_they_recorded(played, root):
    """Its own parser takes what the launch file says; without a mission file it shows the one that
    was recorded."""
    from fcsv_console.ros.window_command import parser

    given = shlex.split(
        played("vehicles:=uav1,uav3", "vehicles_dir:=/v", "console:=true")["/console"]["args"]
    )
    found = parser().parse_args(given)
    assert (found.vehicles, found.vehicles_dir, found.recorded, found.mission) == (
        "uav1,uav3",
        "/v",
        True,
        "",
    )
    given = shlex.split(played("mission:=/m/a.yaml", "console:=true")["/console"]["args"])
    assert parser().parse_args(given).mission == "/m/a.yaml"


def test_every_vehicle_s_bag_is_played_beside_the_control_pc_s(played):
    words = played("vehicles:=uav1,uav2,uav3", "console:=false")["/play"]["args"].split()
    assert (
        words[-4:] == ["/s/control.bag", "/s/uav1.bag", "/s/uav2.bag", "/s/uav3.bag"]
        and "--clock" in words
    )

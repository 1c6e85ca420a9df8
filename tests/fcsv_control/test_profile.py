# SPDX-License-Identifier: Apache-2.0
"""Parameter profiles, and parameter files of ground stations."""

import doctest

import pytest
from support.autopilots import MUST, PROFILE, PROFILE_FILE

from fcsv_control.errors import ProfileError
from fcsv_control.flight.settings import parameter_files, profile
from fcsv_control.flight.settings.profile import Choice, load_profile, parse_profile
from fcsv_geometry.missions.flight_limits import FlightBounds
from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.autopilot.parameters import DEFAULTS

ENOUGH = "#: must 2 or 3: poses come by MAVLink\nVISO_TYPE,2\n"


def test_doctests():
    for module in (profile, parameter_files):
        result = doctest.testmod(module)
        assert result.attempted and not result.failed


def test_the_profile_says_what_the_filter_flies_on_and_what_the_failsafes_do():
    assert {"VISO_TYPE", "EK3_SRC1_POSXY", "EK3_SRC1_YAW", "FS_EKF_ACTION"} <= set(MUST)
    assert all(len(rule.why) > 5 for rule in PROFILE)
    assert PROFILE.rule("BATT_LOW_VOLT").value is None and "BATT_LOW_VOLT" not in PROFILE.values


@pytest.mark.parametrize(
    "name, lands, homing, else_wrong",
    [
        ("FS_THR_ENABLE", (3, 7), (1, 4, 5, 6), (0,)),
        ("FS_GCS_ENABLE", (0, 5, 7), (1, 3, 4, 6), ()),
        ("FS_DR_ENABLE", (0, 1), (2, 3, 4, 6), ()),
        ("BATT_FS_LOW_ACT", (1, 7), (2, 3, 4, 6), (0, 5)),
        ("BATT_FS_CRT_ACT", (1, 7), (2, 3, 4, 6), (0, 5)),
        ("FENCE_ACTION", (2, 4), (1, 3, 5), (0,)),
        ("FENCE_ENABLE", (1,), (), (0,)),
        ("FENCE_TYPE", (3, 7), (), (0, 1, 2, 4)),
        ("BATT_MONITOR", (3, 4, 7), (), (0,)),
        ("FS_OPTIONS", (0, 16, 8), (), (4, 20)),
    ],
)
def test_a_failsafe_that_flies_home_or_is_off_must_be_otherwise(name, lands, homing, else_wrong):
    """Values as ArduCopter 4.6.2 has them; who flies home (RTL) climbs and flies through the
    others."""
    rule = PROFILE.rule(name)
    assert rule.must and not any(rule.complaint(value) for value in lands)
    assert all(rule.complaint(value) for value in (*homing, *else_wrong))
    why = rule.why if name != "BATT_FS_CRT_ACT" else PROFILE.rule("BATT_FS_LOW_ACT").why
    assert not homing or Mode.RTL in why or "fly home" in why


def test_autopilots_fly_as_fast_as_ways_of_missions_are_timed():
    wanted = FlightBounds().autopilot_parameters
    assert {name: PROFILE.values[name] for name in wanted} == wanted
    # ArduCopter's default
    assert "WPNAV_SPEED is 500" in PROFILE.rule("WPNAV_SPEED").complaint(500.0)


@pytest.mark.parametrize("port", [0, 1, 2])
def test_the_stream_rates_are_those_of_the_port_that_the_companion_is_at(port):
    """A telemetry radio at another port needs its own rates."""
    names = {rule.name for rule in PROFILE.at_port(port)}
    assert {name[:4] for name in names if name.startswith("SR") and name[3] == "_"} == {
        f"SR{port}_"
    }
    assert f"SR{port}_EXTRA1 is 10" in PROFILE.at_port(port).rule(f"SR{port}_EXTRA1").complaint(
        10.0
    )
    assert len(names) == len(PROFILE.rules) and PROFILE.at_port(port).rule(
        "VISO_TYPE"
    ) == PROFILE.rule("VISO_TYPE")


def test_a_ground_station_loads_the_profile_as_it_is():
    assert parameter_files.read(PROFILE_FILE) == PROFILE.values


def test_the_simulated_autopilot_has_the_profiles_parameters_and_they_fit():
    assert [
        rule.complaint(DEFAULTS[rule.name][0])
        for rule in PROFILE
        if rule.complaint(DEFAULTS[rule.name][0])
    ] == []


@pytest.mark.parametrize(
    "text, said",
    [
        ("VISO_TYPE,2\n", "line 1: VISO_TYPE has no rule before it"),
        ("#: must 3: why\nVISO_TYPE,2\n", "line 2: VISO_TYPE 2 is not 3, as its own rule has it"),
        ("#: must: why\n#: must: why\nVISO_TYPE,2\n", "line 2: the rule before has no parameter"),
        (ENOUGH + "#: must: why\n", "ends with a rule without a parameter"),
        (ENOUGH + ENOUGH, "VISO_TYPE stands there twice"),
        ("#: should 2: why\nVISO_TYPE,2\n", "is no rule"),
        ("#: must two: why\nVISO_TYPE,2\n", "is no rule"),
        ("#: must 2:\nVISO_TYPE,2\n", "is no rule"),
        ("#: by hand BATT_LOW_VOLT: why\n", "is no rule"),
        ("#: must: why\nVISO_TYPE,two\n", "line 2: 'VISO_TYPE,two' is not NAME,VALUE"),
        ("# nothing\n", "has no rules"),
    ],
)
def test_a_profile_that_is_wrong_is_refused_with_file_and_line(text, said):
    with pytest.raises(ProfileError) as raised:
        parse_profile(text, "my.param")
    assert str(raised.value).startswith("my.param") and said in str(raised.value)


def test_a_profile_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(ProfileError, match="none.param: cannot be read"):
        load_profile(tmp_path / "none.param")
    (tmp_path / "odd.param").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ProfileError, match="odd.param: cannot be read"):
        load_profile(tmp_path / "odd.param")


def test_choices():
    assert not Choice.parsed("2 or 3").fits(float("nan")) and not Choice.parsed("..").fits(
        float("inf")
    )
    assert str(Choice.parsed("0.1..1")) == "0.1..1" and str(Choice.parsed("1..")) == "1.."
    assert Choice.parsed("0.8").fits(0.800000011920929)  # as a float32 brings it


# ---- ground stations' files ----------------------------------------------------------------------

PARAMETERS = {
    "VISO_TYPE": (2.0, 2),
    "VISO_YAW_M_NSE": (0.20000000298023224, 9),
    "STAT_RUNTIME": (123456789.0, 6),
}


def test_what_is_saved_is_read_again_in_both_forms(tmp_path):
    expected = {name: pytest.approx(value, rel=1e-7) for name, (value, _) in PARAMETERS.items()}
    for text in (
        parameter_files.mission_planner(PARAMETERS),
        parameter_files.qgroundcontrol(PARAMETERS, 1),
    ):
        # as Windows saves it
        (tmp_path / "saved.param").write_text("\ufeff" + text.replace("\n", "\r\n"))
        assert parameter_files.read(tmp_path / "saved.param") == expected


def test_a_table_of_several_vehicles_is_refused_and_other_components_are_passed_over():
    camera = "1\t100\tCAM_MODE\t1\t9\n"
    assert parameter_files.values_of("1\t1\tVISO_TYPE\t2\t2\n" + camera, "f") == {"VISO_TYPE": 2.0}
    with pytest.raises(ProfileError, match="several vehicles"):
        parameter_files.values_of("1\t1\tVISO_TYPE\t2\t2\n2\t1\tVISO_TYPE\t2\t2\n", "f")


@pytest.mark.parametrize(
    "line",
    ["VISO_TYPE", "VISO_TYPE,2,3", "VISO_TYPE,nan", "viso,2", "x\t1\tVISO_TYPE\t2\t2", "<html>"],
)
def test_a_line_that_is_none_is_named(line):
    with pytest.raises(ProfileError, match="f, line 2"):
        parameter_files.values_of(f"EK3_ENABLE,1\n{line}\n", "f")


def test_a_parameter_with_two_values_is_refused():
    with pytest.raises(ProfileError, match="line 2: EK3_ENABLE stands there twice, as 1 and 0"):
        parameter_files.values_of("EK3_ENABLE,1\nEK3_ENABLE,0\n", "f")

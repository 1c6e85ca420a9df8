# SPDX-License-Identifier: Apache-2.0
"""The search for flights in which vehicles come near to each other."""

import numpy as np
import pytest

from fcsv_geometry.missions.mission import Mission, StereoConfiguration, load_mission
from fcsv_sim.bringup import mission_file
from fcsv_sim.errors import SimulationError
from fcsv_sim.rehearsal.command import Job, main, rehearse
from fcsv_sim.rehearsal.draws import from_text
from fcsv_sim.rehearsal.search import Found, found_in, search, table

KINDS = ("radio cut", "abort", "battery")


class Valley:
    """Stands in for flights: nearest where the first draw of the first fault is 0.7."""

    def __init__(self):
        self.flown = []

    def fly(self, varied):
        self.flown += varied
        return [
            Found(abs(v.draws[0][0] - 0.7), ("contact",) if "abort" in v.faults else ())
            for v in varied
        ]


def test_a_search_goes_where_vehicles_come_near_and_flies_one_or_two_faults():
    valley = Valley()
    found = search(KINDS, 240, 1, valley.fly)
    early, late = (
        [abs(v.draws[0][0] - 0.7) for v in part] for part in (valley.flown[:24], valley.flown[-24:])
    )
    assert np.median(late) < 0.5 * np.median(early) and len(found) <= 240
    assert {len(v.draws) for v in found} == {1, 2}
    assert all(len(v.draws) == v.faults.count("+") + 1 for v in found)


def test_a_search_that_was_stopped_goes_on_and_ends_as_one_that_was_not(tmp_path):
    log, whole = tmp_path / "search.jsonl", search(KINDS, 96, 3, Valley().fly)
    search(KINDS, 48, 3, Valley().fly, log)
    rest = Valley()
    assert search(KINDS, 96, 3, rest.fly, log) == whole and 0 < len(rest.flown) <= 48
    again = Valley()
    assert search(KINDS, 96, 3, again.fly, log) == whole and not again.flown


def test_its_table_shows_the_worst_of_each_pair_and_how_to_see_it():
    found = search(KINDS, 48, 1, Valley().fly)
    lines = table(found, 1, 3)
    assert len(lines) == 5 and len({line.split("|")[2] for line in lines[2:]}) == 3
    nearest = [float(line.split("|")[1]) for line in lines[2:]]
    assert nearest == sorted(nearest) and "--seed 1 --faults '" in lines[2]


def test_it_says_what_is_wrong(tmp_path, capsys):
    with pytest.raises(SimulationError, match="4 flights are too few, 5 at least"):
        search(KINDS, 4, 1, Valley().fly)
    log = tmp_path / "no.jsonl"
    log.write_text("what")
    with pytest.raises(SimulationError, match="is no log of a search"):
        search(KINDS, 5, 1, Valley().fly, log)
    assert main(["short", "--faults", "abort", "--draws", "0.5 2"]) == 2
    assert "numbers from 0 to 1" in capsys.readouterr().err
    for faults in ("none", "abort,battery", "abort+battery"):
        assert main(["short", "--faults", faults, "--draws", "0.5 0.2"]) == 2
        assert "numbers of 1, but --faults names" in capsys.readouterr().err
    assert found_in(float("inf"), ["fence", "fence"]) == Found(99.0, ("fence",))


def test_chosen_draws_say_when_and_whom_a_fault_befalls():
    mission = Mission("drawn", [StereoConfiguration("horizontal", 2.0, record_s=1.0)])
    # any phase, the first (take-off); half of it; the second vehicle; for good
    job = Job(mission, 2, 4, "radio cut", 12.0, from_text("0.9 0 0.5 0.9 0.9 0 0.1"))
    befallen = []

    def watched(flight):
        flight.recorder = lambda f: befallen.append([n for n, r in f.radios.items() if r.cut])

    result = rehearse(job, watched)
    assert result.began == ["radio cut"] and befallen[-1] == ["uav2"]


@pytest.mark.slow
def test_a_land_that_comes_with_the_radio_goes_aside_of_who_lies_beneath():
    """The search's find: without radio it flew its leg on, to above the one that landed."""
    draws = (
        "0.198 0.648 0.006 0.482 0.401 0.853 0.241 0.15,"
        "0.483 0.734 0.926 0.83 0.204 0.771 0.847 0.359"
    )
    mission = load_mission(mission_file("short"))
    result = rehearse(Job(mission, 2, 7, "battery+radio cut", draws=from_text(draws)))
    assert result.began == ["battery", "radio cut"] and result.violations == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "faults, draws",
    [
        (  # an autopilot began anew and landed while the radio held its poses back
            "autopilot reboots+radio holds up",
            "0.318 0.563 0.527 0.804 0.507 0.917 0.72 0.266,"
            "0.672 0.043 0.598 0.77 0.885 0.266 0.08 0.324",
        ),
        (  # the radio brought GUIDED after a pilot had taken over
            "pilot disobeys+radio holds up",
            "0.586 0.699 0.341 0.765 0.745 0.832 0.175 0.198,"
            "0.801 0.723 0.012 0.925 0.202 0.212 0.065 0.876",
        ),
    ],
)
def test_what_a_radio_holds_up_is_neither_recorded_nor_obeyed(faults, draws):
    """Finds of the search."""
    mission = load_mission(mission_file("short"))
    result = rehearse(Job(mission, 2, 11, faults, draws=from_text(draws)))
    assert sorted(result.began) == faults.split("+") and result.violations == []


@pytest.mark.slow
def test_a_few_flights_are_searched_by_the_command(tmp_path, capsys):
    log = tmp_path / "search.jsonl"
    args = ["short", "--search", "5", "--seed", "3", "--longest", "25", "--log", str(log)]
    status = main([*args, "--faults", "radio cut,abort"])
    told = capsys.readouterr().out
    assert "5 flights, 5 of them broke" in told and status == 1  # none ended within 25 s
    assert len(log.read_text().splitlines()) == 5

# SPDX-License-Identifier: Apache-2.0
"""Whole flights without ROS: that they go as real ones do, that faults are felt, and that a seed gives one flight."""

import numpy as np
import pytest

from fcsv_geometry.mission import Mission, StereoConfiguration
from fcsv_sim.rehearsal.command import Job, main, rehearse, table
from fcsv_sim.rehearsal.faults import FAULTS
from fcsv_sim.rehearsal.flight import Flight
from fcsv_sim.rehearsal.radio import Radio, RadioQuality


@pytest.fixture(scope="module")
def mission():
    listed = [("horizontal", 2.0), ("vertical", 5.0)]
    return Mission("rehearsed", [StereoConfiguration(a, b, record_s=2.0) for a, b in listed])


@pytest.mark.parametrize("vehicles", [2, 3])
def test_a_flight_without_faults_records_all_and_lands(mission, vehicles):
    result = Flight(mission, vehicles, 2).run()
    assert (result.phase, result.captures, result.violations) == ("DONE", 2, [])
    assert result.nearest_m > 1.4 and 60.0 < result.flown_s < 200.0


def test_the_same_seed_gives_the_same_flight(mission):
    one, two = (rehearse(Job(mission, 2, 5, "radio cut")) for _ in range(2))
    assert one == two
    assert rehearse(Job(mission, 2, 6, "radio cut")) != one


@pytest.mark.parametrize("fault", ["tracker gone", "radio cut", "clock steps", "abort", "battery"])
def test_what_is_handled_ends_with_everybody_down(mission, fault):
    result = rehearse(Job(mission, 2, 1, fault))
    assert not [v for v in result.violations if v.kind in ("contact", "no end")], result


def test_every_fault_begins(mission):
    for name, make in FAULTS.items():
        flight = Flight(mission, 2, 2)
        fault = make(np.random.default_rng(1))
        fault._after_s = 1.0
        while flight.now_s < 60.0 and fault.began_s is None:
            fault(flight)
            flight.step()
        assert fault.began_s is not None, name


def test_a_radio_delays_loses_and_keeps_order_of_arrival():
    got = []
    radio = Radio(RadioQuality(delay_s=0.1, jitter_s=0.0, loss=0.0), 1)
    for k in range(3):
        radio.send(0.01 * k, got.append, k)
    radio.step(0.105)
    assert got == [0]
    radio.cut = True
    radio.send(0.2, got.append, 9)
    radio.cut = False
    radio.step(9.0)
    assert got == [0, 1, 2]
    lossy = Radio(RadioQuality(loss=0.3), 1)
    for _ in range(1000):
        lossy.send(0.0, got.append, None)
    lossy.step(9.0)
    assert len(got) - 3 == pytest.approx(700, abs=60)


def test_the_command_says_what_is_wrong(tmp_path, capsys):
    assert main([str(tmp_path / "none.yaml")]) == 2
    assert "no mission" in capsys.readouterr().err
    path = tmp_path / "m.yaml"
    path.write_text("name: m\nconfigurations: [{axis: horizontal, baseline_m: 2.0}]")
    assert main([str(path), "--faults", "meteorite"]) == 2
    assert "'meteorite' is not one of tracker gone" in capsys.readouterr().err
    assert main([str(path), "--vehicles", "1"]) == 2


def test_the_table_has_a_line_for_each_fault(mission):
    jobs = [Job(mission, 2, 1, "none"), Job(mission, 2, 1, "abort")]
    lines = table([(job, rehearse(job)) for job in jobs])
    assert [line.split(" | ")[0] for line in lines[2:]] == ["| none", "| abort"]

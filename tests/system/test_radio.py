# SPDX-License-Identifier: Apache-2.0
"""A whole mission whose machines hear each other only over a radio that loses packets and vanishes for ten seconds."""

import json
import os
import subprocess

import pytest

from fcsv_sim.machines.slow_motion import slow_motion

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(1800)]


def test_a_mission_over_a_bad_radio_ends_with_the_same_map(flown, bench_link, tmp_path, root):
    import flight

    from fcsv_sim.demo.fleet import FleetPlan

    _, radio = bench_link
    plan = FleetPlan(tmp_path, root / "config" / "missions" / "short.yaml", seed=1)
    with slow_motion() as page:
        conditions = radio.Conditions(loss=0.05, delay_s=0.01)
        lines = flight.fly(plan, conditions, 10.0, "CONFIGURATIONS 2/4", clock=page.now_s)
    assert any(line.startswith("CONFIGURATIONS 2/4") and "check the radio" in line for line in lines), lines
    assert sum(line.startswith("captured") for line in lines) == 4
    clean = json.loads((flown / "map" / "report.json").read_text())["truth"]
    bad = flight.make_map(plan)["truth"]
    assert bad["within_10_percent"] == pytest.approx(clean["within_10_percent"], abs=0.05)
    assert bad["coverage"] == pytest.approx(clean["coverage"], abs=0.05)
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert f"-{os.getpid()}\n" not in left

# SPDX-License-Identifier: Apache-2.0
"""A whole mission whose machines hear each other only over a radio that loses packets and vanishes
for a while."""

import json
import os
import subprocess

import numpy as np
import pytest

from fcsv_sim.machines.slow_motion import slow_motion
from fcsv_sim.truth import TruthReader

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(1800)]

# For a vehicle a radio that carries nothing is a control PC that died, and every other vehicle with
# it. It gets to its last set-point in twelve seconds; a lost pose feed would have landed it by then
# (failsafe after 8 s).
CUT_S, ARRIVED_S, HELD_S = 18.0, 12.0, 5.0


class Holding:
    """Where each vehicle was once it had arrived, and ``HELD_S`` later."""

    def __init__(self, folder, names):
        self._readers = {n: TruthReader(folder, n) for n in names}
        self.before, self.after = {}, {}

    def __call__(self, since_s):
        for places, from_s in ((self.before, ARRIVED_S), (self.after, ARRIVED_S + HELD_S)):
            if since_s >= from_s and not places:
                places.update({n: r.latest()[1][:3, 3].copy() for n, r in self._readers.items()})


@pytest.fixture(scope="module")
def radio_flight(bench_link, tmp_path_factory, root):
    """(plan, what the mission said, Holding) of a mission whose radio is dead for a while."""
    import flight

    from fcsv_sim.demo.fleet import FleetPlan

    _, radio = bench_link
    plan = FleetPlan(
        tmp_path_factory.mktemp("radio"),
        root / "config" / "missions" / "short.yaml",
        seed=1,
        ready_s=2.0,
    )
    holding = Holding(plan.sim_folder, plan.vehicles)
    with slow_motion() as page:
        lines = flight.fly(
            plan,
            radio.Conditions(loss=0.05, delay_s=0.01),
            CUT_S,
            "CONFIGURATIONS 2/4",
            clock=page.now_s,
            during_cut=holding,
        )
    return plan, lines, holding


def test_a_mission_over_a_bad_radio_ends_with_the_same_map(flown, radio_flight):
    import flight

    plan, lines, _ = radio_flight
    assert any(
        line.startswith("CONFIGURATIONS 2/4") and "check the radio" in line for line in lines
    ), lines
    assert sum(line.startswith("captured") for line in lines) == 4
    clean = json.loads((flown / "map" / "report.json").read_text())["truth"]
    bad = flight.make_map(plan)["truth"]
    assert bad["within_10_percent"] == pytest.approx(clean["within_10_percent"], abs=0.05)
    assert bad["coverage"] == pytest.approx(clean["coverage"], abs=0.05)
    left = subprocess.run(
        ["ip", "netns", "list"], capture_output=True, text=True, check=True
    ).stdout
    assert f"-{os.getpid()}\n" not in left


def test_vehicles_hold_while_the_control_pc_is_gone(radio_flight):
    """Every vehicle keeps its pose feed and holds: nothing on its flight path runs on another
    machine."""
    _, _, holding = radio_flight
    assert set(holding.after) == {"uav1", "uav2"}
    for vehicle, after in holding.after.items():
        assert after[2] > 3.0, f"{vehicle} came down"
        # gusts: holds stay within 0.3 m of the set-point, at either moment
        assert np.linalg.norm(after - holding.before[vehicle]) < 0.6, f"{vehicle} wandered"

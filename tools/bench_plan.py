#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long the mission's step takes while ways of several vehicles at once are planned in slices.

    python tools/bench_plan.py [--vehicles 2 3 4 5] [--plans 40]

Draws places at which vehicles stand and places where they shall be, plans the ways as the mission does, and prints per
number of vehicles the processor time of one step (its slices together) and how long everybody waits for the plan.
"""

import argparse
import time
from itertools import combinations

import numpy as np

from fcsv_control.mission import traffic
from fcsv_control.mission.convoy import SLICES
from fcsv_control.mission.routes import Keep
from fcsv_geometry.errors import MissionError
from fcsv_geometry.flight_limits import FlightBounds
from fcsv_geometry.separation import SeparationRules

KEEP = Keep(1.5, SeparationRules(0.95))
STEP_S = 0.1  # of the mission
HALF_M = np.array([10.0, 10.0, 5.0])  # of the box in which places are drawn


def main() -> int:
    """Print the table; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, nargs="+", default=[2, 3, 4, 5])
    parser.add_argument("--plans", type=int, default=40, help="of each number of vehicles")
    arguments = parser.parse_args()
    print("| vehicles | plans | step (ms): median, 95 %, longest | steps: median, most | waits (s): median, longest |")
    print("| --- | --- | --- | --- | --- |")
    for vehicles in arguments.vehicles:
        print(row(vehicles, arguments.plans, np.random.default_rng([vehicles, 31])), flush=True)
    return 0


def row(vehicles: int, plans: int, random: np.random.Generator) -> str:
    """Of the table."""
    steps_ms, steps = [], []
    for _ in range(plans):
        took_ms = planned_ms(drawn(vehicles, random), drawn(vehicles, random))
        steps_ms += took_ms
        steps.append(len(took_ms))
    median_ms, most_ms = np.percentile(steps_ms, [50, 95])
    return (
        f"| {vehicles} | {plans} | {median_ms:.1f}, {most_ms:.1f}, {max(steps_ms):.1f} | {np.median(steps):.0f}, "
        f"{max(steps)} | {STEP_S * np.median(steps):.1f}, {STEP_S * max(steps):.1f} |"
    )


def planned_ms(starts, goals):
    """Processor time (ms) of each step until there is a plan, or none can be."""
    planning, took_ms, made = traffic.plan(starts, goals, [], KEEP, FlightBounds()), [], None
    while made is None:
        begun_s = time.process_time()
        try:
            made = planning.step(SLICES)
        except MissionError as error:
            made = error
        took_ms.append(1e3 * (time.process_time() - begun_s))
    return took_ms


def drawn(vehicles: int, random: np.random.Generator):
    """Places (3,) by vehicle that keep what is to be kept."""
    while True:
        places = {f"uav{k + 1}": random.uniform(-HALF_M, HALF_M) for k in range(vehicles)}
        if all(KEEP.share(places[a] - places[b]) >= 1.0 for a, b in combinations(places, 2)):
            return places


if __name__ == "__main__":
    raise SystemExit(main())

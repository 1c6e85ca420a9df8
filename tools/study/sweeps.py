# SPDX-License-Identifier: Apache-2.0
"""A sweep against stops (7.2): what tools/bench_sweep.py measures, as a section of the study."""

import sys
from pathlib import Path

from page import Page

sys.path.append(str(Path(__file__).resolve().parents[1]))

import bench_sweep

_MISSIONS, _SEED, _OFFSET_S = ("sweep", "short", "simulated_400m"), 1, 0.005


def sweeps(page: Page) -> None:
    """One rehearsed flight of each list, cameras 5 ms early."""
    page.text(
        "## Sweep against stops (7.2)",
        "Movement instead of stops: one rehearsed flight each (airframes with vibration, drift of the tracker, "
        "errors of calibration and home, the cameras' stamps 5 ms early), mapped by `joint`. *To the map*: from "
        "the first set-point to the last picture by the flight's clock, and the map's processor time. The thesis "
        "took 106 s (7.1). More seeds: [sweep.md](sweep.md).",
    )
    page.table(
        bench_sweep.HEAD, [bench_sweep.measure(name, _SEED, _OFFSET_S) for name in _MISSIONS]
    )

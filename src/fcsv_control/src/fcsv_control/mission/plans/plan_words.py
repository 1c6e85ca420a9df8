# SPDX-License-Identifier: Apache-2.0
"""A plan in words: when each station is flown, and how far the batteries reach."""

import math
from typing import Sequence

from fcsv_control.mission.plans.plan_check import PlannedView, fly_on_paper, on_the_ground, reached
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.programs.durations import clock_words


def stations_in_words(mission: Mission, vehicles: Sequence[str]) -> str:
    """When, from the beginning of the list, each station is flown with full batteries, and after
    which to come back; "" for a mission without stations."""
    if not mission.stations:
        return ""
    situation = on_the_ground(mission, vehicles, {})
    flight = fly_on_paper(mission, situation)
    words = [
        f"{mission.viewpoints[v.view].title} {clock_words(v.begins_s)} to {clock_words(v.ends_s)}"
        + _above(mission, v)
        for v in flight.views
    ]
    end = "landing" if mission.lands_there(-1) else "home"
    words.append(f"{end} {clock_words(flight.flight_s)}")
    within = reached(mission, situation, flight)
    if 0 < len(within) < len(flight.views):
        last = mission.viewpoints[within[-1].view].title
        words.append(f"full batteries reach to {last}: the rest is another flight's")
    if mission.ground is None:
        words.append("height above the ground not known (no terrain)")
    return ", ".join(words)


def _above(mission: Mission, view: PlannedView) -> str:
    """How high the way there is above the ground."""
    if mission.ground is None:
        return ""
    if math.isnan(view.above_m):
        return " (ground not known)"
    return f" ({view.above_m:.1f} m above ground{'' if view.above_all else ', partly not known'})"

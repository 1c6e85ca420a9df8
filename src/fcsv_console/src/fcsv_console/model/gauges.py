# SPDX-License-Identifier: Apache-2.0
"""How far each vehicle's camera is from where it should stand, seen from above (thesis 5.3, figure
5.6)."""

from dataclasses import dataclass
from typing import Dict, Tuple

from fcsv_console.model.view import ConsoleView

REACH_M = 0.5  # the end of a gauge


@dataclass(frozen=True)
class Gauge:
    """Shows how far off the place is of the vehicle with that ``number`` in the column: too far
    forward along home's x and left along its y (m)."""

    name: str
    number: int
    forward_m: float
    left_m: float

    @property
    def words(self) -> str:
        """
        >>> Gauge("uav2", 1, -0.031, -0.12).words
        'uav2 is 3 cm back and 12 cm right of its place'
        """
        along, across = ("forward", "back")[self.forward_m < 0], ("left", "right")[self.left_m < 0]
        away = f"{abs(self.forward_m) * 100:.0f} cm {along} and {abs(self.left_m) * 100:.0f} cm {across}"
        return f"{self.name} is {away} of its place"

    @property
    def shares(self) -> Tuple[float, float]:
        """Forward and left as shares -1..1 of the gauge.

        >>> Gauge("uav2", 1, -0.25, 3.0).shares
        (-0.5, 1.0)
        """
        return tuple(max(-1.0, min(1.0, m / REACH_M)) for m in (self.forward_m, self.left_m))


def gauges(view: ConsoleView) -> Tuple[Gauge, ...]:
    """Gives the gauges of the reference and who moves, while a configuration to stand at is flown
    and their places are known."""
    mission, running = view.file.mission, view.running
    if mission is None or running is None:
        return ()
    names = [v.name for v in view.vehicles]
    goals: Dict[str, Tuple[float, float]] = {mission.reference: (0.0, 0.0)}
    for index in mission.moment_of(running) if len(names) > 1 else ():
        row = view.file.rows[index]
        if row.way_m is None:
            goals[mission.mover(index, names)] = row.goal_m[:2]
    return tuple(
        Gauge(
            v.name,
            k,
            v.place.value.p_home_m[0] - goals[v.name][0],
            v.place.value.p_home_m[1] - goals[v.name][1],
        )
        for k, v in enumerate(view.vehicles)
        if v.name in goals and v.place.value is not None and not v.place.stale
    )

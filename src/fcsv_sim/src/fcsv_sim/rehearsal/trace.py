# SPDX-License-Identifier: Apache-2.0
"""One rehearsed flight as a picture: from above, heights over time, and who was in which mode."""

from typing import Dict, List, Tuple

import numpy as np

from fcsv_geometry.vehicles.modes import Mode
from fcsv_sim.autopilot import modes
from fcsv_sim.rehearsal.flight import Flight, Result

_COLOURS = {
    Mode.STABILIZE: "#999999",
    Mode.ALT_HOLD: "#c7a252",
    Mode.LOITER: "#e0c341",
    Mode.GUIDED: "#4f9d69",
    Mode.LAND: "#c8553d",
    Mode.BRAKE: "#8a4f9e",
}
_OFF = "#eeeeee"


class Trace:
    """Watches a flight (``watch`` before it begins) and draws it."""

    def __init__(self):
        self._times_s: List[float] = []
        self._places: Dict[str, List[np.ndarray]] = {}
        self._modes: Dict[str, List[str]] = {}
        self._phases: List[Tuple[float, str]] = []
        self._began: List[Tuple[float, str]] = []

    def watch(self, flight: Flight) -> None:
        """Remember all that this flight shows from now on."""
        self._places = {n: [] for n in flight.fleet}
        self._modes = {n: [] for n in flight.fleet}
        flight.recorder = self._look

    def _look(self, flight: Flight) -> None:
        self._times_s.append(flight.now_s)
        if not self._phases or self._phases[-1][1] != flight.phase:
            self._phases.append((flight.now_s, flight.phase))
        self._began = [(s, f"{fault} ({who})") for s, fault, who in flight.witness.begun]
        for name, vehicle in flight.fleet.items():
            self._places[name].append(vehicle.p_world_m)
            a = vehicle.autopilot
            self._modes[name].append(modes.NAMES[a.mode] if a.armed else "")

    def events(self, result: Result) -> List[Tuple[float, str]]:
        """What happened when (s): phases, faults, modes, violations."""
        lines = [(s, f"phase {phase}") for s, phase in self._phases] + [
            (s, f"FAULT {what}") for s, what in self._began
        ]
        lines += [(v.at_s, f"VIOLATION {v.kind}: {v.text}") for v in result.violations]
        for name, shown in self._modes.items():
            changes = (k for k in range(1, len(shown)) if shown[k] != shown[k - 1])
            lines += [(self._times_s[k], f"{name} {shown[k] or 'disarmed'}") for k in changes]
        return sorted(lines)

    def draw(self, path: str, title: str, result: Result) -> None:
        """Write the picture. Raises OSError."""
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot

        figure = pyplot.figure(figsize=(13.0, 7.5), constrained_layout=True)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.6), height_ratios=(3.0, 1.0))
        self._from_above(figure.add_subplot(grid[:, 0]))
        heights = figure.add_subplot(grid[0, 1])
        self._heights(heights, result)
        self._bars(figure.add_subplot(grid[1, 1], sharex=heights), matplotlib.patches.Patch)
        broken = (
            "; ".join(f"{v.kind} at {v.at_s:.1f} s" for v in result.violations) or "no violation"
        )
        figure.suptitle(f"{title}: {result.phase}, {broken}")
        figure.savefig(path, dpi=100)
        pyplot.close(figure)

    def _from_above(self, axes) -> None:
        for name, places in self._places.items():
            p = np.array(places)
            (line,) = axes.plot(p[:, 0], p[:, 1], label=name, linewidth=1.0)
            axes.plot(p[0, 0], p[0, 1], "o", color=line.get_color())
            axes.plot(p[-1, 0], p[-1, 1], "s", color=line.get_color())
            for at_s, what in self._began:
                if f"({name})" in what:
                    k = int(np.searchsorted(self._times_s, at_s))
                    axes.plot(*p[min(k, len(p) - 1), :2], "*", color="red", markersize=12)
        axes.set(
            xlabel="x (m)", ylabel="y (m)", title="from above (o begin, square end, star fault)"
        )
        axes.axis("equal")
        axes.legend(loc="best")

    def _heights(self, axes, result: Result) -> None:
        for name, places in self._places.items():
            axes.plot(self._times_s, np.array(places)[:, 2], label=name, linewidth=1.0)
        top = axes.get_ylim()[1]
        for at_s, phase in self._phases:
            axes.axvline(at_s, color="#bbbbbb", linewidth=0.6)
            axes.text(at_s, top, phase, rotation=90, fontsize=6, va="top", color="#666666")
        for at_s, what in self._began:
            axes.axvline(at_s, color="red", linewidth=1.2, linestyle="--")
            axes.text(
                at_s, 0.0, what, rotation=90, fontsize=7, va="bottom", ha="right", color="red"
            )
        for v in result.violations:
            axes.axvline(v.at_s, color="black", linewidth=1.2)
            axes.text(v.at_s, 0.4 * top, v.kind, rotation=90, fontsize=7, va="bottom", ha="right")
        axes.set(ylabel="height (m)")

    def _bars(self, axes, patch) -> None:
        times_s = [*self._times_s, self._times_s[-1]]
        for row, (_name, shown) in enumerate(self._modes.items()):
            begins = [k for k in range(len(shown)) if k == 0 or shown[k] != shown[k - 1]] + [
                len(shown)
            ]
            for k, end in zip(begins, begins[1:]):
                width_s = times_s[end] - times_s[k]
                axes.barh(
                    row, width_s, left=times_s[k], color=_COLOURS.get(shown[k], _OFF), height=0.8
                )
        axes.set_yticks(range(len(self._modes)), list(self._modes))
        axes.set(xlabel="time (s)")
        shown = sorted({m for listed in self._modes.values() for m in listed if m})
        axes.legend(
            handles=[patch(color=_COLOURS.get(m, _OFF), label=m) for m in shown], ncol=6, fontsize=7
        )

# SPDX-License-Identifier: Apache-2.0
"""A simulated flight of the whole system in which a battery is low while the control PC is silent:
the guardian flies its vehicle home. On request, ``python tests/support/home_flight.py FOLDER``: no
test flies it. Prints when what happened."""

import signal
import sys
from pathlib import Path
from typing import Dict, List

import faulted_flight
import numpy as np
from faulted_flight import FaultedFleet, Story

from fcsv_sim.demo.fleet import CONTROL, SimulatedFleet

MISSION = """name: home
configurations:
  - {axis: horizontal, baseline_m: 5.0, record_s: 90.0}
"""
LOW = 0.96  # the simulated battery has less after 36 s in the air; it is handed over after 24 s
WHO = "uav2"


class LowFleet(FaultedFleet):
    """Whose second vehicle takes its battery for low early."""

    def _vehicle_args(self, vehicle: str, index: int) -> Dict[str, object]:
        given = SimulatedFleet._vehicle_args(self, vehicle, index)
        if vehicle != WHO:
            return given
        rules = Path(self.plan.folder) / "guardian.yaml"
        rules.write_text(f"low_battery: {LOW}\n")
        return {**given, "guardian": rules}


class HomeStory(Story):
    """The mission is stopped while a configuration is recorded, for good."""

    mission, fleet = MISSION, LowFleet

    def _play(self, _watch) -> None:
        self._hear("CONFIGURATIONS 1/1: recording horizontal", 240.0)
        self._note("mission stopped")
        self._signal(CONTROL, "mission", signal.SIGSTOP)
        try:
            self._until_at_rest(300.0)
            self._note("on the ground")
        finally:
            self._signal(CONTROL, "mission", signal.SIGCONT)  # who is stopped cannot end by itself


def told(logs: Dict[str, List[dict]]) -> List[str]:
    """Lines: what happened to each vehicle, by the time since the mission was stopped."""
    begun_s = next(line["t"] for line in logs["story"] if line["what"] == "mission stopped")
    lines = []
    for vehicle in ("uav1", WHO):
        places = [m for m in logs[vehicle] if m["what"] == "place"]
        before = {}
        for m in (
            m for m in logs[vehicle] if m["what"] in ("guardian", "state") and m["t"] > begun_s
        ):
            what = (
                m["mode"] + ("" if m["armed"] else ", motors off")
                if m["what"] == "state"
                else m["action"]
            )
            if m["what"] == "guardian" and not what:
                continue
            if before.get(m["what"]) != what:
                lines.append(
                    f"{m['t'] - begun_s:6.1f} s {vehicle} {m['what']}: {what} {'; '.join(m.get('why', []))}"
                )
            before[m["what"]] = what
        from_m, to_m = (np.array(places[k]["p"]) for k in (0, -1))
        lines.append(
            f"         {vehicle} came down {np.hypot(*(to_m - from_m)[:2]):.2f} m from where it took off"
        )
    return lines


if __name__ == "__main__":
    if sys.argv[1] == "fly":
        HomeStory(Path(sys.argv[2])).fly()
    else:
        folder = Path(sys.argv[1])
        folder.mkdir(parents=True, exist_ok=True)
        print("\n".join(told(faulted_flight.fly(folder, program=__file__))))

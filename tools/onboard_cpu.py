#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What guardian and agent of each vehicle cost, in % of a core, while a demo's mission flies the vehicles.

Beside a demo that flies, or before it is started: python tools/onboard_cpu.py out/demo
The share is processor time over the flight's time, which passes slowly where the machine is busy.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Callable, Dict, List, Tuple

import psutil

from fcsv_sim.machines.slow_motion import Page

NODES = ("guardian", "agent", "flight_link", "odometry")
BOUNDED, BOUND = ("guardian", "agent"), 0.08  # of a core, together, per vehicle


def nodes_of(fleet: Dict[str, Dict[str, str]]) -> Dict[Tuple[str, str], psutil.Process]:
    """The process of each (vehicle, node) of a demo that runs; those whose names are in NODES."""
    found = {}
    for process in psutil.process_iter(["cmdline"]):
        words = process.info["cmdline"] or []
        names = [w[len("__name:=") :] for w in words if w.startswith("__name:=")]
        machine = next((m for m, d in fleet.items() if names and d["folder"] in " ".join(words)), None)
        if machine is not None and names[0] in NODES and "python" in words[0]:
            found[machine, names[0]] = process
    return found


def spent_s(process: psutil.Process) -> float:
    """Processor time so far."""
    times = process.cpu_times()
    return times.user + times.system


def clock_of(fleet: Dict[str, Dict[str, str]]) -> Callable[[], float]:
    """The flight's own time."""
    page = next(iter(fleet.values())).get("FCSV_SLOW_MOTION")
    return Page(page).now_s if page else time.monotonic


def measure(folder: Path, limit_s: float) -> List[Tuple[str, str, float]]:
    """(vehicle, node, share of a core) over the phase CONFIGURATIONS. Raises SystemExit where there is none."""
    description = folder / "run" / "fleet.json"
    deadline_s = time.monotonic() + limit_s
    wait(description.exists, deadline_s, f"no demo flies in {folder}")
    fleet = json.loads(description.read_text())
    os.environ["ROS_MASTER_URI"] = fleet["control"]["ROS_MASTER_URI"]
    from fcsv_sim.demo.ros.mission_watch import MissionWatch  # needs this fleet's master in the environment

    vehicles = [n for n in fleet if n != "control"]
    watch = MissionWatch(SimpleNamespace(env=os.environ), vehicles, lambda _line: None)
    wait(lambda: watch.phase == 7 or watch.over, deadline_s, "the mission did not come to its configurations")
    now_s, processes = clock_of(fleet), nodes_of(fleet)
    before, since_s = {key: spent_s(p) for key, p in processes.items()}, now_s()
    wait(lambda: watch.phase != 7, deadline_s, "the configurations did not end")
    took_s = now_s() - since_s
    print(f"{took_s:.0f} s of CONFIGURATIONS")
    return [(*key, (spent_s(p) - before[key]) / took_s) for key, p in sorted(processes.items())]


def wait(condition: Callable[[], bool], deadline_s: float, otherwise: str) -> None:
    """Raises SystemExit with ``otherwise`` once it is too late."""
    while not condition():
        if time.monotonic() > deadline_s:
            raise SystemExit(f"onboard_cpu: {otherwise}")
        time.sleep(0.1)


def main() -> int:
    """Exit status 1 where guardian and agent of a vehicle need more than the bound."""
    parser = argparse.ArgumentParser(prog="onboard_cpu", description=__doc__.split("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("out/demo"), help="of the demo (its OUT)")
    parser.add_argument("--limit", type=float, default=900.0, help="seconds to wait for the flight's end")
    args = parser.parse_args()
    shares, over = measure(args.folder.resolve(), args.limit), False
    for vehicle, node, share in shares:
        print(f"{vehicle} {node:12} {100 * share:5.1f} %")
    for vehicle in sorted({v for v, _, _ in shares}):
        together = sum(share for v, node, share in shares if v == vehicle and node in BOUNDED)
        over = over or together > BOUND
        print(f"{vehicle} {' and '.join(BOUNDED)}: {100 * together:.1f} % of a core (bound {100 * BOUND:g} %)")
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main())

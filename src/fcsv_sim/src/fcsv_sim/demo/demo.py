# SPDX-License-Identifier: Apache-2.0
"""`make demo`: from nothing to a map, with no screen and no question asked."""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import List, Optional

from fcsv_control.mission.config import load_mission
from fcsv_geometry.errors import FcsvError
from fcsv_sim.demo.fleet import FleetPlan, SimulatedFleet
from fcsv_sim.demo.truth_export import export_truth
from fcsv_sim.machines import MachineError
from fcsv_sim.world.town import WORLDS

_MISSION_TIMEOUT_S = 900.0
_LAND_TIMEOUT_S = 45.0
_CORES_FOR_LIVE = 3  # on two, simulated cameras and a growing map slow each other down


class Interrupted(Exception):
    """Ctrl-C, or SIGTERM from whoever started the demo."""


def main(argv: Optional[List[str]] = None) -> int:
    """Fly and map; exit status 0 only where a map came out."""
    args = _parse(argv)
    started = time.monotonic()

    def say(line: str) -> None:
        print(f"[{time.monotonic() - started:6.1f} s] {line}", flush=True)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    try:
        return run(_plan(args), say, fly_only=args.fly_only, method=args.method)
    except Interrupted:
        print("\ndemo: interrupted; vehicles landed, bags closed, all processes stopped", file=sys.stderr)
        return 130
    except FcsvError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 2


def run(plan: FleetPlan, say, fly_only: bool = False, method: Optional[str] = None) -> int:
    """The whole story: a world, a flight in it, its truth, a map, a table."""
    _empty(plan.folder)
    _build_world(plan, say)
    flight_s, moved_m = _fly(plan, say)
    export_truth(plan.sim_folder, plan.session_folder, plan.vehicles)
    say(f"session: {plan.session_folder}")
    if fly_only:
        return 0
    out = plan.folder / "map"
    _map(plan, out, method, say)
    _print_table(out, flight_s, moved_m)
    return 0


def _build_world(plan: FleetPlan, say) -> None:
    """The truth mesh of the town; meanwhile the renderer's kernels compile (cached for the cameras)."""
    truth = plan.session_folder / "truth"
    truth.mkdir(parents=True)
    say(f"building the {plan.world} world (seed {plan.seed})")
    command = ["rosrun", "fcsv_sim", "world", "--seed", str(plan.seed), "--world", plan.world]
    command += ["--ply", str(truth / "scene.ply")]
    if subprocess.run(command, stdout=subprocess.DEVNULL).returncode != 0:
        raise MachineError(f"the simulated town could not be built: '{' '.join(command)}' failed")


def _fly(plan: FleetPlan, say):
    """Seconds flown and metres moved. Lands everybody and closes the bags whatever happens."""
    from fcsv_sim.ros.mission_watch import MissionWatch  # needs this fleet's master in the environment

    fleet = SimulatedFleet(plan)
    watch = None
    try:
        fleet.start()
        say(f"{len(fleet.machines)} ROS masters are up; to look in: {plan.run_folder / 'fleet.json'}")
        watch = MissionWatch(fleet.control, plan.vehicles, say)
        _follow(fleet, watch, say)
        return watch.flown_s, sum(watch.moved_m.values())
    except Interrupted:
        _land(watch, say)
        raise
    finally:
        _uninterrupted(fleet.stop)


def _follow(fleet: SimulatedFleet, watch, say) -> None:
    deadline = time.monotonic() + _MISSION_TIMEOUT_S
    next_line = time.monotonic() + 10.0
    while not watch.over:
        time.sleep(0.2)
        if fleet.dead_launches():
            name = fleet.dead_launches()[0]
            raise MachineError(f"{name} stopped by itself: {fleet.launches[name].log}\n{fleet.launches[name].tail(5)}")
        if time.monotonic() > deadline:
            _land(watch, say)
            raise MachineError(
                f"the mission did not end within {_MISSION_TIMEOUT_S:.0f} s; logs: {fleet.plan.run_folder}"
            )
        if time.monotonic() > next_line and watch.states:
            say(f"    {watch.vehicles_line()}")
            next_line += 10.0
    if watch.aborted:
        raise MachineError(f"the mission was aborted; logs: {fleet.plan.run_folder}")
    while not watch.landed and time.monotonic() < deadline:
        time.sleep(0.2)


def _land(watch, say) -> None:
    """Ask for a landing and wait for it; a second Ctrl-C stops waiting."""
    if watch is None or watch.landed:
        return
    say("interrupted: landing the vehicles (Ctrl-C again: stop at once)")
    try:
        watch.abort()
        deadline = time.monotonic() + _LAND_TIMEOUT_S
        while not watch.landed and time.monotonic() < deadline:
            time.sleep(0.2)
        say("landed" if watch.landed else f"not landed after {_LAND_TIMEOUT_S:.0f} s")
    except Interrupted:
        say("stopping at once")


def _map(plan: FleetPlan, out: Path, method: Optional[str], say) -> None:
    say("mapping")
    command = ["rosrun", "fcsv_stereo", "map", str(plan.session_folder), "-o", str(out)]
    command += ["--method", method] if method else []
    child = subprocess.Popen(command, preexec_fn=os.setpgrp)
    try:
        status = child.wait()
    except Interrupted:
        child.send_signal(signal.SIGINT)
        child.wait()
        raise
    if status != 0:
        raise MachineError(f"the map could not be made from {plan.session_folder} (exit status {status})")


def _print_table(out: Path, flight_s: float, moved_m: float) -> None:
    from fcsv_stereo.table import demo_table

    print("\n" + demo_table(json.loads((out / "report.json").read_text())))
    print(f"flown {flight_s:.0f} s, moved {moved_m:.1f} m while configurations were flown")
    print(f"map:    {out / 'map.ply'}\nreport: {out / 'report.html'}")


def _plan(args) -> FleetPlan:
    mission = Path(args.mission)
    if not mission.suffix:
        mission = _missions_folder() / f"{args.mission}.yaml"
    if not mission.is_file():
        known = ", ".join(sorted(p.stem for p in _missions_folder().glob("*.yaml")))
        raise MachineError(f"no mission '{args.mission}': give a file or one of {known}")
    load_mission(mission)  # a list that cannot be flown is refused before anything is started
    if args.seed < 0:
        raise MachineError(f"--seed {args.seed}: must not be negative")
    live = _chosen(args.live, (os.cpu_count() or 1) >= _CORES_FOR_LIVE)
    rviz = _chosen(args.rviz, bool(os.environ.get("DISPLAY")))
    return FleetPlan(Path(args.out).resolve(), mission.resolve(), args.seed, args.world, rviz=rviz, live=live)


def _missions_folder() -> Path:
    import rospkg

    return Path(rospkg.RosPack().get_path("fcsv_bringup")) / "config" / "missions"


def _chosen(word: str, default: bool) -> bool:
    """ "1" and "0" decide."""
    return word == "1" if word in ("1", "0") else default


def _parse(argv):
    parser = argparse.ArgumentParser(prog="demo", description="Fly a mission in simulation and map what was seen.")
    parser.add_argument("--mission", default="short", help="a mission file, or the name of one in config/missions")
    parser.add_argument("--seed", type=int, default=1, help="of the town and of every noise")
    parser.add_argument("--world", choices=list(WORLDS), default="street", help="kind of world to fly in")
    parser.add_argument("--out", default="out/demo", help="folder for run/, session/ and map/; emptied first")
    parser.add_argument("--method", default=None, help="map method; default: that of the map command")
    parser.add_argument("--rviz", default="", help="1 opens rviz, 0 does not; default: where there is a screen")
    parser.add_argument(
        "--live", default="", help="1 maps in flight, 0 does not; default: where there are more than two cores"
    )
    parser.add_argument("--fly-only", action="store_true", help="leave the session, make no map")
    return parser.parse_args(argv)


def _empty(folder: Path) -> None:
    """Remove what an earlier demo left, and nothing else."""
    for name in ("run", "session", "map"):
        shutil.rmtree(folder / name, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)


def _interrupt(_number, _frame) -> None:
    raise Interrupted


def _uninterrupted(action) -> None:
    """Run to the end: an impatient Ctrl-C must not leave half a fleet behind."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    try:
        action()
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _interrupt)

# SPDX-License-Identifier: Apache-2.0
"""`make demo`: from nothing to a map, with no screen and no question asked."""

import argparse
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import List, Optional, Sequence, Tuple

from fcsv_control.mission.plans.plan_check import require_flyable
from fcsv_geometry.errors import FcsvError
from fcsv_geometry.missions.mission import Mission, load_mission
from fcsv_geometry.programs.writing import in_words, require_folder
from fcsv_geometry.vehicles.vehicle import load_vehicles
from fcsv_sim.autopilot.ground import READY_S
from fcsv_sim.bringup import mission_file, robot_file, vehicles_folder
from fcsv_sim.demo import interrupt
from fcsv_sim.demo.autopilots import addresses, require_there
from fcsv_sim.demo.fleet import FleetPlan
from fcsv_sim.demo.gimbal_guided import GUIDANCE, guided_site, world_of
from fcsv_sim.demo.held import held, held_in_words
from fcsv_sim.demo.look import look, stay, write_play
from fcsv_sim.demo.monitored import evaluate, load, write_table
from fcsv_sim.demo.monitored import in_words as monitored_in_words
from fcsv_sim.demo.narration import Narrator, in_minutes, wait
from fcsv_sim.demo.own_camera import own_camera
from fcsv_sim.demo.pose_errors import errors_in_words, tracked_errors
from fcsv_sim.demo.robot_place import ROBOT, drive_robot, start_for
from fcsv_sim.demo.systems import GIMBAL_SITE, SYSTEMS, TILTING, MapRun, System
from fcsv_sim.demo.truth_export import export_movers, export_truth
from fcsv_sim.demo.window import COMMAND, OperatorWindow
from fcsv_sim.machines import slow_motion
from fcsv_sim.machines.crowd import CrowdWatch
from fcsv_sim.machines.machines import MachineError
from fcsv_sim.world.movers import movers
from fcsv_sim.world.town import PLACES, WORLDS, Town
from fcsv_stereo.evaluating.truth import load_truth

_FURTHEST_START_M = 500.0  # from the middle of a world
_CORES_FOR_LIVE = 3  # on two, simulated cameras and a growing map slow each other down
_LEAST_MIB = 800  # recorders stop below 500 MiB; a mission's pictures
_SITE = "site"
_FOLDERS = ("run", "session", "map", "map_instant", "map_thesis", "monitor", "guide", _SITE)
_ROBOT_MISSION = "guide"  # where a robot is guided over the map
_WATCHED_MISSION = "guide_watched"  # the same, with vehicles that hold and watch at its end
_REAL_TIME = 0.97  # of it, or more: not worth a word
_AROUND_S, _CHANGE_S = 85.0, 8.0  # of a flight: what is not configurations; from one to the next
_CHANGE_OVER_S = 15.0  # to the next viewpoint


def main(argv: Optional[List[str]] = None) -> int:
    """Fly and map; exit status 0 only where a map came out, and a robot's drive was sound.

    Without ``argv`` this is the program itself, which may begin again in slow motion.
    """
    args = _parse(argv)
    try:
        rate = slow_motion.parse_rate(args.speed)
        if addresses(args.autopilot) and rate is None:
            rate = 1.0  # programs from elsewhere keep a steady time
        if argv is None and args.system != TILTING:  # pictures taken at rest have no clock
            slow_motion.begin_again_in(rate)
    except FcsvError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 2
    say = Narrator()
    interrupt.listen()
    try:
        if args.seed < 0:
            raise MachineError(f"--seed {args.seed}: must not be negative")
        if args.system == TILTING:
            return _tilt(args, say)
        system = _system(args.system)
        if args.system == GUIDANCE:
            say("choosing where the vehicles look from, about ten seconds")
        plan = _plan(system, args)
        CrowdWatch().look_before(say)
        return run(system, plan, say, fly_only=args.fly_only, method=args.method)
    except interrupt.Interrupted:
        print(
            "\ndemo: interrupted; what flew has landed, bags are closed, all processes stopped",
            file=sys.stderr,
        )
        return 130
    except FcsvError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"demo: {in_words(error, args.out)}", file=sys.stderr)
        return 2


def run(
    system: System,
    plan: FleetPlan,
    say: Narrator,
    fly_only: bool = False,
    method: Optional[str] = None,
) -> int:
    """The whole story: a world, a flight in it, its truth, a map, a table; then the window until it
    is closed."""
    try:
        status = _run(system, plan, say, fly_only, method)
        stay(plan)
        return status
    finally:
        if plan.window is not None:
            interrupt.uninterrupted(plan.window.close)


def _run(
    system: System, plan: FleetPlan, say: Narrator, fly_only: bool, method: Optional[str]
) -> int:
    _empty(plan.folder)
    say(_what_comes(load_mission(plan.mission_file), fly_only, plan.world in PLACES))
    if plan.looks:
        say(plan.looks)
    if plan.camera is not None:
        say(plan.camera.words)
    build_world(plan, say)
    if not plan.buttons:
        window = shlex.join([str(plan.run_folder / "on_control"), *COMMAND, *plan.window_arguments])
        say(
            f"the buttons are yours, in the operator's window; where none opened, or to open it again: {window}"
        )
    begun = slow_motion.both_clocks()
    flight_s, moved_m = system.fly(plan, say)
    speed = slow_motion.share_of_real_time(begun)
    with say.shown("writing the truth beside the session"):
        stamps = system.stamps and system.stamps(plan)
        truth = export_truth(plan.sim_folder, plan.session_folder, plan.vehicles, stamps)
        if plan.movers:
            export_movers(truth, plan.movers)
    if system.T_world_odom is not None:
        with say.shown("comparing the flight with the truth"):
            words = _held(system, plan)
        say(words)
    say(f"session: {plan.session_folder}")
    if plan.monitor:
        _evaluate_monitoring(plan)
    if fly_only:
        return 0
    shown = "map"
    if load_mission(plan.mission_file).stations:
        shown = _survey(plan, say)
    else:
        for each in _maps(system, plan, method):
            _map(plan, each, say)
            _print_end(plan, plan.folder / each.folder)
    slowly = "" if speed > _REAL_TIME else f" (at {speed:.2f} of real time)"
    print(f"flown {flight_s:.0f} s{slowly}, moved {moved_m:.1f} m while configurations were flown")
    status = drive_robot(plan, say) if plan.world in PLACES else 0
    write_play(plan, shown)
    look(plan, shown)
    return status


def _held(system: System, plan: FleetPlan) -> str:
    """How well set-points were held, by the truth."""
    T_body_cam = {
        n: v.T_body_cam for n, v in load_vehicles(vehicles_folder(), plan.vehicles).items()
    }
    return held_in_words(
        held(plan.session_folder, plan.sim_folder, T_body_cam, system.T_world_odom)
    )


def _maps(system: System, plan: FleetPlan, method: Optional[str]) -> List[MapRun]:
    """The calls of the map command, in their order."""
    maps = list(system.maps(load_mission(plan.mission_file)))
    maps = maps if method is None else [MapRun(arguments=("--method", method))]
    if plan.world in PLACES:
        ground = ("--products", "ground", "--robot", str(robot_file(ROBOT)))
        maps = [replace(each, arguments=(*each.arguments, *ground)) for each in maps]
    return maps + ([MapRun("map_instant", ("--instant",))] if plan.movers else [])


def _what_comes(mission: Mission, fly_only: bool, robot: bool = False) -> str:
    """One line at the start: the steps, and about how long each takes on a machine with two free
    cores."""
    flight_s = _AROUND_S + sum(_CHANGE_S + c.stands_s for c in mission.configurations)
    flight_s += _CHANGE_OVER_S * (len(mission.viewpoints) - 1)
    maps = "map what was seen, one to two minutes"
    if mission.stations:
        views = {mission.configurations[i].view for i in mission.recorded}
        maps = f"map {len(views)} views and join them, five to ten minutes"
    steps = [
        "build the world, half a minute",
        f"fly mission '{mission.name}', about {in_minutes(flight_s)}",
    ]
    steps += [] if fly_only else [maps]
    steps += ["guide a robot over the map, one to three minutes"] if robot and not fly_only else []
    return f"what comes: {'; '.join(steps)} (longer on a busy machine); Ctrl-C lands and stops all"


def _evaluate_monitoring(plan: FleetPlan) -> None:
    """Against the truth; the table beside the images."""
    judged = evaluate(load(plan.monitor_folder), load_truth(plan.session_folder / "truth"))
    write_table(judged, plan.monitor_folder / "frames.csv")
    print("\n".join(monitored_in_words(judged)))
    print(f"depth images of monitoring: {plan.monitor_folder}")


def build_world(plan: FleetPlan, say: Narrator) -> None:
    """The truth mesh of the town; meanwhile the renderer's kernels compile (cached for the
    cameras)."""
    truth = plan.session_folder / "truth"
    truth.mkdir(parents=True)
    say(f"building the {plan.world} world (seed {plan.seed})")
    command = ["rosrun", "fcsv_sim", "world", "--seed", str(plan.seed), "--world", plan.world]
    command += ["--ply", str(truth / "scene.ply")]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    if wait(child, say, "building the world") != 0:
        raise MachineError(f"the simulated town could not be built: '{' '.join(command)}' failed")


def _map(plan: FleetPlan, each: MapRun, say: Narrator) -> None:
    say(" ".join(["mapping", *each.arguments]))
    status = _stereo(plan, "map", each.folder, each.arguments)
    if status != 0:
        raise MachineError(
            f"the map could not be made from {plan.session_folder} (exit status {status})"
        )


def _survey(plan: FleetPlan, say: Narrator) -> str:
    """A map of each view, joined to one site; the folder of the first view's map."""
    say("mapping every view, and joining them to a site")
    status = _stereo(plan, "survey", _SITE)
    out = plan.folder / _SITE
    if status != 0:
        raise MachineError(
            f"the site could not be joined from {plan.session_folder} (exit status {status}); {out / 'site.html'} "
            "says what is missing"
        )
    print(f"site:   {out / 'site.ply'}\nreport: {out / 'site.html'}")
    views = json.loads((out / "site.json").read_text())["views"]
    return f"{_SITE}/views/{views[0]['name']}"


def _stereo(plan: FleetPlan, program: str, folder: str, arguments: Sequence[str] = ()) -> int:
    """Runs a command on the session; its exit status."""
    command = ["rosrun", "fcsv_stereo", program, str(plan.session_folder)]
    command += ["-o", str(plan.folder / folder)]
    env = slow_motion.in_real_time(dict(os.environ))
    # the window makes no map there meanwhile
    being_made = plan.folder / f".{folder}.being_made"
    being_made.touch()
    child = subprocess.Popen([*command, *arguments], preexec_fn=os.setpgrp, env=env)
    try:
        return child.wait()
    except interrupt.Interrupted:
        child.send_signal(signal.SIGINT)
        child.wait()
        raise
    finally:
        being_made.unlink()


def _print_end(plan: FleetPlan, out: Path) -> None:
    """Below the table of the map command."""
    document = json.loads((out / "report.json").read_text())
    print(
        "\n" + errors_in_words(tracked_errors(document, load_truth(plan.session_folder / "truth")))
    )
    print(f"map:    {out / 'map.ply'}\nreport: {out / 'report.html'}")


def _system(name: str) -> System:
    if name not in SYSTEMS:
        raise MachineError(f"no system '{name}': SYSTEM is one of {', '.join(SYSTEMS)}, {TILTING}")
    return SYSTEMS[name]


def _tilt(args, say) -> int:
    """The demo that flies nothing."""
    if args.mission:
        raise MachineError(f"--mission {args.mission}: system {TILTING} flies none")
    if args.autopilot:
        raise MachineError(f"--autopilot {args.autopilot}: in system {TILTING} no autopilot flies")
    if args.camera:
        raise MachineError(
            f"--camera {args.camera}: system {TILTING} has the cameras of its rig's file"
        )
    from fcsv_sim.demo import tilting  # a second of imports that no flight needs

    return tilting.run(Path(args.out), say, args.seed, args.overwrite == "1")


def _plan(system: System, args) -> FleetPlan:
    out = Path(args.out).resolve()
    _require_free(out, args.overwrite == "1")
    site, looks = None, ""
    if args.system == GUIDANCE:
        args.world = _guidance_world(args)
        mission, site, looks = guided_site(args.seed, GIMBAL_SITE, out)
    else:
        mission = mission_file(_mission_name(system, args))
    # a list that cannot be flown is refused before anything is started
    flown = load_mission(mission)
    vehicles = system.fleet(flown)
    system.require(flown)
    autopilots = addresses(args.autopilot)
    if autopilots and args.system != "tags":
        raise MachineError(f"--autopilot: in system {args.system} no autopilot flies")
    if args.camera and args.system != "tags":
        raise MachineError(
            f"--camera {args.camera}: system {args.system} flies Tellos, which have their own"
        )
    geometries = load_vehicles(vehicles_folder(), vehicles)
    require_flyable(flown, vehicles, {n: v.radius_m for n, v in geometries.items()})
    camera = own_camera(args.camera, flown, geometries) if args.camera else None
    if not 0.0 < args.ready_s <= 120.0:
        raise MachineError(f"--ready-s {args.ready_s:g}: must be over 0, and 120 at most")
    if args.operator == "you" and args.system != "tags":
        raise MachineError(
            f"--operator you: in system {args.system} the buttons are pressed by its simulated pilots"
        )
    monitor = args.live == "monitor"
    if monitor and args.system != "tags":
        raise MachineError(f"--live monitor: system {args.system} has no live map that monitors")
    watch = args.world in PLACES and args.movers == "1"
    moving = not watch and _chosen(
        args.movers, args.world == "street" and any(c.at_once for c in flown.configurations)
    )
    if moving and args.system != "tags":
        raise MachineError(f"--movers 1: in system {args.system} nothing moves through the town")
    # refused without a street
    through_town = movers(Town.generate(args.seed, args.world).plan) if moving else ()
    start_xy_m = (0.0, 0.0)
    if site is None:
        start_xy_m, looks = _looks_from(args, flown.home_height_m)
    live = _chosen(args.live, (os.cpu_count() or 1) >= _CORES_FOR_LIVE)
    screen = bool(os.environ.get("DISPLAY"))
    rviz = _chosen(args.rviz, screen)
    if autopilots:
        require_there(autopilots, vehicles, slow_motion.parse_rate(args.speed) or 1.0)
    return FleetPlan(
        out,
        mission,
        args.seed,
        args.world,
        vehicles,
        start_xy_m=start_xy_m,
        looks=looks,
        rviz=rviz,
        near=args.near == "1",
        gps=args.gps == "1",
        live=(live or watch or site is not None) and not monitor,
        robot_site=site,
        watch=watch,
        follower=_follower(flown, vehicles) if watch else "",
        robot_file=robot_file(ROBOT) if watch else None,
        monitor=monitor,
        movers=tuple(through_town),
        flight_link=args.flight_link,
        autopilots=autopilots,
        buttons=args.operator != "you",
        ready_s=args.ready_s,
        camera=camera,
        window=OperatorWindow() if screen and (rviz or args.system == "tags") else None,
    )


def _follower(mission: Mission, vehicles: Sequence[str]) -> str:
    """Who follows a robot that is watched, the last of the column, where the mission ends with
    that; raises MachineError where nobody would be left to watch."""
    if not mission.follows(-1):
        return ""
    if len(vehicles) < 3:
        raise MachineError(
            f"mission '{mission.name}': two vehicles watch while a third follows (follow_s): name uav3 in it"
        )
    return vehicles[-1]


def _guidance_world(args) -> str:
    """The small maze; its mission is made for it. Raises MachineError where another is wished."""
    for name, given in (("mission", args.mission), ("movers", args.movers == "1")):
        if given:
            raise MachineError(f"--{name} {given}: system {GUIDANCE} has none of its own choice")
    return world_of(args.world, "street")


def _mission_name(system: System, args) -> str:
    """What is flown: where a robot is watched, the mission that ends with that."""
    if args.world not in PLACES:
        return args.mission or system.mission
    robots = _WATCHED_MISSION if args.movers == "1" else _ROBOT_MISSION
    return robots if args.mission in ("", _ROBOT_MISSION) else args.mission


def _looks_from(args, height_m: float) -> Tuple[Tuple[float, float], str]:
    """Where the column is to stand, and why there where that was chosen for a robot. Raises
    MachineError."""
    start_xy_m = _start(args)
    if args.world not in PLACES:
        return start_xy_m, ""
    if args.system != "tags":
        raise MachineError(f"--world {args.world}: system {args.system} guides no robot")
    if args.live == "monitor":
        raise MachineError(
            f"--live monitor: a robot in world {args.world} is watched with --movers 1 (MOVERS=1)"
        )
    return (start_xy_m, "") if args.start else start_for(args.world, args.seed, height_m)


def _start(args) -> Tuple[float, float]:
    """Where the column is to stand. Raises MachineError."""
    words = args.start.split(",") if args.start else ["0", "0"]
    try:
        x, y = (float(w) for w in words)
    except ValueError:
        raise MachineError(f"--start {args.start}: give X,Y in m, such as 14,-10") from None
    if args.start and args.system != "tags":
        raise MachineError(f"--start: system {args.system} flies before its tracker")
    if not max(abs(x), abs(y)) <= _FURTHEST_START_M:
        raise MachineError(f"--start {args.start}: the worlds end within {_FURTHEST_START_M:g} m")
    return x, y


def _require_free(out: Path, overwrite: bool) -> None:
    """Raises MachineError where a flight is recorded already, or where no folder can be."""
    if any(p.exists() and not p.is_dir() for p in (out, *out.parents)):
        raise MachineError(f"{out}: a file stands there, not a folder; choose another with OUT=")
    recorded = [p for pattern in ("*.bag", "*.bag.active") for p in (out / "session").glob(pattern)]
    if recorded and not overwrite:
        raise MachineError(
            f"{out} holds a recorded flight: OVERWRITE=1 replaces it, OUT=FOLDER flies into another"
        )
    require_folder(out, _LEAST_MIB)
    for there in (p for p in (out / name for name in _FOLDERS) if p.exists()):
        require_folder(there)


def _chosen(word: str, default: bool) -> bool:
    """ "1" and "0" decide."""
    return word == "1" if word in ("1", "0") else default


def _parse(argv):
    parser = argparse.ArgumentParser(
        prog="demo", description="Fly a mission in simulation and map what was seen."
    )
    parser.add_argument(
        "--system",
        default="tags",
        help=f"how cameras know where they are: {', '.join(SYSTEMS)}; "
        f"{TILTING}: a tilting stereo camera, which flies nothing",
    )
    parser.add_argument(
        "--mission", default="", help="a mission file, or the name of one in config/missions"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the town and of every noise")
    parser.add_argument(
        "--world",
        choices=[*WORLDS, *PLACES],
        default="street",
        help=f"kind of world to fly in; through {', '.join(PLACES)} a robot is guided on the map",
    )
    parser.add_argument("--out", default="out/demo", help="folder for run/, session/ and map/")
    parser.add_argument(
        "--overwrite", default="", help="1 removes what an earlier demo left in --out"
    )
    parser.add_argument(
        "--method", default=None, help="map method; default: that of the map command"
    )
    parser.add_argument(
        "--rviz", default="", help="1 opens rviz, 0 does not; default: where there is a screen"
    )
    parser.add_argument(
        "--live",
        default="",
        help="1 maps in flight, 0 does not, monitor makes depth of what holding vehicles see, "
        "again and again; default: 1 where there are more than two cores",
    )
    parser.add_argument(
        "--movers",
        default="",
        help="system tags: 1 lets a car and a walker move through the town, 0 does not; default: where a mission in "
        "the street has several configurations at once (docs/user/missions.md)",
    )
    parser.add_argument(
        "--start",
        default="",
        metavar="X,Y",
        help="system tags: where the column takes off in the world, m; default: 0,0, where nothing stands around it",
    )
    parser.add_argument(
        "--camera",
        default="",
        metavar="FILE",
        help="system tags: calibration file of your own camera (calibrate_camera, camera_calibration), which all "
        "vehicles then carry; default: the thesis's camera, 640 x 480 px, f = 602 px",
    )
    near = "system tags: 1 records depth cameras, for the near field (docs/user/maps.md)"
    parser.add_argument("--near", default="", help=near)
    gps = "system tags: 1 gives autopilots a GPS receiver, which they do not fly by (docs/user/survey.md)"
    parser.add_argument("--gps", default="", help=gps)
    parser.add_argument(
        "--speed",
        default=slow_motion.AUTO,
        help="share of real time at which all is simulated; default: auto: 1, or less where the machine cannot keep up",
    )
    parser.add_argument(
        "--flight-link",
        choices=("mavlink", "mavros"),
        default="mavlink",
        help="system tags: what flies the autopilots; mavros: MAVROS's node, where installed (docs/user/vehicles.md)",
    )
    parser.add_argument(
        "--autopilot",
        default="",
        metavar="ADDRESS,...",
        help="system tags: ArduCopter's own simulation flies, one for each vehicle: tcp:127.0.0.1:5760,... "
        "(docs/user/simulation.md), with --speed of its own --speedup; default: simulated autopilots",
    )
    parser.add_argument(
        "--operator",
        choices=("simulated", "you"),
        default="simulated",
        help="system tags: who presses buttons; you: in the window (docs/user/console.md); pilots are simulated",
    )
    parser.add_argument(
        "--ready-s",
        type=float,
        default=READY_S,
        help="system tags: until a simulated autopilot may be armed, as a real one (default: %(default)g)",
    )
    parser.add_argument("--fly-only", action="store_true", help="leave the session, make no map")
    return parser.parse_args(argv)


def _empty(folder: Path) -> None:
    """Remove what an earlier demo left, and nothing else."""
    for name in _FOLDERS:
        if (folder / name).exists():
            shutil.rmtree(folder / name)
    folder.mkdir(parents=True, exist_ok=True)

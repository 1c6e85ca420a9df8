# SPDX-License-Identifier: Apache-2.0
"""The flight of a demo, whatever carries it: machines up, a mission followed to its end, everybody
down."""

import time
from typing import Callable, Tuple

from fcsv_sim.demo.fleet import CONTROL, FleetPlan, Machines, SimulatedFleet
from fcsv_sim.demo.gimbal_guided import GuidedTellos
from fcsv_sim.demo.interrupt import Interrupted, uninterrupted
from fcsv_sim.demo.narration import Narrator
from fcsv_sim.demo.site import PairSite
from fcsv_sim.demo.tellos import SimulatedTellos
from fcsv_sim.machines.crowd import CrowdWatch, MachineTooBusy
from fcsv_sim.machines.machines import MachineError
from fcsv_sim.tello.places import places

_MISSION_TIMEOUT_S = 900.0
_LAND_TIMEOUT_S = 45.0


def fly_fleet(plan: FleetPlan, say: Narrator) -> Tuple[float, float]:
    """Vehicles with autopilots, a master each, the mission node in charge; seconds flown and metres
    moved."""
    return _fly_mission(SimulatedFleet(plan), say)


def fly_tellos(site: PairSite, plan: FleetPlan, say: Narrator) -> Tuple[float, float]:
    """Tellos before a tracker on the ground, the mission node in charge; seconds flown and metres
    moved."""
    with places(plan.vehicles) as (where, otherwise):
        if otherwise:
            say(f"Tellos: {otherwise}")
        return _fly_mission(SimulatedTellos(plan, site, where), say)


def fly_guided(plan: FleetPlan, say: Narrator) -> Tuple[float, float]:
    """Tellos that gimbals on a robot follow, and its drive; seconds flown and metres moved."""
    with places(plan.vehicles) as (where, otherwise):
        if otherwise:
            say(f"Tellos: {otherwise}")
        return _fly_mission(GuidedTellos(plan, where), say)


def _fly_mission(machines: Machines, say: Narrator) -> Tuple[float, float]:
    # needs these machines' master in the environment
    from fcsv_sim.demo.ros.mission_watch import MissionWatch

    watch = None

    def follow() -> Tuple[float, float]:
        nonlocal watch
        watch = MissionWatch(machines.control, machines.plan.vehicles, say)
        if machines.plan.monitor:
            from fcsv_sim.demo.ros.monitor_watch import MonitorWatch

            MonitorWatch(machines.plan.monitor_folder, machines.plan.vehicles[0], say)
        along = None
        if machines.plan.watch:
            from fcsv_sim.demo.ros.drive_along import DriveAlong

            along = DriveAlong(machines.plan, machines.control, say)
        if machines.plan.robot_site is not None:
            from fcsv_sim.demo.ros.drive_by_gimbals import DriveByGimbals

            along = DriveByGimbals(machines.plan, machines.control, say)
        _follow(machines, watch, say, along)
        mapped = watch.maps.in_words()
        if mapped:
            say(mapped)
        return watch.flown_s, sum(watch.moved_m.values())

    return _fly(machines, follow, lambda: _land_fleet(watch, say), say)


def _fly(
    machines: Machines,
    follow: Callable[[], Tuple[float, float]],
    land: Callable[[], None],
    say: Narrator,
):
    """What ``follow`` gives. Lands everybody and stops every process whatever happens."""
    try:
        machines.start()
        masters = (
            "1 ROS master is"
            if len(machines.machines) == 1
            else f"{len(machines.machines)} ROS masters are"
        )
        say(f"{masters} up; to look in: {machines.plan.run_folder / 'on_control'} rostopic list")
        return follow()
    except Interrupted:
        say("interrupted: landing the vehicles (Ctrl-C again: stop at once)")
        try:
            land()
        except Interrupted:
            say("stopping at once")
        except MachineError as error:
            say(str(error))
        raise
    finally:
        uninterrupted(lambda: _stop(machines, say))


def _stop(machines: Machines, say: Narrator) -> None:
    with say.shown("closing the bags, stopping the machines"):
        machines.stop()


def _follow(fleet: Machines, watch, say: Narrator, along=None) -> None:
    deadline, crowd = time.monotonic() + _MISSION_TIMEOUT_S, CrowdWatch()
    while not watch.over:
        time.sleep(0.2)
        try:
            crowd.look()
        except MachineTooBusy:
            _land_fleet(watch, say)
            raise
        fleet.require_alive()
        if watch.phase is None:
            fleet.require_begun(CONTROL, "mission")
        fleet.meanwhile(watch.phase)
        if along is not None:
            along.step()
        if time.monotonic() > deadline:
            _land_fleet(watch, say)
            raise MachineError(
                f"the mission did not end within {_MISSION_TIMEOUT_S:.0f} s; logs: {fleet.plan.run_folder}"
            )
        _show(watch, say)
    if watch.aborted:
        raise MachineError(f"the mission was aborted; logs: {fleet.plan.run_folder}")
    while not watch.landed and time.monotonic() < deadline:
        time.sleep(0.2)


def _show(watch, say: Narrator) -> None:
    """What goes on now: what the start still waits for, then the vehicles."""
    if watch.starting:
        say.status(watch.start_up.status())
        for line in watch.start_up.reasons(time.monotonic()):
            say(line)
    elif watch.states:
        say.status(watch.vehicles_line())


def _land_fleet(watch, say: Narrator) -> None:
    """Ask for a landing and wait for it."""
    if watch is None or watch.landed:
        return
    watch.abort()
    deadline = time.monotonic() + _LAND_TIMEOUT_S
    while not watch.landed and time.monotonic() < deadline:
        time.sleep(0.2)
        say.status(f"landing: {watch.vehicles_line()}")
    say("landed" if watch.landed else f"not landed after {_LAND_TIMEOUT_S:.0f} s")

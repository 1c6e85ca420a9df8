# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C in a flight, at any moment of it: everybody is landed, bags are closed, every process is stopped.

Machines and missions are stand-ins; with real ones a fleet is interrupted in tests/system/test_demo.py.
"""

import os
import signal
from types import SimpleNamespace

import numpy as np
import pytest

from fcsv_geometry import transforms
from fcsv_sim.demo import flights, interrupt
from fcsv_sim.demo.interrupt import Interrupted
from fcsv_sim.machines.machines import MachineError


@pytest.fixture(autouse=True)
def signals_as_before():
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    interrupt.listen()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


class Clock:
    """Stands in for the module time of whoever waits."""

    def __init__(self):
        self.now_s = 1000.0

    def time(self):
        return self.now_s

    monotonic = time

    def sleep(self, seconds):
        self.now_s += seconds


class Story(list):
    """What was done, in order; and the stand-ins that write it down."""

    def machines(self, tmp_path, start=lambda: None):
        def stop():
            os.kill(os.getpid(), signal.SIGINT)  # an impatient Ctrl-C
            self.append("stopped")

        plan = SimpleNamespace(run_folder=tmp_path)
        return SimpleNamespace(machines={"control": None}, plan=plan, start=start, stop=stop)

    def doing(self, name, error=None):
        def do(*_):
            self.append(name)
            if error is not None:
                raise error

        return do


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("moment", ["start", "follow"])
def test_an_interrupted_flight_lands_and_stops_everything(tmp_path, number, moment):
    story, said = Story(), []

    def interrupted():
        story.append(moment)
        os.kill(os.getpid(), number)

    machines = story.machines(tmp_path, start=interrupted if moment == "start" else lambda: None)
    with pytest.raises(Interrupted):
        flights._fly(machines, interrupted, story.doing("landed"), said.append)
    assert story == [moment, "landed", "stopped"] and "landing the vehicles" in said[-1]


@pytest.mark.parametrize("error, words", [(Interrupted(), "at once"), (MachineError("not landed; logs: x"), "logs: x")])
def test_a_landing_that_fails_or_is_interrupted_itself_stops_everything(tmp_path, error, words):
    story, said = Story(), []
    with pytest.raises(Interrupted):
        machines = story.machines(tmp_path)
        flights._fly(machines, story.doing("flown", Interrupted()), story.doing("landing", error), said.append)
    assert story == ["flown", "landing", "stopped"] and words in said[-1]


def test_a_flight_that_fails_stops_everything_and_says_why(tmp_path):
    story = Story()
    with pytest.raises(MachineError, match="uav1 stopped by itself"):
        failing = story.doing("flown", MachineError("uav1 stopped by itself"))
        flights._fly(story.machines(tmp_path), failing, story.doing("landed"), story.append)
    assert story[-2:] == ["flown", "stopped"]


@pytest.mark.parametrize("lands_after_s, words", [(3.0, "landed"), (1e9, "not landed after 45 s")])
def test_landing_a_fleet_is_asked_for_once_and_waited_for(monkeypatch, lands_after_s, words):
    clock, said, asked_s = Clock(), [], []
    monkeypatch.setattr(flights, "time", clock)

    class Watch:
        landed = property(lambda _self: bool(asked_s) and clock.now_s >= asked_s[0] + lands_after_s)

        def abort(self):
            asked_s.append(clock.now_s)

    flights._land_fleet(Watch(), said.append)
    assert len(asked_s) == 1 and said == [words] and clock.now_s <= 1046.0
    if words == "landed":
        flights._land_fleet(Watch(), said.append)  # on the ground already
    flights._land_fleet(None, said.append)  # interrupted before there was a mission
    assert len(asked_s) == 1 and said == [words]


# ---- a pair before a tracker --------------------------------------------------------------------------------


@pytest.fixture
def pair(monkeypatch, tmp_path):
    """pair(fly) -> story of fly_pair with a mission that does so."""
    from fcsv_sim.demo.ros import mission_watch, pair_mission

    def fly(flying):
        story = Story()
        mission = SimpleNamespace(fly=lambda: flying(story), land=story.doing("landed"), close=story.doing("closed"),
                                  flown_s=12.0, moved_m=3.0)  # fmt: skip
        machines = story.machines(tmp_path)
        machines.control = None
        monkeypatch.setattr(flights, "SimulatedPair", lambda _plan, _site: machines)
        monkeypatch.setattr(flights, "load_vehicles", lambda *_: {})
        monkeypatch.setattr(flights, "load_mission", lambda _path: None)
        monkeypatch.setattr(mission_watch, "attach", lambda _machine: None)
        monkeypatch.setattr(pair_mission, "PairMission", lambda *_: mission)
        plan = SimpleNamespace(run_folder=tmp_path, vehicles=("tello1", "tello2"), mission_file="x")
        try:
            story.append(flights.fly_pair(SimpleNamespace(), plan, lambda _line: None))
        except (Interrupted, MachineError) as error:
            story.append(type(error))
        return story

    return fly


def test_a_pair_that_is_interrupted_lands_and_its_bags_are_closed(pair):
    assert pair(lambda _: os.kill(os.getpid(), signal.SIGINT)) == ["landed", "stopped", "closed", Interrupted]


def test_a_pair_that_fails_or_ends_well_has_its_bags_closed(pair):
    def fail(_):
        raise MachineError("no pictures from the cameras")

    assert pair(fail) == ["stopped", "closed", MachineError]
    assert pair(lambda _: None) == ["stopped", "closed", (12.0, 3.0)]


class Tello:
    """Where its camera is in home, and what it was told."""

    def __init__(self, xyz, lands=True):
        self.p, self.lands, self.goal = np.array(xyz), lands, None

    def latest(self):
        return 0.0, transforms.transform(np.eye(3), self.p)


def landing(monkeypatch, **tellos):
    """(mission, clock, orders) of PairMission.land with these in the air."""
    from fcsv_sim.demo.ros import pair_mission

    clock, orders = Clock(), []
    monkeypatch.setattr(pair_mission, "time", clock)
    mission = object.__new__(pair_mission.PairMission)

    def by_tracker(name, T):
        orders.append((name, tuple(np.round(T[:3, 3], 2))))
        tellos[name].p = T[:3, 3]

    class Pilots:
        down = False
        all_landed = property(lambda self: self.down)

        def order(self, what):
            orders.append(what)
            self.down = orders.count("land") >= 3 and all(t.lands for t in tellos.values())

    pilots = Pilots()
    pilots.by_tracker = by_tracker
    mission._pilots, mission._cameras, mission._say = pilots, tellos, lambda _line: None
    mission._plan = SimpleNamespace(run_folder="run")
    return mission, clock, orders


def test_a_pair_side_by_side_is_told_to_land_until_it_has(monkeypatch):
    mission, _, orders = landing(monkeypatch, tello1=Tello([0.0, 0.0, 0.0]), tello2=Tello([0.0, -1.5, 0.0]))
    mission.land()
    assert orders == ["land"] * 3
    mission.land()
    assert len(orders) == 3  # nothing to do on the ground


def test_one_above_the_other_the_upper_one_goes_aside_first(monkeypatch):
    mission, _, orders = landing(monkeypatch, tello1=Tello([0.0, 0.0, 0.0]), tello2=Tello([0.1, 0.0, 1.0]))
    mission.land()
    assert orders == [("tello2", (0.0, -1.2, 1.0)), "land", "land", "land"]


def test_a_landing_that_does_not_come_is_an_error_that_names_the_logs(monkeypatch):
    stuck = Tello([0.0, -1.5, 0.0], lands=False)
    mission, clock, _ = landing(monkeypatch, tello1=Tello([0.0, 0.0, 0.0]), tello2=stuck)
    with pytest.raises(MachineError, match="not landed after 90 s; logs: run"):
        mission.land()
    assert clock.now_s == pytest.approx(1090.5, abs=1.0)

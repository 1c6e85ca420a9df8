# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C in a flight, at any moment of it: everybody is landed, bags are closed, every process is
stopped.

Machines and missions are stand-ins; with real ones a fleet is interrupted in
tests/system/test_demo.py.
"""

import contextlib
import os
import signal
from types import SimpleNamespace

import pytest

from fcsv_geometry.missions.phases import PHASES
from fcsv_sim.demo import flights, interrupt
from fcsv_sim.demo.interrupt import Interrupted
from fcsv_sim.demo.systems import GIMBAL_SITE
from fcsv_sim.demo.tellos import SimulatedTellos
from fcsv_sim.machines.crowd import MachineTooBusy
from fcsv_sim.machines.machines import MachineError


@pytest.fixture(autouse=True)
def listens(signals_as_before):
    interrupt.listen()


class Clock:
    """Stands in for the module time of whoever waits."""

    def __init__(self):
        self.now_s = 1000.0

    def time(self):
        return self.now_s

    monotonic = time

    def sleep(self, seconds):
        self.now_s += seconds


class Said(list):
    """Stands in for a Narrator: its lines, and what it showed meanwhile."""

    def __init__(self):
        super().__init__()
        self.shown_words = []

    __call__ = list.append

    def status(self, words):
        self.shown_words.append(words)

    @contextlib.contextmanager
    def shown(self, words):
        self.shown_words.append(words)
        yield


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
    story, said = Story(), Said()

    def interrupted():
        story.append(moment)
        os.kill(os.getpid(), number)

    machines = story.machines(tmp_path, start=interrupted if moment == "start" else lambda: None)
    with pytest.raises(Interrupted):
        flights._fly(machines, interrupted, story.doing("landed"), said)
    assert story == [moment, "landed", "stopped"] and "landing the vehicles" in said[-1]


@pytest.mark.parametrize(
    "error, words", [(Interrupted(), "at once"), (MachineError("not landed; logs: x"), "logs: x")]
)
def test_a_landing_that_fails_or_is_interrupted_itself_stops_everything(tmp_path, error, words):
    story, said = Story(), Said()
    with pytest.raises(Interrupted):
        machines = story.machines(tmp_path)
        flights._fly(
            machines, story.doing("flown", Interrupted()), story.doing("landing", error), said
        )
    assert story == ["flown", "landing", "stopped"] and words in said[-1]


def test_a_flight_that_fails_stops_everything_and_says_why(tmp_path):
    story = Story()
    with pytest.raises(MachineError, match="uav1 stopped by itself"):
        failing = story.doing("flown", MachineError("uav1 stopped by itself"))
        flights._fly(story.machines(tmp_path), failing, story.doing("landed"), Said())
    assert story[-2:] == ["flown", "stopped"]


@pytest.mark.parametrize("lands_after_s, words", [(3.0, "landed"), (1e9, "not landed after 45 s")])
def test_landing_a_fleet_is_asked_for_once_and_waited_for(monkeypatch, lands_after_s, words):
    clock, said, asked_s = Clock(), Said(), []
    monkeypatch.setattr(flights, "time", clock)

    class Watch:
        landed = property(lambda _self: bool(asked_s) and clock.now_s >= asked_s[0] + lands_after_s)

        def abort(self):
            asked_s.append(clock.now_s)

        def vehicles_line(self):
            return "uav1 LAND, 2.0 m"

    flights._land_fleet(Watch(), said)
    assert len(asked_s) == 1 and said == [words] and clock.now_s <= 1046.0
    assert set(said.shown_words) == {"landing: uav1 LAND, 2.0 m"}
    if words == "landed":
        flights._land_fleet(Watch(), said)  # on the ground already
    flights._land_fleet(None, said)  # interrupted before there was a mission
    assert len(asked_s) == 1 and said == [words]


def test_a_mission_node_that_ends_at_its_start_ends_the_demo_at_once_with_what_it_said(
    tmp_path, monkeypatch
):
    """roslaunch would start it again and again. One that lived and is started again in flight is
    none."""
    log, clock = tmp_path / "control.log", Clock()
    monkeypatch.setattr(flights, "time", clock)
    log.write_text(
        "process[mission-3]: started with pid [7]\nmission: /tmp/m.yaml: configurations: is empty\n"
        "\x1b[31m[mission-3] process has died [pid 7, exit code 2]\x1b[0m\n[mission-3] restarting process\n"
    )
    machines = object.__new__(SimulatedTellos)
    machines.launches = {"control": SimpleNamespace(log=log, returncode=None)}
    machines.meanwhile = lambda _phase: None
    watch = SimpleNamespace(
        over=False, aborted=False, landed=True, phase=None, states={}, starting=False
    )
    with pytest.raises(
        MachineError,
        match=r"(?s)mission node ended at its start.*m\.yaml: configurations: is empty$",
    ):
        flights._follow(machines, watch, print)
    assert clock.now_s < 1001.0
    watch.phase, machines.plan = 0, SimpleNamespace(run_folder=tmp_path)
    watch.landed, watch.abort = False, lambda: setattr(watch, "landed", True)
    with pytest.raises(MachineError, match="did not end within 900 s"):
        flights._follow(machines, watch, print)


def test_a_machine_that_gets_too_busy_in_flight_lands_everybody_and_says_why(monkeypatch):
    clock, said = Clock(), Said()
    monkeypatch.setattr(flights, "time", clock)

    def crowded(_watch):
        if clock.now_s > 1005.0:
            raise MachineTooBusy("the machine is too busy to fly: other programs take 90 %")

    monkeypatch.setattr(flights.CrowdWatch, "look", crowded)
    machines = SimpleNamespace(require_alive=lambda: None, meanwhile=lambda _phase: None)
    watch = SimpleNamespace(over=False, landed=False, phase=5, states={}, starting=False)
    watch.abort = lambda: setattr(watch, "landed", True)
    with pytest.raises(MachineTooBusy, match="too busy to fly"):
        flights._follow(machines, watch, said)
    assert watch.landed and said == ["landed"] and clock.now_s < 1006.0


# ---- Tellos before a tracker ---------------------------------------------------------------------


@pytest.mark.parametrize("otherwise", ["", "no namespaces without root; so they are on loopback"])
def test_tellos_are_flown_by_the_mission_where_they_are_and_said_where_that_is_not_a_namespace(
    monkeypatch, otherwise
):
    """Their places outlive the flight, whatever becomes of it."""
    story, said = Story(), Said()

    @contextlib.contextmanager
    def places(vehicles):
        story.append(vehicles)
        try:
            yield {"tello1": "there"}, otherwise
        finally:
            story.append("gone")

    def fly(machines, _say):
        story.append(machines)
        raise MachineError("the mission was aborted")

    monkeypatch.setattr(flights, "places", places)
    monkeypatch.setattr(flights, "SimulatedTellos", lambda _plan, site, where: (site, where))
    monkeypatch.setattr(flights, "_fly_mission", fly)
    with pytest.raises(MachineError, match="aborted"):
        flights.fly_tellos("site", SimpleNamespace(vehicles=("tello1",)), said)
    assert story == [("tello1",), ("site", {"tello1": "there"}), "gone"]
    assert said == ([f"Tellos: {otherwise}"] if otherwise else [])


def test_a_tracker_that_starts_late_is_started_once_when_they_hover_before_it(tmp_path):
    launched = []
    machines = object.__new__(SimulatedTellos)
    machines.plan = SimpleNamespace(
        sim_folder=tmp_path, vehicles=("tello1", "tello2"), seed=1, rviz=False
    )
    machines._site, machines.launches = GIMBAL_SITE, {}
    control = SimpleNamespace(launch=lambda _package, name, **_: launched.append(name) or name)
    machines.machines = {"control": control}
    for phase in (None, PHASES.index("TAKE_OFF"), PHASES.index("COLUMN"), PHASES.index("COLUMN")):
        assert not launched or phase == PHASES.index("COLUMN")
        machines.meanwhile(phase)
    assert launched == ["gimbal.launch"]

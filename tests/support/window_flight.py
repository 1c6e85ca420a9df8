# SPDX-License-Identifier: Apache-2.0
"""A mission flown from the operator's window on a screen, by mouse and keys, from its list to the
open report.

Pilots are simulated, buttons are not pressed by anybody else. The window is opened three times:
before the fleet is there, for the list; beside it; and in flight, after it was killed.
"""

import json
import math
import os
import re
import time
import xmlrpc.client
from pathlib import Path
from typing import Any, Callable, Dict, Optional, Tuple

from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.missions.mission import load_mission
from fcsv_sim.machines.slow_motion import Page
from fcsv_sim.people.operator import ButtonPresser, Field, Pilot, PilotSight
from fcsv_sim.truth import TruthReader
from support.console_window import FIELD, LABEL, Window
from support.demos import FLIGHT_LIMIT_S, end, said, start_demo
from support.screen import Hands, Screen

VEHICLES = ("uav1", "uav2")
DRAGGED, FROM_M, TO_M = 2, 7.0, 8.0  # the configuration whose goal is dragged, from where to where
GATHERED_MAP = "map_gathered"  # folder of the map that is made from the window
HELD_S, TOO_SHORT_S = 1.4, 0.4  # a button that wants a second
_RETURN_S = 2.0  # between one Return and the next
_BROWSER = """#!/bin/sh
printf '%s\\n' "$1" >>"{opened}"
"""
_MISSION = re.compile(r"^(?P<phase>\w+)(, waits for (?P<waits>\w+))?(: |$)")


class Eyes:
    """Whoever sits at the window sees the vehicles, too, and presses once they are where they
    should be."""

    def __init__(self, sim_folder: Path, mission_file: Path):
        mission = load_mission(mission_file)
        field = Field(home_height_m=mission.home_height_m, spacing_m=mission.column_spacing_m)
        self._pilots = [Pilot(i, field, 1) for i in range(len(VEHICLES))]
        self._truth = {n: TruthReader(sim_folder, n) for n in VEHICLES}
        self._presser = ButtonPresser()

    def press(self, now_s: float, phase: str, waits_for: str) -> bool:
        try:
            seen = {
                n: PilotSight(t.latest()[1], t.velocity(), True, "") for n, t in self._truth.items()
            }
        except PoseUnavailable:
            return False
        return self._presser.press(now_s, waits_for, phase, seen, self._pilots)


class WindowFlight:
    """``fly`` leaves in ``out`` what a demo leaves; gives what the operator saw and what was
    opened."""

    def __init__(self, out: Path, short_mission: Path):
        self._out, self._mission = out, out / "mine.yaml"
        text = short_mission.read_text()
        assert f"baseline_m: {TO_M}" in text
        self._mission.write_text(text.replace(f"baseline_m: {TO_M}", f"baseline_m: {FROM_M}"))
        self._screen = Screen(out)
        self._hands = Hands(self._screen)
        self._env = self._environment()
        self._window: Optional[Window] = None
        self._demo, self._eyes = None, Eyes(out / "run" / "sim", self._mission)
        self._asked_s: Dict[Tuple[str, str], float] = {}  # lines that were accepted, and when
        self.seen: Dict[str, Any] = {}

    def fly(self) -> Dict[str, Any]:
        try:
            self._make_the_list()
            self._start()
            self._check_and_rehearse()
            self._calibrate_and_set_home()
            self._execute()
            self._window_dies()
            self._pause_and_resume()
            self._land()
            self._gather_map_report()
            self._export()
            self._demo_ends()
        except BaseException:
            self._picture("failed")
            raise
        finally:
            self._close()
        return self.seen

    # ---- the story -------------------------------------------------------------------------------

    def _make_the_list(self) -> None:
        """Without a master: a goal is dragged, the list is saved."""
        window = self._open(
            "list", "--vehicles", ",".join(VEHICLES), "--mission", str(self._mission)
        )
        begin, end = (window.ask(what="place", home_m=(0.0, -y_m)) for y_m in (FROM_M, TO_M))
        self._hands.drag(begin, end)
        time.sleep(0.3)
        self.seen["dragged while it is locked"] = window.text("Mission file") != self._mission.name
        self._window.key("d")
        self._hands.drag(begin, end)
        window.until(
            lambda: "changed and not saved" in window.text("Mission file"), "the goal was dragged"
        )
        self._picture("list")
        window.click("Save")
        window.until(lambda: window.text("Mission file") == self._mission.name, "the list is saved")
        self.seen["list closed"] = window.close()
        self._window = None

    def _start(self) -> None:
        self._demo = start_demo(
            self._out, "--mission", str(self._mission), "--seed", "1", "--operator", "you"
        )
        fleet = self._until(self._fleet, "the masters are up", 300.0)
        of_uav1, control = (
            xmlrpc.client.ServerProxy(fleet[n]["ROS_MASTER_URI"]) for n in ("uav1", "control")
        )
        # before the node that reads it is there: a line that is amber on every machine
        of_uav1.setParam("/window_flight", "/uav1/vehicle_check/rules/amber_disk_mib", 1e9)
        self._until(
            lambda: control.hasParam("/window_flight", "/mission/memory_dir")[2],
            "the mission is started",
            60.0,
        )
        self._env.update(
            {k: v for k, v in fleet["control"].items() if k.isupper()}, ROS_IP="127.0.0.1"
        )
        if "FCSV_SLOW_MOTION" in self._env:
            self._hands.clock = Page(self._env["FCSV_SLOW_MOTION"]).now_s
        self._open("check")

    def _check_and_rehearse(self) -> None:
        window = self._window
        self._until(lambda: window.rows("Flight check"), "the check-list is shown", 120.0)
        self._picture("check")
        why = lambda: window.find("Execute")["why"]  # noqa: E731
        self._until(lambda: "mission node is not heard" not in why(), "the mission is heard", 60.0)
        window.click("Rehearse")
        self.seen["locked"] = why()

    def _calibrate_and_set_home(self) -> None:
        """By a key and by the mouse, once vehicles are where they should be; one that is refused is
        asked for again."""
        press = {
            "calibrate": lambda: self._window.key("c"),
            "set_home": lambda: self._window.click("Set home"),
        }

        def set_home() -> bool:
            phase, waits_for = self._headline()
            if waits_for in press and self._eyes.press(self._hands.clock(), phase, waits_for):
                press[waits_for]()
                self._until(
                    lambda: self._headline()[1] != waits_for, f"'{waits_for}' is confirmed", 60.0
                )
            return waits_for == "execute"

        self._until(set_home, "home is set", 400.0)

    def _execute(self) -> None:
        """A slip does nothing; a second hands the vehicles over and flies the list."""
        window = self._window
        self._until(lambda: window.enabled("Execute"), "the list may be flown", 240.0)
        self.seen["rehearsal"] = window.text("Rehearsal")
        self._picture("ready")
        window.click("Execute", seconds=TOO_SHORT_S)
        time.sleep(1.0)
        self.seen["after a slip"] = self._headline()
        window.click("Execute", seconds=HELD_S)
        self._until(lambda: self._headline()[0] == "CONFIGURATIONS", "the list is flown", 60.0)

    def _window_dies(self) -> None:
        """Killed at the first configuration; another one is opened, and shows where everything
        is."""
        kept = lambda: "".join(  # noqa: E731
            p.read_text() for p in (self._out / "session").glob("console_events_*.csv")
        )
        self._until(
            lambda: "it is flown" in kept(), "the first window kept what was asked for", 60.0
        )
        before = len(said(self._out))
        self._window.kill()
        window = self._open("flight", "--session", str(self._out / "session"))
        self._until(
            lambda: self._headline()[0] == "CONFIGURATIONS", "the new window knows the phase", 30.0
        )
        unknown = lambda: [  # noqa: E731
            w for w in window.of_vehicle("flown by") if "not heard" in w or w == "waiting"
        ]
        self._until(lambda: not unknown(), "it knows who flies", 30.0)
        self._until(
            lambda: (
                not [
                    w
                    for w in window.of_vehicle("in home")
                    if not w.startswith(("+", "-")) or "old" in w
                ]
            ),
            "the new window knows where the vehicles are",
            30.0,
        )
        self.seen["new window"] = {
            label: window.of_vehicle(label) for label in ("flown by", "in home", "mode")
        }
        self.seen["new window"]["running"] = [
            row for row in window.rows("Configurations") if row[0].startswith(">")
        ]
        self.seen["said without a window"] = said(self._out)[before:]
        self._picture("flight")

    def _pause_and_resume(self) -> None:
        window = self._window
        self._until(
            lambda: "on its way" in self._says() and window.enabled("Pause"),
            "there is a way",
            120.0,
        )
        self._window.key("p")
        self._until(lambda: self._headline()[1] == "resume", "it is paused", 30.0)
        self._picture("paused")
        self._until(lambda: window.enabled("Resume"), "it can be resumed", 60.0)
        self._window.key("g", TOO_SHORT_S)
        time.sleep(1.0)
        self.seen["after a slip of the key"] = self._headline()
        self._window.key("g", HELD_S)
        self._until(lambda: self._headline() == ("CONFIGURATIONS", ""), "it goes on", 60.0)

    def _land(self) -> None:
        """Until the bags are closed; the demo goes on, with its own map."""
        self._until(
            lambda: self._headline()[0] in ("LAND", "DONE"), "the list is flown", FLIGHT_LIMIT_S
        )
        self._until(lambda: "session: " in said(self._out), "the machines are off", 200.0)

    def _gather_map_report(self) -> None:
        """The machines are off; their bags are where they recorded. The map stands beside the
        demo's own."""
        window, session = self._window, self._out / "session"
        self._window.key("F5")
        self._until(lambda: window.enabled("Map"), "the bags are closed", 60.0)
        self.seen["places"] = [window.text(name, FIELD) for name in ("Machines", "Session", "Map")]
        self.seen["nothing to gather"] = window.find("Gather")["why"]
        self.seen["over"] = self._says()
        self._picture("after")
        window.write("Session", str(self._out / "flight"))
        window.write("Machines", " ".join(f"{name}={session}" for name in (*VEHICLES, "control")))
        window.write("Map", str(self._out / GATHERED_MAP))
        window.click("Gather")
        window.until(
            lambda: window.text("What gather said").startswith(("done", "FAILED")),
            "it gathered",
            180.0,
        )
        self.seen["gathered"] = window.text("What gather said")
        window.click("Map")
        window.until(
            lambda: window.text("What map said").startswith(("done", "FAILED")), "it mapped", 400.0
        )
        self.seen["mapped"] = window.text("What map said")
        window.click("Report")
        window.until(lambda: window.text("What report said"), "the report was opened")
        window.until((self._out / "opened").exists, "the browser has it")
        self.seen["opened"] = (self._out / "opened").read_text().split()
        self._picture("report")

    def _export(self) -> None:
        """To a path that is typed: once the dialog is there, and once it has all letters."""
        window, path = self._window, self._out / "events.csv"
        typed = lambda: window.ask(what="typed in a dialog")  # noqa: E731
        self._window.key("F3")
        window.until(lambda: window.ask(what="dialog"), "it asks where to")
        self._hands.focus(window.ask(what="id"))
        window.until(lambda: typed() is not None, "its field has the focus")
        self._hands.select_all()
        self._hands.write(str(path))
        window.until(lambda: typed() == str(path), "the path is typed")
        self._picture("export")
        self._press_return_until(path.exists)
        self.seen["closed"] = window.close()
        self._window = None

    def _press_return_until(self, done: Callable[[], bool]) -> None:
        """The first closes the list of completions, where that has come up meanwhile."""
        pressed_s = [-math.inf]

        def again() -> bool:
            if (
                not done()
                and time.monotonic() - pressed_s[0] > _RETURN_S
                and self._window.ask(what="dialog")
            ):
                pressed_s[0] = time.monotonic()
                self._window.key("Return")
            return done()

        self._window.until(again, "the events are exported")

    def _demo_ends(self) -> None:
        """With its map, made meanwhile."""
        status = self._demo.wait(FLIGHT_LIMIT_S)
        assert status == 0, said(self._out)[-4000:]

    # ---- what it stands on -----------------------------------------------------------------------

    def _environment(self) -> Dict[str, str]:
        """Of a desktop whose browser writes down what it is to open."""
        browser = self._out / "bin" / "xdg-open"
        browser.parent.mkdir()
        browser.write_text(_BROWSER.format(opened=self._out / "opened"))
        browser.chmod(0o755)
        return {
            **os.environ,
            "DISPLAY": self._screen.name,
            "QT_QPA_PLATFORM": "xcb",
            "PYTHONUNBUFFERED": "1",
            "ROS_MASTER_URI": "http://127.0.0.1:1",
            "XDG_CONFIG_HOME": str(self._out / "config"),
            "PATH": f"{browser.parent}:{os.environ['PATH']}",
        }

    def _open(self, name: str, *args: str) -> Window:
        self._window = Window(
            self._hands, self._env, self._out / f"window_{name}.log", "--theme", "dark", *args
        )
        return self._window

    def _fleet(self) -> Optional[dict]:
        try:
            return json.loads((self._out / "run" / "fleet.json").read_text())
        except (OSError, ValueError):
            return None

    def _says(self) -> str:
        return self._window.text("What the mission does", LABEL)

    def _headline(self) -> Tuple[str, str]:
        """Phase and what it waits for, as a screen reader reads them; of a pause that ends by
        itself ("PAUSED", "")."""
        headline = self._window.find("What the mission does", LABEL) or {
            "text": "",
            "described": "",
        }
        found = _MISSION.match(headline["described"])
        phase, waits_for = (found["phase"], found["waits"] or "") if found else ("", "")
        return (
            ("PAUSED", "")
            if headline["text"].startswith("PAUSED") and not waits_for
            else (phase, waits_for)
        )

    def _until(self, condition: Callable[[], Any], what: str, limit_s: float) -> Any:
        """What it gives in the end; meanwhile amber lines are accepted, by name."""
        deadline_s = time.monotonic() + limit_s
        while True:
            found = condition()
            if found:
                return found
            assert self._demo.poll() is None, (
                f"the demo ended before {what}:\n{said(self._out)[-3000:]}"
            )
            assert time.monotonic() < deadline_s, (
                f"it never was so that {what}:\n{said(self._out)[-3000:]}"
            )
            self._accept_one()
            time.sleep(0.1 if self._window else 0.02)

    def _accept_one(self) -> None:
        """By its name; the table takes a second to show it."""
        for k, (who, name, state, *_) in enumerate(
            self._window.rows("Flight check") if self._window else ()
        ):
            if state == "amber" and time.monotonic() - self._asked_s.get((who, name), -60.0) > 3.0:
                self._asked_s[who, name] = time.monotonic()
                self._window.choose("Flight check", k)
                time.sleep(0.2)
                if self._window.enabled("Accept line"):  # else it is not amber any more
                    self._window.click("Accept line")
                return

    def _picture(self, name: str) -> None:
        try:
            self._window.picture(self._out / f"window_{name}.png")
        except (AssertionError, AttributeError):
            pass  # there is no window

    def _close(self) -> None:
        if self._window is not None:
            self._window.kill()
        if self._demo is not None:
            end(self._demo)
        self._hands.close()
        self._screen.close()

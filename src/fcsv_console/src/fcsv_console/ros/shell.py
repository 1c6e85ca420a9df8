# SPDX-License-Identifier: Apache-2.0
"""The console on a ROS master: facts in, commands out. The master may be away at the start, and
later."""

import math
import shlex
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Deque, Dict, List, Optional, Sequence, Tuple

import rosgraph
import rospy

from fcsv_console.children.after import AfterRunner
from fcsv_console.children.rehearse import Rehearser
from fcsv_console.model import facts as f
from fcsv_console.model.actions import OF_STATIONS
from fcsv_console.model.after import DONE, FAILED, REPORT, Places
from fcsv_console.model.console import Console
from fcsv_console.model.rehearsal import RUNS
from fcsv_console.model.view import ConsoleView
from fcsv_console.ros.commands import CommandClient
from fcsv_console.ros.epipolar import EpipolarHearing
from fcsv_console.ros.event_file import EventFile
from fcsv_console.ros.goal_markers import GoalMarkers
from fcsv_console.ros.ground_views import GroundViewHearing
from fcsv_console.ros.guided_robot import GuidedRobotHearing
from fcsv_console.ros.hearing import NO_MASTER, Hearing
from fcsv_console.ros.window_turns import WindowTurns
from fcsv_geometry.programs.workspace import bringup
from fcsv_geometry.ros import node
from fcsv_geometry.streams.arrivals import Arrivals
from fcsv_geometry.vehicles.vehicle import load_vehicles

_LOOK_S = 0.5
_LOOK_AT_DISK_S = 2.0
_CONTROL = ("pause", "skip", "repeat", "next", "previous", *OF_STATIONS, "abort")


@dataclass(frozen=True)
class Fleet:
    """``vehicles``: the column, front first; ``mission``: path of the mission file, empty: none."""

    vehicles: List[str]
    tags: Dict[str, int]
    mission: str = ""
    session_dir: str = ""


def fleet(vehicles: Sequence[str] = (), mission: str = "", vehicles_dir: str = "") -> Fleet:
    """What is given, else what the mission node was started with, else uav1 and uav2. Raises
    ConfigError."""
    told = _parameters()
    names = list(vehicles) or list(told.get("vehicles", ())) or ["uav1", "uav2"]
    folder = vehicles_dir or told.get("vehicles_dir", "")
    if not folder:
        folder = str(bringup() / "config/vehicles")
    tags = {name: v.tag_id for name, v in load_vehicles(folder, names).items()}
    return Fleet(
        names, tags, mission or str(told.get("mission", "")), str(told.get("memory_dir", ""))
    )


def _parameters() -> dict:
    """Gives the parameters of the node mission; empty where there is none, or no master."""
    try:
        found = rosgraph.Master("/fcsv_console").getParam("/mission")
    except (rosgraph.MasterException, OSError):
        return {}
    return found if isinstance(found, dict) else {}


class ConsoleShell:
    """``view`` takes in what came meanwhile; ``do`` asks for an action by name. Both of one thread;
    neither waits."""

    def __init__(
        self,
        console: Console,
        name: str,
        recorded: bool = False,
        windowed: bool = False,
        arrivals: Optional[Arrivals] = None,
    ):
        self.console, self._name, self._windowed = console, name, windowed
        self._goals: Optional[GoalMarkers] = None
        self._turns: Optional[WindowTurns] = None
        self._ground_views: Optional[GroundViewHearing] = None
        self._robot: Optional[GuidedRobotHearing] = None
        self._hearing, self._commands = Hearing(console.names, recorded, arrivals), None
        self._rehearser = Rehearser(self._hearing.put, console.names)
        self.events: Optional[EventFile] = None
        self._after, self._looked_s = AfterRunner(self._hearing.put), -math.inf
        self._epipolar = EpipolarHearing(console.names, self._hearing.put)
        self._over = threading.Event()
        self._answers: Deque[Tuple[int, str, bool]] = deque()
        threading.Thread(target=self._join, name="joins the master", daemon=True).start()

    def _join(self) -> None:
        """Waits for a master as long as it takes. rospy would wait too, and then keep the process
        from ending."""
        while not rosgraph.is_master_online():
            self._hearing.put(f.MasterReport(NO_MASTER))
            if self._over.wait(_LOOK_S):
                return
        try:
            node.begin(self._name, anonymous=True, disable_signals=True)
        except rospy.exceptions.ROSInitException:
            if self._over.is_set():  # the window was closed meanwhile
                return
            raise
        self._commands = CommandClient(self.console.names)
        self._hearing.subscribe()
        self._epipolar.subscribe()
        if self._windowed:
            self._turns = WindowTurns(self._hearing.put)
            self._goals = GoalMarkers(self._hearing.put)
            self._ground_views = GroundViewHearing(self._hearing.put)
            self._robot = GuidedRobotHearing(self._hearing.put)
        self._hearing.put(f.MasterReport())

    def view(self) -> ConsoleView:
        """Gives the view of this moment."""
        self.console.wall_offset_s = time.time() - time.monotonic()
        for at_s, fact in self._hearing.drain():
            self.console.tell(at_s, fact)
        while self._answers:
            self.console.answer(*self._answers.popleft())
        if self._windowed:
            self.look_again()
        view = self.console.view(time.monotonic())
        if self.events is not None:
            self.events.keep(view.now_s, self.console.log)
        self._epipolar.pair = view.stereo.pair
        if self._goals is not None:
            mine = self._turns.mine()
            self._goals.show(view.goals if view.home_set and mine else ())
        return view

    def do(self, name: str, **given) -> None:
        """An action of actions.TABLE, or "accept" with ``vehicle`` and ``line``; its answer becomes
        an event."""
        if name == "rehearse":
            self._rehearse()
            return
        if name == "waive":
            self.console.waive(time.monotonic())
            return
        words = f"accept {given['vehicle']} {given['line']}" if name == "accept" else ""
        number = self.console.ask(time.monotonic(), name, words)

        def answer(told: str, done: bool) -> None:
            self._answers.append((number, told, done))

        if self._commands is None:
            answer(NO_MASTER, False)
            return
        self._send(self._commands, name, answer, given)

    def keep_events(self, folder: str) -> None:
        """Keeps the events in a file of that folder."""
        self.events = EventFile(Path(folder), self._hearing.put, time.time())

    def name_places(self, places: Places) -> None:
        """Where things are after the flight."""
        self.console.after.places = places
        self._looked_s = time.monotonic()
        self._after.look(places)

    def look_again(self) -> None:
        """Looks at what is on the disk by now: others record and map, too."""
        if time.monotonic() - self._looked_s > _LOOK_AT_DISK_S:
            self.name_places(self.console.after.places)

    def after(self, step: str, places: Places) -> None:
        """Begin "gather" or "map", or stop the one that runs."""
        runs = next(
            (s.state == RUNS for s in self.console.view(time.monotonic()).after if s.name == step),
            False,
        )
        self._after.cancel(step) if runs else self._after.start(step, places)

    def report_opened(self, page: Path, opened: bool) -> None:
        """Whether the desktop took it; where it did not, the operator is told where the page is."""
        words = str(page) if opened else f"no browser opens here; the page is {page}"
        self._hearing.put(f.JobProgress(REPORT, DONE if opened else FAILED, words=words))

    def _rehearse(self) -> None:
        """The list that is shown; or end the one that runs."""
        if self.console.view(time.monotonic()).rehearsal.state == RUNS:
            self._rehearser.cancel()
        else:
            self._rehearser.start(self.console.file.text)

    def _send(self, commands: CommandClient, name: str, answer, given: dict) -> None:
        if name in ("stop_all", "land"):
            commands.everybody("stop_all" if name == "stop_all" else "land_all", answer)
        elif name in _CONTROL:
            commands.control(name, answer)
        elif name == "accept":
            commands.accept(given["vehicle"], given["line"], answer)
        elif name == "execute":
            commands.execute(given.get("configurations", ()), answer)
        elif name == "record":
            commands.record(not self._recording(), answer)
        else:
            commands.proceed(self._step(name), answer)

    def _step(self, name: str) -> str:
        """Names the step of the mission: handing over confirms whichever it waits for."""
        told = self.console.view(time.monotonic()).mission.value
        return (told.waits_for if told is not None else "") if name == "hand_over" else name

    def _recording(self) -> bool:
        rows = self.console.view(time.monotonic()).vehicles
        return any(v.recorder.value is not None and v.recorder.value.pictures_on for v in rows)

    def close(self) -> None:
        """Leave the master."""
        self._over.set()
        self._rehearser.close()
        self._after.close()
        if self.events is not None:
            self.events.close(self.console.log)
        self._epipolar.close()
        if self._turns is not None:
            self._turns.close()
        if self._ground_views is not None:
            self._ground_views.close()
        if self._robot is not None:
            self._robot.close()
        self._hearing.close()
        rospy.signal_shutdown("the console was closed")


def open_shell(
    name: str,
    vehicles: Sequence[str],
    mission: str,
    target_m: float,
    windowed: bool = False,
    vehicles_dir: str = "",
    recorded: bool = False,
    session: str = "",
) -> ConsoleShell:
    """Opens a shell with the fleet that is found; ``windowed``: it keeps its events with the
    session, and its goals stand in rviz.

    ``recorded``: a bag is played, and pictures come as vehicles record them. ``session``: a folder
    into which all machines record; empty: each records into its own.

    Raises ConfigError where a vehicle file cannot be used.
    """
    found = fleet(vehicles, mission, vehicles_dir)
    arrivals = Arrivals()
    console = Console(
        found.vehicles, found.tags, target_m=target_m, since_s=arrivals.since_s, recorded=recorded
    )
    if found.mission:
        console.load(found.mission)
    shell = ConsoleShell(console, name, recorded, windowed, arrivals)
    shell.name_places(shared_places(session) if session else usual_places(found))
    if windowed and (session or found.session_dir):
        shell.keep_events(session or found.session_dir)
    return shell


def shared_places(session: str) -> Places:
    """Gives the places of a folder into which all machines record, as in a simulation: nothing is
    to be gathered."""
    folder = Path(session).expanduser()
    return Places("", str(folder), str(folder.parent / "map"))


def usual_places(found: Fleet) -> Places:
    """Each vehicle by its name as a host, with what ``uav.launch`` records there; the map stands
    beside the session."""
    own = found.session_dir or str(Path.home() / "fcsv/session")
    sources = [f"{name}={name}:fcsv/session" for name in found.vehicles] + [
        f"control={shlex.quote(own)}"
    ]
    beside = Path(own).parent
    return Places(" ".join(sources), str(beside / "flight"), str(beside / "map"))

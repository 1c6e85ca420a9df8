# SPDX-License-Identifier: Apache-2.0
"""What the operator can do now, and why not where he cannot. Asking for it is the shell's work."""

from dataclasses import dataclass, replace
from typing import Dict, Optional, Sequence, Tuple

from fcsv_console.model import facts as f
from fcsv_console.model.mission_file import MissionFile, differs
from fcsv_console.model.rehearsal import RUNS, Rehearsal
from fcsv_console.model.vehicles import VehicleRow
from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_geometry.missions.mission import Mission
from fcsv_geometry.missions.phases import FLOWN, OVER


@dataclass(frozen=True)
class Action:
    """``why_not`` is empty where it can be asked for; ``hold_s``: for so long a button or key is
    held."""

    name: str
    title: str
    key: str
    does: str
    why_not: str = ""
    hold_s: float = 0.0

    @property
    def enabled(self) -> bool:
        return not self.why_not

    @property
    def tooltip(self) -> str:
        """What it does, its key, and why it cannot be done."""
        hold = f", held for {self.hold_s:g} s" if self.hold_s else ""
        return f"{self.does} [{self.key}{hold}]" + (
            f"\nNot now: {self.why_not}" if self.why_not else ""
        )


#: name, title, key, what it does, for how long it is held (s)
TABLE = (
    (
        "calibrate",
        "Calibrate",
        "C",
        "Calibrate: find out where the vehicles are against each other",
        0.0,
    ),
    ("set_home", "Set home", "H", "Set home at the reference camera", 0.0),
    ("hand_over", "Hand over", "G", "Hand the vehicles over to the mission: GUIDED", 1.0),
    (
        "execute",
        "Execute",
        "X",
        "Hand over and fly the chosen configurations; none chosen: all",
        1.0,
    ),
    (
        "rehearse",
        "Rehearse",
        "V",
        "Fly the list as it is shown in simulation; while that runs: stop it",
        0.0,
    ),
    (
        "waive",
        "Unrehearsed",
        "W",
        "Fly the list as it is shown though its rehearsal did not pass",
        1.0,
    ),
    ("previous", "Previous", "B", "Fly the configuration before once more", 0.0),
    ("next", "Next", "N", "Fly another configuration first, this one last", 0.0),
    ("pause", "Pause", "P", "Everybody holds", 0.0),
    ("skip", "Skip", "K", "Leave the running configuration out", 0.0),
    ("repeat", "Repeat", "R", "Begin the running configuration again", 0.0),
    ("skip_station", "Skip station", "J", "Leave out what is left at the running station", 0.0),
    ("repeat_station", "Repeat station", "T", "Begin the running station again", 0.0),
    ("resume_station", "Resume station", "O", "Fly on where the flight before stopped", 0.0),
    ("abort", "Abort", "A", "Land all whom the mission flies, where they are", 0.0),
    ("record", "Record", "E", "Pictures on or off, by hand", 0.0),
    ("land", "Land all", "L", "Everybody lands where he is, without the mission", 0.5),
    ("stop_all", "STOP ALL", "Space", "Everybody brakes and stands, without the mission", 0.5),
)


#: actions on the running station
OF_STATIONS = ("skip_station", "repeat_station", "resume_station")


def has_stations(mission: Optional[Mission]) -> bool:
    """Whether a mission is known, and is flown from stations."""
    return mission is not None and bool(mission.stations)


@dataclass(frozen=True)
class ActionContext:
    """Is that by which the actions are judged, not by what the actions are judged."""

    master_problem: str
    mission: Optional[f.MissionReport]  # None: not heard
    lines: Optional[Sequence[Line]]  # None: no check is heard
    vehicles: Sequence[VehicleRow]
    column: Sequence[str]  # why not every tag is seen, a line per vehicle
    pending: Sequence[str]  # asked for and not answered yet
    file: MissionFile
    rehearsal: Rehearsal
    flown: Optional[Mission] = None  # as the mission node read it; None: not heard
    recorded: bool = False  # a recording is played
    over: str = ""  # the phase in which a mission ended that is not heard any more


def actions(s: ActionContext) -> Dict[str, Action]:
    """Gives the actions by name, in the order of the table. Stop-all is always enabled, but for
    where a recording is played."""
    found = {
        name: Action(name, title, key, does, _why_not(name, s), hold_s)
        for name, title, key, does, hold_s in TABLE
    }
    if paused(s.mission):
        found["hand_over"] = replace(found["hand_over"], title="Resume", does="Go on with the list")
    return found


def paused(mission: Optional[f.MissionReport]) -> bool:
    """Whether the mission goes on when the operator says so."""
    return mission is not None and mission.waits_for == "resume"


def accept(line: Line, master_problem: str = "") -> Action:
    """Accepting one line of the flight check by its name."""
    if master_problem:
        why = master_problem
    elif line.accepted:
        why = "it is accepted"
    elif line.state is not Grade.AMBER:
        why = f"it is {line.state.word}: only amber lines are accepted"
    else:
        why = ""
    return Action(
        "accept", f"Accept {line.vehicle} {line.name}", "Enter", "Fly with it as it is", why
    )


def _why_not(name: str, s: ActionContext) -> str:
    if name in ("rehearse", "waive"):
        return _of_rehearsal(name, s)
    if s.recorded:
        return "a recording is played: nobody flies"
    if name == "stop_all":
        return ""
    if s.over:
        return f"the mission is over ({s.over})"
    if s.master_problem:
        return s.master_problem
    if name in s.pending:
        return "it was asked for; the answer has not come yet"
    if name == "land":
        down = bool(s.vehicles) and all(
            v.state.value is not None and not v.heard.stale and not v.armed for v in s.vehicles
        )
        return "all stand with their motors off" if down else ""
    if name == "record":
        return (
            "the mission records by itself"
            if s.mission is not None and s.mission.phase in FLOWN
            else ""
        )
    if s.mission is None:
        return "the mission node is not heard: start it, or mend its file"
    return _of_mission(name, s, s.mission)


def _of_mission(name: str, s: ActionContext, m: f.MissionReport) -> str:
    if m.phase in OVER:
        return f"the mission is over ({m.phase})"
    if name == "abort":
        return ""
    if name == "resume_station":
        return _of_resuming(s, m)
    if name in ("pause", "skip", "repeat", "next", "previous", *OF_STATIONS):
        if m.phase not in FLOWN:
            return f"it is for vehicles that fly the list; this is {m.phase}"
        if name in OF_STATIONS and not has_stations(s.flown or s.file.mission):
            return "the mission has no stations"
        return "it is paused: Resume goes on" if name == "pause" and paused(m) else ""
    wanted = {"hand_over": ("execute", "resume"), "execute": ("execute",)}.get(name, (name,))
    if m.waits_for not in wanted:
        return _not_waited_for(name, s, m)
    if name in ("hand_over", "execute"):
        first = m.waits_for == "execute"
        return locked_by(s.lines, amber_too=first) or (_of_list(s, m) if first else "")
    return ""


def _of_resuming(s: ActionContext, m: f.MissionReport) -> str:
    """The mission itself refuses it where no flight before left a station."""
    if not has_stations(s.flown or s.file.mission):
        return "the mission has no stations"
    return _of_mission("execute", s, m)


def _of_list(s: ActionContext, m: f.MissionReport) -> str:
    """Why the list is not flown as it is shown."""
    if s.file.error is not None:
        return f"mission file: {s.file.error.words}"
    if m.configurations and s.file.rows and m.configurations != len(s.file.rows):
        return (
            f"the mission has {m.configurations} configurations, the list shown {len(s.file.rows)}: it reads its "
            "file when it starts"
        )
    other = differs(s.flown, s.file.mission)
    return (
        f"the mission flies another file: {other}; it reads its file when it starts"
        if other
        else s.rehearsal.locks
    )


def _of_rehearsal(name: str, s: ActionContext) -> str:
    if s.file.error is not None:
        return f"mission file: {s.file.error.words}"
    if s.rehearsal.state == RUNS:
        return "" if name == "rehearse" else "it is being rehearsed"
    if s.mission is not None and s.mission.phase in FLOWN:
        return "the mission flies its list"
    if s.file.mission is None:
        return "no mission file is shown"
    return "the list may be flown" if name == "waive" and not s.rehearsal.locks else ""


def _not_waited_for(name: str, s: ActionContext, m: f.MissionReport) -> str:
    if name == "calibrate" and m.phase == "COLUMN":
        return "; ".join(s.column) or "; ".join(m.problems) or "a tag is not in view"
    if name == "set_home" and m.phase in ("WAIT_VEHICLES", "TAKE_OFF", "COLUMN", "CALIBRATE"):
        return f"calibrate first ({m.phase})"
    if name in ("hand_over", "execute") and m.phase in FLOWN:
        return "the mission flies the vehicles already" if not m.problems else "; ".join(m.problems)
    if name in ("hand_over", "execute") and m.phase not in ("LAND",):
        return f"set home first ({m.phase})"
    waits = f"'{m.waits_for}' is waited for" if m.waits_for else "nothing is waited for"
    return f"{waits} in {m.phase}"


def locked_by(lines: Optional[Sequence[Line]], amber_too: bool) -> str:
    """Why the flight check hands over nobody, as the mission judges it; "" where it does."""
    if lines is None:
        return "the flight check is not heard"
    wrong = [li for li in lines if not li.passes and (amber_too or li.state is not Grade.AMBER)]
    if not lines:
        return "the flight check has no lines"
    named = [f"{li.vehicle} {li.name} {li.state.word}" for li in wrong[:3]]
    more = f" and {len(wrong) - 3} more" if len(wrong) > 3 else ""
    return f"flight check: {', '.join(named)}{more}" if wrong else ""


def column_problems(
    order: Sequence[str], sees: Sequence[Tuple[bool, Optional[float]]]
) -> Tuple[str, ...]:
    """Who does not see the tag of the vehicle in front, and since when.

    >>> column_problems(["uav1", "uav2"], [(False, 8.0)])
    ('uav2 does not see the tag of uav1 since 8 s',)
    """
    found = []
    for front, name, (now, since_s) in zip(order, order[1:], sees):
        if not now:
            how_long = "has never seen" if since_s is None else "does not see"
            since = "" if since_s is None else f" since {since_s:.0f} s"
            found.append(f"{name} {how_long} the tag of {front}{since}")
    return tuple(found)

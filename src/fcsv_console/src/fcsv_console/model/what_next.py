# SPDX-License-Identifier: Apache-2.0
"""Makes, from a view its guide: each phase has a line in words, a verdict on its figures, and at
most one next button."""

import math
from typing import Callable, Dict, List, Optional, Sequence, Tuple

from fcsv_console.model import facts as f
from fcsv_console.model.guide import ACCEPT, AFTER, CARE, LOST, PLAIN, WAITS, WELL, Guide
from fcsv_console.model.mission_file import seconds_left
from fcsv_console.model.view import ConsoleView
from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line
from fcsv_geometry.missions.phases import OVER
from fcsv_geometry.programs.durations import clock_words
from fcsv_stereo.model.inputs import FLOWN

_MOST_NAMES = 3


def guide(view: ConsoleView, before: str = "") -> Guide:
    """``before``: the phase that came before this one, "" where that is not known."""
    found = _guide(view, before)
    return Guide(f"RECORDING: {found.headline}", "", found.sort) if view.recorded else found


def _guide(view: ConsoleView, before: str) -> Guide:
    m = view.mission.value
    if m is None:
        if view.starting:
            return Guide(
                "Starting, normal for about a minute: no mission is heard yet",
                _rehearse(view),
                WAITS,
            )
        return Guide(
            "No mission is heard: start control.launch, or mend its mission file",
            _rehearse(view),
            CARE,
        )
    if m.phase in OVER:
        return Guide(
            f"{_sentence(m)}. The flight is over; {_after(view)}",
            AFTER,
            WELL if m.phase == "DONE" else CARE,
        )
    if not view.mission_alive:
        return Guide(f"THE MISSION IS NOT HEARD (was in {m.phase})", "", LOST)
    if m.waits_for == "resume":
        resume = view.actions["hand_over"]
        ends = "Resume goes on" if resume.enabled else f"Resume is locked: {resume.why_not}"
        why = f"PAUSED: {'; '.join(m.problems[:1]) or m.detail}".rstrip(": ")
        return Guide(f"{why}. {ends}", "hand_over" if resume.enabled else "", CARE)
    if m.phase == "CONFIGURATIONS" and m.problems:
        return Guide(f"PAUSED: {m.problems[0]}", "", CARE)
    return _OF_PHASE.get(m.phase, _other)(view, m, before)


def _other(view: ConsoleView, m: f.MissionReport, _before: str) -> Guide:
    waits = f", waits for {m.waits_for.replace('_', ' ').upper()}" if m.waits_for else ""
    return Guide(f"{m.phase}{waits}: {m.detail}".rstrip(": "))


def _sentence(m: f.MissionReport) -> str:
    return f"{m.phase}: {m.detail}".rstrip(": ")


def _after(view: ConsoleView) -> str:
    report = next((step for step in view.after if step.name == "report"), None)
    shown = report is not None and not report.why_not
    return "After [F5] opens its report" if shown else "After [F5] maps what was recorded"


def _rehearse(view: ConsoleView) -> str:
    """Rehearse, where that is what a list still lacks."""
    return "rehearse" if view.rehearsal.wanted and view.actions["rehearse"].enabled else ""


# ---- people fly ----------------------------------------------------------------------------------


def _wait_vehicles(view: ConsoleView, m: f.MissionReport, _before: str) -> Guide:
    """Lines that are normal at the start are counted; others are told, the worst first."""
    lines = view.check or ()
    left = [li for li in lines if not li.passes]
    wrong = [li for li in left if not view.waits(li)]
    if not lines:
        words = "the vehicles are not heard yet"
        return Guide(
            f"Starting, normal for about a minute: {words}"
            if view.starting
            else f"Not ready: {words}",
            _rehearse(view),
            WAITS if view.starting else CARE,
        )
    if not left:
        return Guide("; ".join(m.problems[:1]) or m.detail, _rehearse(view))
    amber = [li for li in wrong if li.state is Grade.AMBER]
    if wrong and len(amber) == len(left):
        return Guide(
            f"{_many(amber, 'amber line')} to accept or mend: {_named(amber)}", ACCEPT, CARE
        )
    red = [li for li in wrong if li.state is not Grade.AMBER]
    if red:
        first = max(red, key=lambda li: li.state)
        more = f"; {_many(left, 'check')} of {len(lines)} left" if len(left) > 1 else ""
        return Guide(
            f"Not ready: {first.vehicle} {first.name}: {first.what}{more}", _rehearse(view), CARE
        )
    return Guide(
        f"Starting, normal for about a minute: {_many(left, 'check')} of {len(lines)} to go ({_named(left)})",
        _rehearse(view),
        WAITS,
    )


def _many(lines: Sequence[Line], one: str) -> str:
    return f"{len(lines)} {one}{'' if len(lines) == 1 else 's'}"


def _named(lines: Sequence[Line]) -> str:
    more = f" and {len(lines) - _MOST_NAMES} more" if len(lines) > _MOST_NAMES else ""
    return ", ".join(f"{li.vehicle} {li.name}" for li in lines[:_MOST_NAMES]) + more


def _take_off(view: ConsoleView, m: f.MissionReport, _before: str) -> Guide:
    words = _sentences(view, m.problems[0] if m.problems else m.detail, _heights(view))
    return Guide(words, "", CARE) if m.problems else Guide(words, _rehearse(view))


def _column(view: ConsoleView, m: f.MissionReport, before: str) -> Guide:
    refused = before == "CALIBRATE"
    if m.waits_for == "calibrate":
        what = (
            f"Calibration refused: {m.detail}"
            if refused
            else "The column stands, every tag is in view"
        )
        return Guide(
            f"{what}. Hold still and Calibrate [C]", "calibrate", CARE if refused else WELL
        )
    missing = view.actions["calibrate"].why_not
    if m.problems:
        return Guide(_sentences(view, m.problems[0], _heights(view)), "", CARE)
    return Guide(_sentences(view, m.detail, missing), _rehearse(view), CARE if refused else PLAIN)


def _calibrate(_view: ConsoleView, _m: f.MissionReport, _before: str) -> Guide:
    return Guide("Calibrating: hold still", "", WAITS)


def _move_home(view: ConsoleView, m: f.MissionReport, before: str) -> Guide:
    """Says, after the calibration its figures; after a home that was refused, why."""
    reference = view.file.mission.reference if view.file.mission is not None else "the reference"
    then = f"Fly {reference} to its view, then Set home [H]"
    sort, calibrated = calibration_words(view.calibration)
    refused = before == "SET_HOME" or not calibrated
    ready = "set_home" if view.actions["set_home"].enabled else ""
    if m.problems:
        return Guide(_sentences(view, m.problems[0], then), ready, CARE)
    return Guide(
        _sentences(view, m.detail if refused else calibrated, then),
        ready,
        CARE if refused and calibrated else sort,
    )


def calibration_words(found: Optional[f.CalibrationReport]) -> Tuple[str, str]:
    """(sort, words with figures); no words where no calibration by tags is known.

    >>> link = f.CalibratedLink("uav2", "uav1", 25, 0, 0.012, math.radians(0.13))
    >>> calibration_words(f.CalibrationReport((link,)))
    ('well', 'Calibrated well: 25 views, 0.13°')
    """
    links = [li for li in found.links if li.used] if found is not None else []
    if not links:
        return PLAIN, ""
    worst = max(links, key=lambda li: li.yaw_std_rad)
    of = f" ({worst.child})" if len(links) > 1 else ""
    figures = f"{worst.used} views, {math.degrees(worst.yaw_std_rad):.2f}°{of}"
    most_deg = math.degrees(FLOWN.rotation_rad)
    if not worst.yaw_std_rad <= FLOWN.rotation_rad:
        return CARE, f"Calibrated poorly: {figures}; the map counts on {most_deg:.1f}°"
    if worst.rejected > worst.used:
        return CARE, f"Calibrated poorly: {figures}, {worst.rejected} views disagreed"
    return WELL, f"Calibrated well: {figures}"


def _set_home(view: ConsoleView, m: f.MissionReport, _before: str) -> Guide:
    if m.waits_for != "execute":
        return Guide("Setting home: hold still", "", WAITS)
    execute, mission = view.actions["execute"], view.file.mission
    if not execute.enabled:
        amber = [li for li in view.check or () if not li.passes]
        only_amber = amber and all(li.state is Grade.AMBER for li in amber)
        return Guide(
            f"Home is set. Execute is locked: {execute.why_not}",
            ACCEPT if only_amber else _rehearse(view),
            WAITS if view.rehearsal.runs else CARE,
        )
    takes = (
        clock_words(seconds_left(view.file, 0, len(view.vehicles))) if mission is not None else "-"
    )
    lasts = [v.endurance_s for v in view.vehicles if not math.isnan(v.endurance_s)]
    battery = f", batteries last {clock_words(min(lasts))}" if lasts else ""
    words = f"Home is set. Execute [X] flies {len(view.file.rows)} configurations in about {takes}{battery}"
    enough = all(v.battery_enough is not False for v in view.vehicles)
    return Guide(words, "execute", WELL if enough else CARE)


# ---- the mission flies ---------------------------------------------------------------------------


def _guided(_view: ConsoleView, m: f.MissionReport, _before: str) -> Guide:
    return Guide(
        f"Handing over: {m.problems[0] if m.problems else m.detail}".rstrip(": "),
        "",
        CARE if m.problems else PLAIN,
    )


def _configurations(view: ConsoleView, m: f.MissionReport, _before: str) -> Guide:
    number = f"{view.running + 1} of {len(view.file.rows)}: " if view.running is not None else ""
    stage = f", {view.stage.words}" if view.stage.words else ""
    return Guide(f"{number}{m.detail}{stage}" or "The list is flown")


def _land(view: ConsoleView, m: f.MissionReport, _before: str) -> Guide:
    what = _sentences(view, "; ".join(m.problems[:1]) or m.detail)
    heights = _heights(view)
    return Guide(
        f"Landing: {what}{f'. {heights}' if heights else ''}", "", CARE if m.problems else PLAIN
    )


def _heights(view: ConsoleView) -> str:
    """Says the heights of who is up, above where it stood."""
    known = [
        f"{v.name} {v.height_m:.1f} m" for v in view.vehicles if v.armed and v.height_m is not None
    ]
    return f"Above ground: {', '.join(known)}" if known else ""


def _sentences(view: ConsoleView, *parts: str) -> str:
    """Each with a capital, unless a vehicle's name begins it; full stops between."""
    found: List[str] = [p.strip().rstrip(".") for p in parts if p.strip()]
    names = tuple(v.name for v in view.vehicles)
    return ". ".join(p if p.startswith(names) else p[0].upper() + p[1:] for p in found)


_OF_PHASE: Dict[str, Callable[[ConsoleView, f.MissionReport, str], Guide]] = {
    "WAIT_VEHICLES": _wait_vehicles,
    "TAKE_OFF": _take_off,
    "COLUMN": _column,
    "CALIBRATE": _calibrate,
    "MOVE_HOME": _move_home,
    "SET_HOME": _set_home,
    "GUIDED": _guided,
    "CONFIGURATIONS": _configurations,
    "LAND": _land,
}

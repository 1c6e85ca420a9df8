# SPDX-License-Identifier: Apache-2.0
"""A view as rows of words with a tone: what a table shows, whichever toolkit draws it."""

import math
from dataclasses import dataclass
from typing import List, Sequence, Tuple

from fcsv_console.model import guide, rehearsal
from fcsv_console.model.chronicle import node_of
from fcsv_console.model.hearing import Aged
from fcsv_console.model.mission_file import ConfigurationRow
from fcsv_console.model.poses import Relative
from fcsv_console.model.stereo import StereoHealth
from fcsv_console.model.vehicles import FAILSAFE, GUARDIAN, MISSION, PILOT, UNKNOWN, VehicleRow
from fcsv_console.model.view import ConsoleView
from fcsv_control.conditions import Grade
from fcsv_control.disk import disk_words
from fcsv_control.flight_check.lines import Line
from fcsv_geometry.programs.durations import clock_words

PLAIN, QUIET, GOOD, CARE, BAD, GONE = "plain", "quiet", "good", "care", "bad", "gone"  # tones
_OF_FLIER = {PILOT: GOOD, MISSION: GOOD, GUARDIAN: CARE, FAILSAFE: BAD, UNKNOWN: GONE}
_OF_STATE = {Grade.GREEN: QUIET, Grade.AMBER: CARE, Grade.RED: BAD, Grade.UNKNOWN: GONE}
# of diagnostic_msgs/DiagnosticStatus
_LEVELS = {1: ("WARN", CARE), 2: ("ERROR", BAD), 3: ("STALE", GONE)}
_FROM_THE_WORST = (Grade.RED, Grade.UNKNOWN, Grade.AMBER, Grade.GREEN)


@dataclass(frozen=True)
class Cell:
    """``tone``: one of the words above; the text alone says it too."""

    text: str
    tone: str = PLAIN


_NOT_IN_BAGS = Cell("not in the bags", QUIET)


_HEARD_BY = {
    "flown by": "state",
    "diagnostics": "diagnosed",
    "connection": "state",
    "pose": "pose",
    "in odometry": "pose",
    "in home": "place",
    "picture": "picture",
    "battery": "battery",
    "radio": "radio",
    "recorder": "recorder",
    "clock": "clock",
}


def vehicle_rows(view: ConsoleView) -> List[Tuple[str, List[Cell]]]:
    """(label, one cell per vehicle). What is normal at the start, before home is set and after the
    end is quiet."""
    rows = _vehicle_rows(view)
    return [
        (label, [_calmed(view, label, v, cell) for v, cell in zip(view.vehicles, of)])
        for label, of in rows
    ]


def _calmed(view: ConsoleView, label: str, v: VehicleRow, cell: Cell) -> Cell:
    if view.ended and v.heard.stale:
        if v.armed:
            return cell  # nobody saw it land
        words = {"flown by": "nobody: the flight is over", "connection": f"off for {v.heard.words}"}
        return Cell(words.get(label, cell.text), QUIET)
    homeless = not view.home_set and not any(
        other.place.value is not None for other in view.vehicles
    )
    if label in ("in home", "from others") and homeless:
        return Cell("home is not set yet", QUIET)
    if label == "diagnostics" and view.starts:
        return Cell(cell.text if v.diagnosed.value is not None else "waiting", QUIET)
    heard = getattr(v, _HEARD_BY[label]) if label in _HEARD_BY else None
    if view.starting and cell.tone == GONE and heard is not None and heard.value is None:
        return Cell("waiting", QUIET)
    return cell


def _vehicle_rows(view: ConsoleView) -> List[Tuple[str, List[Cell]]]:
    table = (
        ("flown by", lambda v: Cell(v.flier.words, _OF_FLIER.get(v.flier.who, PLAIN))),
        ("diagnostics", diagnostics),
        (
            "connection",
            lambda v: Cell(v.connection, PLAIN if v.connection == "connected" else GONE),
        ),
        ("mode", _mode),
        ("pose", lambda v: _rate(v.pose)),
        ("in odometry", in_odometry),
        ("in home", in_home),
        ("from others", lambda v: _against(view.against_others(v.name))),
        ("picture", lambda v: _rate(v.picture)),
        ("battery", _battery),
        ("radio", _radio),
        ("recorder", _recorder),
        ("clock", _clock),
        ("calibration", lambda v: Cell(v.calibration, BAD if v.outdated else PLAIN)),
        (
            "it said",
            lambda v: Cell(f"{v.said.value.text} ({v.said.words})" if v.said.value else "-", QUIET),
        ),
    )
    return [(label, [cell(v) for v in view.vehicles]) for label, cell in table]


def _mode(v: VehicleRow) -> Cell:
    if v.state.value is None:
        return Cell("-", QUIET)
    high = f", {v.height_m:.1f} m up" if v.armed and v.height_m is not None else ""
    tone = PLAIN if v.connection == "connected" else GONE
    return Cell(f"{v.mode}, {'ARMED' if v.armed else 'motors off'}{high}", tone)


def _rate(aged: Aged) -> Cell:
    if aged.value is None:
        return Cell("never", GONE)
    if aged.stale:
        return Cell(f"stopped {aged.words} ago", GONE)
    return Cell(f"{aged.rate_hz:.0f} Hz" if aged.rate_hz >= 9.5 else f"{aged.rate_hz:.1f} Hz")


def in_odometry(v: VehicleRow) -> Cell:
    """The body in the vehicle's own odometry; its age is that of ``pose``."""
    if v.pose.value is None:
        return Cell("not known", GONE)
    return Cell(_pose(v.pose.value.p_odom_m, v.pose.value.yaw_rad), GONE if v.pose.stale else PLAIN)


def in_home(v: VehicleRow) -> Cell:
    """The camera in home, with its age where it is stale."""
    if v.place.value is None:
        return Cell("not known", GONE)
    words = _pose(v.place.value.p_home_m, v.place.value.heading_rad)
    return Cell(f"{words}, {v.place.words} old", GONE) if v.place.stale else Cell(words)


def _pose(p_m: Sequence[float], yaw_rad: float) -> str:
    return f"{_vector(p_m)} m, {_degrees(yaw_rad)}"


def against(r: Relative) -> Cell:
    """Measures from one other vehicle: distance, vector in home, turn."""
    if not r.known:
        return Cell(f"{r.other}: not known", GONE)
    return Cell(f"{r.other}: {r.distance_m:.2f} m ({_vector(r.p_home_m)}), {_degrees(r.yaw_rad)}")


def _against(others: Sequence[Relative]) -> Cell:
    """A line per other vehicle."""
    lines = [against(r) for r in others]
    return Cell(
        "\n".join(c.text for c in lines), GONE if any(c.tone == GONE for c in lines) else PLAIN
    )


def _vector(p_m: Sequence[float]) -> str:
    return " ".join(f"{round(m, 1) + 0.0:+.1f}" for m in p_m)  # no minus before a zero


def _degrees(angle_rad: float) -> str:
    return f"{round(math.degrees(angle_rad)) + 0:+d}°"


def _battery(v: VehicleRow) -> Cell:
    b = v.battery.value
    if b is None or v.battery.stale or math.isnan(b.share):
        return Cell("not known", GONE)
    if v.battery_enough is None:
        return Cell(f"{b.share:.0%}")
    tone = PLAIN if v.battery_enough else BAD
    return Cell(
        f"{b.share:.0%}: {clock_words(v.endurance_s)}, needs {clock_words(v.needed_s)}", tone
    )


def _radio(v: VehicleRow) -> Cell:
    r = v.radio.value
    if r is None or v.radio.stale:
        return Cell("not measured", GONE if r else QUIET)
    if r.problem:
        return Cell(r.problem, BAD)
    loss = "" if math.isnan(r.loss) else f", {r.loss:.0%} lost"
    return Cell(f"{1e3 * r.round_trip_s:.0f} ms{loss}")


def _recorder(v: VehicleRow) -> Cell:
    r = v.recorder.value
    if r is None or v.recorder.stale:
        return Cell("not heard", GONE)
    if r.problem:
        return Cell(r.problem, BAD)
    left = f", disk {disk_words(r.minutes_left)}" if math.isfinite(r.minutes_left) else ""
    dropped = f", {r.dropped} DROPPED" if r.dropped else ""
    gap = f", no picture for {v.no_picture_s:.0f} s" if v.no_picture_s else ""
    words = f"{'RECORDS' if r.pictures_on else 'ready'}{gap}{dropped}{left}"
    return Cell(words, CARE if r.dropped or gap else GOOD if r.pictures_on else PLAIN)


def diagnostics(v: VehicleRow) -> Cell:
    """What is wrong, the worst first."""
    if "diagnostics/worst" in v.not_in_bags:
        return _NOT_IN_BAGS
    if v.diagnosed.value is None or v.diagnosed.stale:
        return Cell(
            "not heard" if v.diagnosed.value is None else f"not heard for {v.diagnosed.words}", GONE
        )
    wrong = v.diagnosed.value.wrong
    if not wrong:
        return Cell("well", QUIET)
    told = [
        f"{_LEVELS[level][0]} {node_of(v.name, name)}: {text}" if name else text
        for name, level, text in wrong
    ]
    return Cell("\n".join(told), _LEVELS[wrong[0][1]][1])


def _clock(v: VehicleRow) -> Cell:
    if "clock/offset" in v.not_in_bags:
        return _NOT_IN_BAGS
    c = v.clock.value
    if c is None or v.clock.stale:
        return Cell("not known", GONE)
    return Cell(f"{1e3 * c.offset_s:+.1f} ms ±{1e3 * c.uncertainty_s:.1f}")


CONFIGURATION_HEADS = ("", "baseline", "tilt", "times", "range", "error")
_AXES = {"horizontal": "hor.", "vertical": "vert."}  # the six columns stand in 300 px


def configuration_cells(row: ConfigurationRow, running: bool) -> List[Cell]:
    """One per head, the station beside the number. Times: to hold and to record; the error is that at
    the far end of the range."""
    tone = GOOD if running else PLAIN
    number = f"{'> ' if running else ''}{row.index + 1} {row.station}".rstrip()
    baseline = (
        f"{row.baseline_m:g} m"
        if row.way_m is None
        else row.title.replace(f"sweep {row.axis} ", "")
    )
    words = (
        number,
        f"{_AXES[row.axis]} {baseline}",
        f"{row.tilt_deg:g}°",
        f"follow {row.record_s:g} s" if row.follows else f"{row.settle_s:g}+{row.record_s:g} s",
        f"{row.nearest_m:.0f}–{row.farthest_m:.0f} m",
        f"±{row.error_m:.{1 if row.error_m < 10.0 else 0}f} m",
    )
    return [Cell(w, tone) for w in words]


CHECK_HEADS = ("who", "line", "state", "found", "what to do")


def check_lines(view: ConsoleView) -> List[Line]:
    """Gives, of the flight check what is not green, the worst first; that is what an operator must
    act on."""
    wrong = [li for li in view.check or () if li.state is not Grade.GREEN]
    return sorted(wrong, key=lambda li: (view.waits(li), _FROM_THE_WORST.index(li.state)))


def check_words(view: ConsoleView) -> Cell:
    """The verdict, and how many lines are green."""
    if view.check is None:
        quiet = "the flight is over" if view.over else "waiting" if view.starting else ""
        return Cell(f"flight check: {quiet or 'NOT HEARD'}", QUIET if quiet else GONE)
    green = sum(li.state is Grade.GREEN for li in view.check)
    if view.starts:
        return Cell(f"flight check: starting, {green} of {len(view.check)} lines green", QUIET)
    verdict = f"flight check: {view.check_state.word}, {green} of {len(view.check)} lines green"
    return Cell(verdict, GOOD if view.check_state is Grade.GREEN else _OF_STATE[view.check_state])


def check_cells(line: Line, waits: bool = False) -> List[Cell]:
    """One per head; ``waits``: it is so at every start."""
    tone = QUIET if waits else CARE if line.accepted else _OF_STATE[line.state]
    word = (
        "waiting" if waits else f"{line.state.word}, accepted" if line.accepted else line.state.word
    )
    since = "" if line.state is Grade.GREEN else f" ({clock_words(line.since_s)})"
    return [
        Cell(line.vehicle, tone),
        Cell(line.name, tone),
        Cell(word, tone),
        Cell(line.what + since, tone),
        Cell(line.remedy, QUIET),
    ]


def rehearsal_cell(view: ConsoleView) -> Cell:
    """What became of the rehearsal of the list that is shown."""
    tones = {rehearsal.PASSED: GOOD, rehearsal.BROKEN: BAD, rehearsal.IMPOSSIBLE: CARE}
    return Cell(view.rehearsal.summary, tones.get(view.rehearsal.state, QUIET))


def stereo_cell(view: ConsoleView) -> Cell:
    """Go or no-go, then the figures."""
    s = view.stereo
    figures = _epipolar(s)
    figures += [] if math.isnan(s.skew_s) else [f"skew {1e3 * s.skew_s:.0f} ms"]
    figures += (
        [] if math.isnan(s.overlap) else [f"{s.overlap:.0%} seen by both at {s.target_m:.0f} m"]
    )
    if not math.isnan(s.error_m):
        figures += [f"error there ±{s.error_m:.1f} m", f"baseline {s.baseline_m:.2f} m"]
        figures += [
            f"turned {s.turn_deg:.1f}°",
            f"pitched {s.pitch_deg:.1f}°",
            f"rolled {s.roll_deg:.1f}°",
        ]
    tone = QUIET if not s.judged else GOOD if s.go else CARE
    return Cell("\n".join([s.words, ", ".join(figures)]) if figures else s.words, tone)


def _epipolar(s: StereoHealth) -> List[str]:
    """What the map's fit leaves first: that is what becomes of the pictures."""
    if math.isnan(s.epipolar_px):
        return []
    if math.isnan(s.refined_px):
        return [f"epipolar error {s.epipolar_px:.1f} px"]
    return [f"epipolar error {s.refined_px:.1f} px fitted, {s.epipolar_px:.1f} px as tracked"]


def headline(view: ConsoleView) -> Cell:
    """What goes on and what comes next."""
    tones = {guide.WAITS: QUIET, guide.WELL: GOOD, guide.CARE: CARE, guide.LOST: GONE}
    return Cell(view.headline, tones.get(view.guide.sort, PLAIN))


def height(v: VehicleRow) -> str:
    """Above ground; of one that nobody saw there, in home."""
    if v.height_m is not None:
        return f"{max(0.0, v.height_m):.1f} m up" if v.armed else "on the ground"
    return (
        f"{round(v.place.value.p_home_m[2], 1) + 0.0:+.1f} m in home"
        if v.place.value is not None
        else ""
    )


def problems_tone(view: ConsoleView) -> str:
    """Gives the tone of what is listed as problems: at a start that is normal there are many."""
    return QUIET if view.starts else CARE

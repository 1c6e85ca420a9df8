# SPDX-License-Identifier: Apache-2.0
"""A view as one screen of text. Colours help; the words say it all."""

import math
from textwrap import wrap
from typing import List

from rich.console import Group
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from fcsv_console.model import cells
from fcsv_console.model.cells import check_lines
from fcsv_console.model.hearing import Aged
from fcsv_console.model.vehicles import FAILSAFE, GUARDIAN, MISSION, NOBODY, PILOT, VehicleRow
from fcsv_console.model.view import ConsoleView
from fcsv_control.conditions import Grade
from fcsv_control.disk import disk_words
from fcsv_geometry.programs.durations import clock_words

WIDTH, HEIGHT = 80, 24
_FLIERS = {
    PILOT: "bold cyan",
    MISSION: "bold blue",
    GUARDIAN: "bold yellow",
    FAILSAFE: "bold white on red",
    NOBODY: "",
}
_STATES = {
    Grade.GREEN: "bold blue",
    Grade.AMBER: "bold yellow",
    Grade.RED: "bold white on red",
    Grade.UNKNOWN: "bold magenta",
}
_GONE = "bold magenta"
_TONES = {cells.GOOD: "blue", cells.CARE: "yellow", cells.BAD: "red", cells.GONE: "magenta"}
_LEVELS = {"info": "", "warning": "yellow", "error": "bold red"}
_CHECKS, _EVENTS, _PROBLEMS, _BAR, _HEADLINES = 6, 5, 3, 20, 2
KEYS = "S stop all   L land all   P pause   G resume   Q quit"


def screen(view: ConsoleView) -> Group:
    """Everything that matters, the keys first: a low terminal cuts the end. What is wrong takes
    lines from events."""
    parts: List = [Text(KEYS, "bold", justify="center"), _head(view), Rule(style="dim")]
    parts += [_vehicles(view), *_poses(view)]
    parts += [
        Text(f" {a.words}", "bold yellow", no_wrap=True, overflow="ellipsis") for a in view.above
    ]
    parts += [Rule(style="dim"), _stereo(view), _check(view)]
    parts += [
        Text(f" ! {p}", "dim" if view.starts else "yellow", no_wrap=True, overflow="ellipsis")
        for p in view.problems[:_PROBLEMS]
    ]
    left = HEIGHT - 1 - sum(_lines(part) for part in parts)
    return Group(*parts, Rule(style="dim"), *_events(view, max(1, min(_EVENTS, left))))


def _lines(part) -> int:
    if isinstance(part, Group):
        return len(part.renderables)
    return part.row_count + 1 if isinstance(part, Table) else 1


def _line(words: str, style: str = "") -> Text:
    return Text(words, style, no_wrap=True, overflow="ellipsis")


def _head(view: ConsoleView) -> Group:
    headline = cells.headline(view)
    stopped = view.stop.value is not None and view.stop.value.asked
    style = f"bold {_TONES.get(headline.tone, '')}".strip()
    found = wrap(headline.text, WIDTH)
    lines = (
        [_line(headline.text, style)]
        if stopped
        else [_line(line, style) for line in found[:_HEADLINES]]
    )
    if stopped:
        lines.append(_line(view.stop.value.words, "bold white on red"))
    rows = view.file.rows
    if rows:
        done = int(round(_BAR * view.progress))
        words = f"[{'#' * done}{'.' * (_BAR - done)}] "
        if view.running is not None:
            r = rows[view.running]
            words += f"{view.running + 1}/{len(rows)} {r.title}: to {r.farthest_m:.0f} m, there +-{r.error_m:.1f} m"
        else:
            words += f"{len(rows)} configurations"
        lines.append(_line(words))
    return Group(*lines)


def _vehicles(view: ConsoleView) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), expand=False, header_style="dim", width=WIDTH)
    columns = (
        ("vehicle", 8, "left"),
        ("flown by", 28, "left"),
        ("battery", 17, "right"),
        ("pose", 7, "right"),
        ("pict", 6, "right"),
        ("radio", 7, "right"),
    )
    for name, width, justify in columns:
        table.add_column(name, width=width, justify=justify, no_wrap=True, overflow="ellipsis")
    for v in view.vehicles:
        if view.ended and v.heard.stale and not v.armed:
            table.add_row(
                Text(v.name, "bold"), Text(f"the flight is over, off for {v.heard.words}", "dim")
            )
            continue
        table.add_row(
            Text(v.name, "bold"),
            Text(v.flier.words, _FLIERS.get(v.flier.who, "bold magenta")),
            _battery(v),
            _rate(v.pose),
            _rate(v.picture),
            _radio(v),
        )
        style = "dim" if v.connection == "connected" else "bold magenta"
        high = f", {v.height_m:.1f} m up" if v.armed and v.height_m is not None else ""
        motors = "ARMED" if v.armed else "motors off"
        link = "" if v.connection == "connected" else f"{v.connection}, "
        told = f"{link}{v.mode}, {motors}{high}" if v.state.value else v.connection
        table.add_row("", _line(told, style), _disk(v))
        table.add_row(
            "", _line(f"calibration {v.calibration}", "" if v.outdated else "dim"), _clock(v)
        )
        wrong = cells.diagnostics(v)
        if wrong.tone in (cells.CARE, cells.BAD):
            style = (
                "dim" if view.starts else "bold yellow" if wrong.tone == cells.CARE else "bold red"
            )
            table.add_row("", _line(wrong.text.split("\n")[0], style))
        if v.said.value is not None:
            table.add_row("", _line(f'"{v.said.value.text}" {v.said.words} ago', "dim"))
    return table


def _poses(view: ConsoleView) -> List[Text]:
    """A line per vehicle, then one per pair."""
    told = []
    for v in view.vehicles:
        odometry, home = (
            Text(c.text, _GONE if c.tone == cells.GONE else "")
            for c in (cells.in_odometry(v), cells.in_home(v))
        )
        told.append(Text.assemble((f"{v.name:<8}", "bold"), "odometry ", odometry, "  home ", home))
    for k, v in enumerate(view.vehicles):
        before = [other.name for other in view.vehicles[:k]]
        pairs = [cells.against(r) for r in view.against_others(v.name) if r.other in before]
        told += [
            Text.assemble(
                (f"{v.name:<8}", "bold"), "from ", (c.text, _GONE if c.tone == cells.GONE else "")
            )
            for c in pairs
        ]
    for line in told:
        line.no_wrap, line.overflow = True, "ellipsis"
    return told


def _battery(v: VehicleRow) -> Text:
    if v.battery.value is None or v.battery.stale or math.isnan(v.battery.value.share):
        return Text("not known", "bold magenta")
    share = f"{v.battery.value.share:.0%}"
    if v.battery_enough is None:
        return Text(share)
    lasts = clock_words(v.endurance_s)
    if v.battery_enough:
        return Text(f"{share}, {lasts} left")
    return Text(f"{share}, {lasts} < {clock_words(v.needed_s)}", "bold white on red")


def _rate(aged: Aged) -> Text:
    if aged.stale:
        return Text(aged.words, "bold magenta")
    return Text(f"{aged.rate_hz:.0f} Hz" if aged.rate_hz >= 9.5 else f"{aged.rate_hz:.1f} Hz")


def _radio(v: VehicleRow) -> Text:
    r = v.radio.value
    if r is None or v.radio.stale:
        return Text("-", "dim")
    return Text(
        "BAD" if r.problem else f"{1e3 * r.round_trip_s:.0f} ms",
        "bold white on red" if r.problem else "",
    )


def _disk(v: VehicleRow) -> Text:
    r = v.recorder.value
    if r is None or v.recorder.stale:
        return Text("no recorder", "bold magenta")
    if r.problem:
        return Text("recorder BAD", "bold white on red")
    left = disk_words(r.minutes_left) if math.isfinite(r.minutes_left) else "disk ok"
    return Text(f"{'REC ' if r.pictures_on else ''}{left}", "bold blue" if r.pictures_on else "dim")


def _clock(v: VehicleRow) -> Text:
    c = v.clock.value
    return Text("" if c is None or v.clock.stale else f"clock {1e3 * c.offset_s:+.0f} ms", "dim")


def _stereo(view: ConsoleView) -> Text:
    s = view.stereo
    figures = (
        ""
        if math.isnan(s.error_m)
        else f"  {s.baseline_m:.2f} m, {s.overlap:.0%} shared, +-{s.error_m:.1f} m"
    )
    return _line(
        f"{s.words}{figures}", "bold blue" if s.go else "bold yellow" if s.judged else "dim"
    )


def _check(view: ConsoleView) -> Group:
    state = view.check_state
    wrong = check_lines(view)
    word, style = ("starting", "dim") if view.starts else (state.word, _STATES[state])
    lines = [
        Text.assemble(
            "flight check: ",
            (word, style),
            f", {len(wrong)} of {len(view.check or ())} lines not green"
            if view.check
            else ", not heard",
        )
    ]
    waiting = [li for li in wrong if view.waits(li)]
    wrong = [li for li in wrong if li not in waiting]
    if waiting:
        named = ", ".join(f"{li.vehicle} {li.name}" for li in waiting)
        lines.append(
            _line(f" {len(waiting)} lines wait, normal for about a minute: {named}", "dim")
        )
    for li in wrong[:_CHECKS]:
        accepted = " (accepted)" if li.accepted else ""
        words = f" {li.vehicle:<8}{li.name:<11}{li.state.word:<8}{li.what}{accepted}"
        lines.append(_line(words, _STATES[li.state] if not li.passes else "dim"))
    if len(wrong) > _CHECKS:
        lines.append(
            _line(f" and {len(wrong) - _CHECKS} more: rosrun fcsv_control flight_check", "dim")
        )
    return Group(*lines)


def _events(view: ConsoleView, number: int) -> List[Text]:
    told = [
        _line(
            f"{e.clock} {e.who}: {e.what}{' -> ' + e.answer if e.answer else ''}", _LEVELS[e.level]
        )
        for e in view.events[-number:]
    ]
    return told or [_line("no events yet", "dim")]

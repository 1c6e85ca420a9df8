# SPDX-License-Identifier: Apache-2.0
"""The flight check as a table for a terminal. Colours help; the words say it all."""

from typing import List, Sequence

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Line, worst
from fcsv_geometry.programs.durations import clock_words

_COLOURS = {Grade.GREEN: "32", Grade.AMBER: "33", Grade.RED: "31", Grade.UNKNOWN: "35"}
_STATE_WIDTH = 9


def render(lines: Sequence[Line], colours: bool = False) -> str:
    """One line each, those of a vehicle together; under what is not green its remedy. Ends with the
    verdict.

    >>> print(render([Line("uav1", "battery", Grade.AMBER, "31%", "change it", 75.0)]))
    uav1     battery     amber     31%  (1:15)
                                   -> change it
    flight check: amber, 1 of 1 lines not green
    """
    wide = max([len(line.vehicle) for line in lines], default=0) + 2
    rows: List[str] = []
    for line in lines:
        head = f"{line.vehicle:<{max(9, wide)}}{line.name:<12}"
        word = f"{line.state.word:<{_STATE_WIDTH}}"
        accepted = "  (accepted)" if line.accepted else ""
        since = "" if line.state is Grade.GREEN else f"  ({clock_words(line.since_s)})"
        rows.append(
            f"{head}{_painted(word, line.state, colours)} {line.what}{since}{accepted}".rstrip()
        )
        if line.remedy:
            rows.append(" " * (len(head) + _STATE_WIDTH + 1) + f"-> {line.remedy}")
    state, wrong = worst(lines), sum(line.state is not Grade.GREEN for line in lines)
    verdict = _painted(state.word, state, colours)
    return "\n".join([*rows, f"flight check: {verdict}, {wrong} of {len(lines)} lines not green"])


def exit_status(lines: Sequence[Line]) -> int:
    """0: green, or every amber line accepted; 1: amber; 2: red, unknown, or no line at all.

    >>> [exit_status([Line("uav1", "a", s, "")]) for s in (Grade.GREEN, Grade.AMBER, Grade.RED, Grade.UNKNOWN)]
    [0, 1, 2, 2]
    """
    if lines and all(line.passes for line in lines):
        return 0
    return 1 if worst(lines) is Grade.AMBER else 2


def _painted(text: str, state: Grade, colours: bool) -> str:
    return f"\033[{_COLOURS[state]}m{text}\033[0m" if colours else text

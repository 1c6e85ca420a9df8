# SPDX-License-Identifier: Apache-2.0
"""docs/reference/wrong_inputs.md: kinds of wrong input and what happens to each, written by the
tests that assert it.

A test takes the fixture ``wrong_input`` and calls it once per kind, after its assertions. An
ordinary run fails where the page lacks the row; ``tools/run wrong-inputs`` runs these tests alone
and writes the page.
"""

import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Iterable, List

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "wrong_inputs.md"
FIXTURE = MARK = PROPERTY = "wrong_input"

AREAS = (
    "Photographs with GPS",
    "COLMAP models",
    "Pictures",
    "Cameras",
    "Sessions and bags",
    "Poses and maps",
    "Calibration",
    "Autopilot",
)
OUTCOMES = (
    "read right",
    "read, with a warning",
    "left out and named",
    "corrected and said",
    "refused",
    "in sigma",
)

_HEAD = """# Wrong inputs, and what happens to each

Written by `tools/run wrong-inputs` from the tests that assert each row. The last column is what is printed, or a part
of it. "Read right": the result is that of the right input. "Left out and named": the rest is used.
"""
_FOLDERS = re.compile(r"(?:/[\w.+-]+)+/(?=[\w.+-])")


@dataclass(frozen=True, order=True)
class Row:
    """``given`` names the kind of input; ``message`` is printed text without figures that another
    machine rounds otherwise."""

    area: str
    given: str
    outcome: str
    message: str = ""

    def __post_init__(self):
        assert self.area in AREAS, f"'{self.area}' is none of {AREAS}"
        assert self.outcome in OUTCOMES, f"'{self.outcome}' is none of {OUTCOMES}"
        object.__setattr__(self, "message", _FOLDERS.sub("", " ".join(self.message.split())))

    @property
    def line(self) -> str:
        """Of the page's table."""
        message = self.message.replace("|", "\\|")
        return f"| {self.given} | {self.outcome} | {message} |"


def page(rows: Iterable[Row]) -> str:
    """The whole page: a table per area."""
    rows = sorted(set(rows))
    parts = [_HEAD]
    for area in AREAS:
        lines = [row.line for row in rows if row.area == area]
        if lines:
            parts += [
                f"\n## {area}\n",
                "| input | what happens | printed |",
                "|---|---|---|",
                *lines,
            ]
    return "\n".join(parts).rstrip() + "\n"


class Recorder:
    """What the fixture calls: notes the row for the page, or compares it with the page."""

    def __init__(self, record_property, writes: bool):
        self._record, self._writes = record_property, writes

    def __call__(self, area: str, given: str, outcome: str, message: str = "") -> None:
        row = Row(area, given, outcome, message)
        self._record(PROPERTY, json.dumps(asdict(row)))
        if not self._writes:
            text = PAGE.read_text() if PAGE.exists() else ""
            lacking = (
                f"docs/reference/{PAGE.name} lacks: {row.line}\n(write it: tools/run wrong-inputs)"
            )
            assert row.line in text.splitlines(), lacking


class Writer:
    """Plugin of a run that writes the page: gathers rows from reports, those of other processes,
    too."""

    def __init__(self):
        self.rows: List[Row] = []

    def pytest_runtest_logreport(self, report):
        if report.when == "call" and report.passed:
            self.rows += [Row(**json.loads(v)) for k, v in report.user_properties if k == PROPERTY]

    def pytest_sessionfinish(self, session, exitstatus):
        if exitstatus == 0:
            PAGE.write_text(page(self.rows))

# SPDX-License-Identifier: Apache-2.0
"""docs/lab/compared.md repeats measured figures of other pages: each stands there, under the same
name."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs" / "lab"
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def rows(text):
    """Cells of every table row, without marks and blanks before %."""
    for line in text.splitlines():
        if line.startswith("|") and not re.match(r"\|[-| ]+\|$", line):
            yield [
                re.sub(r"\s+%", "%", re.sub(r"[*`]", "", c)).strip()
                for c in line.strip("|").split("|")
            ]


def repeated():
    """(page, first words of the row there, cells that must stand in it)."""
    measured = (
        (DOCS / "compared.md").read_text().split("## Measured here")[1].split("## In words")[0]
    )
    pages = {
        "case": "evidence.md",
        "of the pixels with truth up to 400 m": "benchmarks.md",
        "": "benchmarks.md",
        "pair, by": "benchmarks.md",
    }
    names = {"COLMAP": ["all", "COLMAP"], "fcsv's refinement, with priors": ["all", "ours"]}
    head = None
    for name, *cells in rows(measured):
        if name in pages:
            head = name
        else:
            found = name.split(", ") if head == "pair, by" else names.get(name, [name])
            yield pages[head], found, cells


@pytest.mark.parametrize(
    "page, name, cells", repeated(), ids=lambda v: v if isinstance(v, str) else v[0]
)
def test_a_figure_stands_on_the_page_that_measured_it(page, name, cells):
    there = [
        r
        for r in rows((DOCS / page).read_text())
        if r[0].startswith(name[0]) and name[1:] == r[1 : len(name)]
    ]
    assert there, f"{page} has no row {name}"
    assert NUMBER.search(cells[0])
    numbers = [NUMBER.findall(" ".join(r[len(name) :])) for r in there]
    wanted = NUMBER.findall(" ".join(cells))
    assert any(set(wanted) <= set(found) for found in numbers), (
        f"{page}, {name}: {wanted} is not in {numbers}"
    )

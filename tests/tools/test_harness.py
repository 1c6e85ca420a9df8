# SPDX-License-Identifier: Apache-2.0
"""The benches' harness: cases, rows, tables, and their place on a page."""

import doctest

import numpy as np
import pytest

import harness


def double(number, offset):
    return 2 * number + offset


def test_its_examples_hold():
    assert doctest.testmod(harness) == (0, 3)


@pytest.mark.parametrize("jobs", [1, 2])
def test_rows_come_in_the_order_of_their_cases(jobs):
    cases = harness.grid(number=[3, 1], offset=[0, 10])
    found = list(harness.measured(double, cases, jobs))
    assert [case for case, _ in found] == cases
    assert [row for _, row in found] == [6, 16, 2, 12]


def test_a_table_takes_the_place_of_the_last_one_and_nothing_else(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# Page\n\n<!-- table: tools/a.py -->\nold\n<!-- end of table -->\n\nprose\n\n"
        "<!-- table: tools/b.py -->\n\nkept\n\n<!-- end of table -->\n"
    )
    lines = harness.table(["case", "m"], [("one", 1.5)])
    harness.write(page, "a.py", lines)
    assert harness.kept(page, "a.py").split("\n") == ["| case | m |", "|---|---|", "| one | 1.5 |"]
    assert harness.kept(page, "b.py") == "kept" and "old" not in page.read_text()
    before = page.read_text()
    harness.write(page, "a.py", lines)
    assert page.read_text() == before and before.endswith("<!-- end of table -->\n")


def test_a_page_without_marks_is_refused_and_stays(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Page\n")
    with pytest.raises(ValueError, match="page.md: lacks the marks"):
        harness.write(page, "a.py", ["| new |"])
    assert page.read_text() == "# Page\n"


@pytest.mark.parametrize(
    "script", ["bench_gimbal.py", "bench_mocap.py", "bench_sigma.py", "bench_tracking.py"]
)
def test_pages_have_the_marks_of_the_benches_that_write_them(script):
    pages = [p for p in harness.LAB.glob("*.md") if f"tools/{script} -->" in p.read_text()]
    assert len(pages) == 1 and harness.kept(pages[0], script).startswith(("|", "2", "`", "Runs"))


def test_the_band_of_consistency_is_that_of_the_errors_that_are_drawn():
    """Of 400 means of ten squared normal errors of six degrees of freedom 95 % lie in it; the
    bounds are four standard deviations of the share."""
    low, high = harness.consistency_band(10)
    means = (np.random.default_rng(1).standard_normal((400, 60)) ** 2).mean(axis=1)
    assert 0.90 < ((means > low) & (means < high)).mean() < 0.995


def test_a_picture_is_drawn(tmp_path):
    harness.picture(tmp_path / "new/curve.png", {"a": ([1, 2], [3, 4])}, "x (m)", "y (m)")
    assert (tmp_path / "new/curve.png").stat().st_size > 1000

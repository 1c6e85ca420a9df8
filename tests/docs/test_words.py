# SPDX-License-Identifier: Apache-2.0
"""The docs stay short: at most 30,000 words without what commands write, and 1,500 on a page of a
user."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
#: Folders of docs/; nothing else holds pages.
USER, DESIGN, LAB, REFERENCE = "user", "design", "lab", "reference"


def folder(page: Path) -> str:
    """Folder of docs/ in which a page stands; "" for the index."""
    return page.relative_to(DOCS).parts[0] if page.parent != DOCS else ""


def words(text: str) -> int:
    """Number of words of a page: whatever holds a letter or a digit between blanks, cells of tables
    included.

    >>> words("| uav1 | 2 m |\\n|---|---|")
    3
    """
    return sum(1 for token in text.split() if re.search(r"[^\W_]", token))


def without_tables(text: str) -> str:
    """A page without rows of tables: in docs/lab/ these are measurements."""
    return "\n".join(line for line in text.splitlines() if not line.startswith("|"))


def counted(page: Path) -> int:
    """Words of a page as the bound counts them."""
    text = page.read_text()
    return words(without_tables(text) if folder(page) == LAB else text)


PAGES = [p for p in sorted(DOCS.rglob("*.md")) if folder(p) != REFERENCE]


def test_every_page_has_its_folder():
    assert {folder(p) for p in PAGES} == {"", USER, DESIGN, LAB}
    assert [p.name for p in PAGES if folder(p) == ""] == ["README.md"]


def test_all_pages_but_the_reference_hold_at_most_30000_words():
    assert sum(counted(p) for p in PAGES) <= 30_000


@pytest.mark.parametrize("page", [p for p in PAGES if folder(p) == USER], ids=lambda p: p.name)
def test_a_page_of_a_user_holds_at_most_1500_words(page):
    assert words(page.read_text()) <= 1500


@pytest.mark.parametrize("page", [p for p in PAGES if folder(p) == LAB], ids=lambda p: p.name)
def test_a_page_of_the_lab_is_tables(page):
    """A date stands on it, and its prose is what a reader needs for the tables."""
    text = page.read_text()
    assert re.search(r"\b20\d\d-\d\d-\d\d\b|benchmarks\.md", text) and re.search(
        r"^\|---", text, re.M
    )
    # twelve sections of the thesis
    assert words(without_tables(text)) <= (1250 if page.name == "study.md" else 450)


@pytest.mark.parametrize("page", sorted(DOCS.glob("design/decisions/*.md")), ids=lambda p: p.name)
def test_a_decision_record_fits_on_one_page(page):
    assert words(page.read_text()) <= 600

# SPDX-License-Identifier: Apache-2.0
"""The pages that a machine can check: links resolve, the index is whole, every folder says what it
holds."""

import re
import subprocess
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(r"^```.*?^```[^\n]*$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#{1,6} +(.+?) *$", re.MULTILINE)


def pages():
    names = subprocess.run(
        ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    names = names.stdout.split("\n")
    return [ROOT / n for n in names if n and (ROOT / n).is_file()]


def anchors(page):
    """The fragments that GitHub gives a page's headings: lower case, no punctuation, hyphens for
    spaces."""
    seen, out = Counter(), set()
    for heading in HEADING.findall(FENCE.sub("", page.read_text())):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        out.add(f"{slug}-{seen[slug]}" if seen[slug] else slug)
        seen[slug] += 1
    return out


def links(page):
    """(file, fragment or "") of every relative link of a page; code blocks have none."""
    for target in LINK.findall(FENCE.sub("", page.read_text())):
        if not re.match(r"[a-z]+:", target):
            path, _, fragment = target.partition("#")
            yield (page.parent / path).resolve() if path else page, fragment


def broken(page):
    for path, fragment in links(page):
        if not path.exists():
            yield f"{page.relative_to(ROOT)}: {path} is not there"
        elif fragment and fragment not in anchors(path):
            yield f"{page.relative_to(ROOT)}: {path.name} has no heading #{fragment}"


def test_relative_links_resolve():
    found = pages()
    assert sum(1 for page in found for _ in links(page)) > 50
    assert not [line for page in found for line in broken(page)]


def test_pages_that_are_named_in_the_code_exist():
    where = ["src", "tests", "tools", "config", "launch", "*.md", "Makefile"]
    names = subprocess.run(
        ["git", "grep", "-hoE", r"\bdocs/[A-Za-z0-9_/-]+\.md", "--", *where],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    named = set(names.stdout.split())
    assert named and not sorted(n for n in named if not (ROOT / n).is_file())


def test_every_page_stands_in_the_index():
    index = ROOT / "docs/README.md"
    listed = {path for path, _ in links(index)}
    docs = [p for p in pages() if ROOT / "docs" in p.parents and p != index]
    assert len(docs) > 15 and not [str(p.relative_to(ROOT)) for p in docs if p not in listed]


def test_every_module_of_joint_is_described():
    folder = ROOT / "src/fcsv_stereo/src/fcsv_stereo/joint"
    modules = {
        str(m.relative_to(folder).with_suffix(""))
        for m in folder.rglob("*.py")
        if m.name != "__init__.py"
    }
    page = (ROOT / "docs/design/joint.md").read_text()
    assert modules and not sorted(m for m in modules if f"`{m}`" not in page)


def test_every_folder_of_modules_is_a_package_that_says_what_it_holds():
    """tests/docs/test_reference.py compares docs/reference/packages.md with them."""
    folders = {m.parent for root in ROOT.glob("src/*/src") for m in root.rglob("*.py")}
    assert [str(f) for f in sorted(folders) if not (f / "__init__.py").is_file()] == []

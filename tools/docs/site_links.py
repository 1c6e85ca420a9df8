# SPDX-License-Identifier: Apache-2.0
"""mkdocs' hooks: the pages above docs/ are in the site too, and links to files that are no pages
become words."""

import os
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: Pages of the checkout outside docs/, by their name in the site.
ABOVE = {
    "start.md": "README.md",
    "changes.md": "CHANGELOG.md",
    "contributing.md": "CONTRIBUTING.md",
}
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")


def on_files(files, config):
    """Adds the pages above docs/."""
    from mkdocs.structure.files import File  # only where a site is built

    for name, source in ABOVE.items():
        files.append(File.generated(config, name, content=(ROOT / source).read_text()))
    return files


def on_page_markdown(markdown, page, config, files):
    """Links as they are in the checkout, as they are in the site."""
    src = page.file.src_uri
    source = ROOT / ABOVE[src] if src in ABOVE else ROOT / "docs" / src
    return _LINK.sub(lambda match: link(match, source.parent, os.path.dirname(src)), markdown)


def link(match, folder: Path, site_folder: str) -> str:
    """One link of a page that lies in ``folder`` of the checkout and in ``site_folder`` of the
    site."""
    mark, words, target = match.groups()
    path, hash_, fragment = target.partition("#")
    if not path or re.match(r"[a-z]+:", target):
        return match.group()
    there = os.path.relpath((folder / path).resolve(), ROOT)
    above = {source: name for name, source in ABOVE.items()}
    if there in above:
        name = above[there]
    elif there.startswith("docs/"):
        name = there[len("docs/") :]
    else:
        return words
    return f"{mark}[{words}]({os.path.relpath(name, site_folder or '.')}{hash_}{fragment})"

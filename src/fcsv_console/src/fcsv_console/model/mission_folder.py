# SPDX-License-Identifier: Apache-2.0
"""The mission files of a folder as a list (thesis figure 6.3), and why another one is not loaded
now."""

from pathlib import Path
from typing import Sequence, Tuple

_ENDS = ".yaml"


def rows(names: Sequence[str], loaded: str, changed: bool) -> Tuple[Tuple[str, str], ...]:
    """(name, how it is shown) of those that may be missions, in order; ``loaded``: the name of the
    one that is shown.

    >>> rows(["ten.yaml", "short.yaml", "notes.md", ".old.yaml"], "ten.yaml", True)
    (('short.yaml', 'short'), ('ten.yaml', '> ten *'))
    """
    found = sorted(n for n in names if n.endswith(_ENDS) and not n.startswith("."))
    mark = " *" if changed else ""
    return tuple(
        (n, f"> {n[: -len(_ENDS)]}{mark}" if n == loaded else n[: -len(_ENDS)]) for n in found
    )


def empty(loaded: str) -> str:
    """What stands in place of the list where it has no row; ``loaded``: path of the file that is
    shown, or "".

    >>> empty("")
    "No file is loaded: the list is the mission's own. Open shows the files of a folder."
    >>> empty("/m/ten.yaml")
    'No mission files in /m'
    """
    if not loaded:
        return "No file is loaded: the list is the mission's own. Open shows the files of a folder."
    return f"No mission files in {Path(loaded).parent}"


def refused(wanted: str, loaded: str, changed: bool) -> str:
    """Why a file is not loaded in place of another; "" where it may be.

    >>> refused("/m/ten.yaml", "/m/short.yaml", True)
    'short.yaml has changes: save or revert them, then load ten.yaml'
    >>> refused("/m/ten.yaml", "/m/short.yaml", False)
    ''
    """
    if not changed:
        return ""
    return f"{Path(loaded).name or 'the list'} has changes: save or revert them, then load {Path(wanted).name}"

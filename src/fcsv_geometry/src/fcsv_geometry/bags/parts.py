# SPDX-License-Identifier: Apache-2.0
"""A machine's recording in parts: uav1.bag, uav1.1.bag, uav1.2.bag, ..."""

import re
from pathlib import Path
from typing import Dict, List

from fcsv_geometry.bags.repair import ACTIVE, recording_of


def part_name(first: str, number: int) -> str:
    """The file name of a part; the first is number 0.

    >>> part_name("uav1.bag", 0), part_name("uav1.bag", 2)
    ('uav1.bag', 'uav1.2.bag')
    """
    return first if number == 0 else f"{first[: -len('.bag')]}.{number}.bag"


def part_number(name: str, first: str) -> int:
    """Which part of ``first`` a bag is, by its name with or without ``.active``; -1 where it is
    none.

    >>> part_number("uav1.2.bag.active", "uav1.bag"), part_number("uav1.20260102T030405Z.bag", "uav1.bag")
    (2, -1)
    """
    stem = re.escape(first[: -len(".bag")])
    match = re.fullmatch(rf"{stem}(?:\.(\d{{1,6}}))?\.bag(?:{re.escape(ACTIVE)})?", name)
    return -1 if match is None else int(match.group(1) or 0)


def parts_in(folder: Path, first: str) -> List[Path]:
    """The parts of a recording that a folder holds, in order, by the names that they will have once
    closed."""
    found: Dict[int, Path] = {}
    for path in Path(folder).iterdir():
        number = part_number(path.name, first)
        if number >= 0 and path.is_file():
            found[number] = recording_of(path)
    return [found[number] for number in sorted(found)]

# SPDX-License-Identifier: Apache-2.0
"""The bags of a session: all parts of every machine, repaired where they were not closed; what is
missing is said.

Bags of ROS 2 are opened as they are.
"""

import filecmp
from pathlib import Path
from typing import List, Tuple

from fcsv_geometry.bags.parts import part_number, parts_in
from fcsv_geometry.bags.reading import METADATA, ROS2_FILES, is_ros2
from fcsv_geometry.bags.repair import ACTIVE, KEPT, recording_of, repaired
from fcsv_geometry.config import read_yaml
from fcsv_geometry.errors import BagError, ConfigError
from fcsv_stereo.errors import InputError


def is_session(path: Path) -> bool:
    """Whether a path looks like a session folder or a bag."""
    a_bag = path.suffix in (".bag", ACTIVE) or is_ros2(path)
    return a_bag or (path / "session.yaml").exists() or any(_bags_in(path))


def bags_of(path: Path, warnings: List[str]) -> List[Path]:
    """Bags to open, in order. A part that is missing or cannot be repaired is left out with a
    warning.

    Raises InputError where none is left, or where session.yaml is none.
    """
    said: List[str] = []
    bags = [bag for name in _without_copies(_listed(path), said) for bag in _opened(name, said)]
    if not bags:
        raise InputError("; ".join(said) or f"{path}: there is no bag in it")
    warnings += said
    return bags


def _bags_in(folder: Path) -> List[Path]:
    found = {
        recording_of(p) for pattern in ("*.bag", f"*.bag{ACTIVE}") for p in folder.glob(pattern)
    }
    found |= {p.parent for p in folder.glob(f"*/{METADATA}")}
    return sorted(
        found | {p for suffix in ROS2_FILES for p in folder.glob(f"*{suffix}")},
        key=_machine_and_part,
    )


def _machine_and_part(bag: Path) -> Tuple[str, int, str]:
    """
    >>> sorted(map(Path, ("uav1.10.bag", "uav1.2.bag", "uav1.bag", "control.bag")), key=_machine_and_part)
    [PosixPath('control.bag'), PosixPath('uav1.bag'), PosixPath('uav1.2.bag'), PosixPath('uav1.10.bag')]
    """
    machine = bag.name.partition(".")[0]
    return machine, part_number(bag.name, f"{machine}.bag"), bag.name


def _without_copies(bags: List[Path], said: List[str]) -> List[Path]:
    """Keeps, of bags that are the same to the last byte, the one with the shortest name (uav1.bag,
    not "uav1 (1).bag")."""
    kept: List[Path] = []
    for bag in sorted(set(bags), key=lambda b: (len(b.name), b.name)):
        of = next((k for k in kept if _same_bag(k, bag)), None)
        if of is None:
            kept.append(bag)
        else:
            said.append(f"{bag} is a copy of {of.name}: left out; delete one of them")
    return [bag for bag in dict.fromkeys(bags) if bag in kept]


def _same_bag(a: Path, b: Path) -> bool:
    if a.is_dir() and b.is_dir():  # of ROS 2: its files have the folder's name, or any
        of_a, of_b = (sorted(p for p in f.iterdir() if p.suffix in ROS2_FILES) for f in (a, b))
        return len(of_a) == len(of_b) > 0 and all(
            filecmp.cmp(x, y, shallow=False) for x, y in zip(of_a, of_b)
        )
    return a.is_file() and b.is_file() and filecmp.cmp(a, b, shallow=False)


def _listed(path: Path) -> List[Path]:
    """Those of session.yaml and further parts that lie beside them, or all where there is no
    session.yaml."""
    if not path.is_dir() or is_ros2(path):
        return [path]
    description = path / "session.yaml"
    if not description.exists():
        return _bags_in(path)
    names: List[str] = []
    try:
        document = read_yaml(description)
        for machine, first in document["bags"].items():
            parts = [first, *(document.get("parts") or {}).get(machine, ())]
            if first.endswith(".bag"):
                parts = sorted(
                    {*parts, *(p.name for p in parts_in(path, first))},
                    key=lambda n: part_number(n, first),
                )
            names += parts
    except ConfigError as error:
        raise InputError(str(error)) from error
    except (TypeError, KeyError, AttributeError) as error:
        raise InputError(
            f"{description}: 'bags' must name a bag for every machine (bags: {{uav1: uav1.bag}})"
        ) from error
    return [path / name for name in names]


def _opened(bag: Path, said: List[str]) -> List[Path]:
    """The bag, or nothing."""
    active = bag.with_name(bag.name + ACTIVE)
    source = bag if bag.exists() or not active.exists() else active
    if not source.exists():
        said.append(f"{bag} is missing: copy it from its machine into the session")
        return []
    if is_ros2(source):
        return [source]
    try:
        target, salvaged = repaired(source)
    except BagError as error:
        said.append(f"{error}; its pictures and poses are left out")
        return []
    if salvaged is not None:
        lost = "".join(f"; {text}" for text in salvaged.problems)
        said.append(
            f"{source} was not closed or is damaged: repaired, {salvaged}{lost}; the original is {target.name}{KEPT}"
        )
    return [target]

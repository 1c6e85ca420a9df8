# SPDX-License-Identifier: Apache-2.0
"""The bags of a session: all parts of every machine, repaired where they were not closed; what is missing is said.

Bags of ROS 2 are opened as they are.
"""

from pathlib import Path
from typing import List

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
    """Bags to open, in order. A part that is missing or cannot be repaired is left out with a warning.

    Raises InputError where none is left, or where session.yaml is none.
    """
    said: List[str] = []
    bags = [bag for name in _listed(path) for bag in _opened(name, said)]
    if not bags:
        raise InputError("; ".join(said) or f"{path}: there is no bag in it")
    warnings += said
    return bags


def _bags_in(folder: Path) -> List[Path]:
    found = {recording_of(p) for pattern in ("*.bag", f"*.bag{ACTIVE}") for p in folder.glob(pattern)}
    found |= {p.parent for p in folder.glob(f"*/{METADATA}")}
    return sorted(found | {p for suffix in ROS2_FILES for p in folder.glob(f"*{suffix}")})


def _listed(path: Path) -> List[Path]:
    """Those of session.yaml and further parts that lie beside them, or all where there is no session.yaml."""
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
                parts = sorted({*parts, *(p.name for p in parts_in(path, first))}, key=lambda n: part_number(n, first))
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
        said.append(f"{source} was not closed or is damaged: repaired, {salvaged}; the original is {target.name}{KEPT}")
    return [target]

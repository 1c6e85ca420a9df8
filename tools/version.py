#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The version of the workspace: VERSION has it, and this writes it into every place that must
repeat it.

python tools/version.py 0.3.0 sets another one; without an argument the places are written as
VERSION says; --check only names those that differ.
"""

import argparse
import re
import sys
from pathlib import Path
from typing import List, Optional

ROOT = Path(__file__).resolve().parents[1]
_VERSION = re.compile(r"\d+\.\d+\.\d+")
#: What stands before and behind the version in each kind of file.
_PATTERNS = {
    "package.xml": r"(?m)(^  <version>)[^<]*(</version>)",
    "pyproject.toml": r'(?m)(^version = ")[^"]*(")',
    "version.py": r'(?m)(^VERSION = ")[^"]*(")',
}


def places(root: Path) -> List[Path]:
    """Files that repeat the version: our packages, the wheel, the module that programs read.

    ``mavros_msgs`` keeps MAVROS's version.
    """
    packages = sorted(root.glob("src/fcsv_*/package.xml"))
    return [
        *packages,
        root / "pyproject.toml",
        root / "src/fcsv_geometry/src/fcsv_geometry/version.py",
    ]


def version_of(root: Path) -> str:
    """The version in the file VERSION.

    Raises:
        ValueError: It is no MAJOR.MINOR.PATCH.
    """
    version = (root / "VERSION").read_text().strip()
    if not _VERSION.fullmatch(version):
        raise ValueError(f"VERSION holds '{version}', which is no MAJOR.MINOR.PATCH")
    return version


def with_version(path: Path, version: str) -> str:
    """Text of a file with that version in its place.

    Raises:
        ValueError: The file has not exactly one place for it.
    """
    text, found = re.subn(_PATTERNS[path.name], rf"\g<1>{version}\g<2>", path.read_text())
    if found != 1:
        raise ValueError(f"{path}: {found} places for a version, not one")
    return text


def differing(root: Path) -> List[Path]:
    """Files that repeat another version than VERSION has."""
    version = version_of(root)
    return [p for p in places(root) if p.read_text() != with_version(p, version)]


def main(argv: Optional[List[str]] = None, root: Path = ROOT) -> int:
    parser = argparse.ArgumentParser(prog="version", description=__doc__.split("\n")[0])
    parser.add_argument("version", nargs="?", help="MAJOR.MINOR.PATCH; default: what VERSION has")
    parser.add_argument(
        "--check", action="store_true", help="change nothing; exit status 1 where a file differs"
    )
    args = parser.parse_args(argv)
    if args.version is not None:
        if args.check:
            parser.error(f"--check changes nothing: leave out {args.version}")
        if not _VERSION.fullmatch(args.version):
            parser.error(f"'{args.version}' is no MAJOR.MINOR.PATCH")
        (root / "VERSION").write_text(args.version + "\n")
    wrong = differing(root)
    for path in wrong:
        if not args.check:
            path.write_text(with_version(path, version_of(root)))
        print(f"{path.relative_to(root)}: {'not ' if args.check else ''}{version_of(root)}")
    return 1 if args.check and wrong else 0


if __name__ == "__main__":
    sys.exit(main())

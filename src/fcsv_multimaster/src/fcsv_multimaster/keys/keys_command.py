# SPDX-License-Identifier: Apache-2.0
"""rosrun fcsv_multimaster keys: make the keys of a fleet, or revoke those of a machine (keys revoke
FOLDER NAME)."""

import argparse
import sys
from typing import List, Optional, Sequence

from fcsv_geometry.errors import FcsvError
from fcsv_multimaster.keys.keyring import make_fleet, revoke


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Exit status."""
    argv = list(sys.argv[1:] if argv is None else argv)
    try:
        return _revoke(argv[1:]) if argv[:1] == ["revoke"] else _make(argv)
    except FcsvError as error:
        print(f"keys: {error}", file=sys.stderr)
        return 1


def _make(argv: List[str]) -> int:
    parser = argparse.ArgumentParser(prog="keys", description=__doc__)
    parser.add_argument(
        "folder", help="where they go; keep fleet.key at home, copy NAME/ to the machine NAME"
    )
    parser.add_argument(
        "names",
        nargs="+",
        help="machines, e.g. control uav1 uav2; one that has keys keeps them,"
        " unless they are revoked or run out within 30 days",
    )
    parser.add_argument("--days", type=int, default=3650, help="how long they are good")
    arguments = parser.parse_args(argv)
    if not 1 <= arguments.days <= 36500:
        parser.error("--days must be in 1..36500")
    folders = make_fleet(arguments.folder, arguments.names, arguments.days)
    for name, folder in zip(arguments.names, folders):
        print(f"{folder}  -> copy to {name}, and give its relay keys:=<that folder>")
    return 0


def _revoke(argv: List[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="keys revoke", description="the present keys of these machines: no more"
    )
    parser.add_argument("folder", help="in which the keys were made")
    parser.add_argument("names", nargs="+", help="machines whose keys were lost or copied")
    arguments = parser.parse_args(argv)
    for path in revoke(arguments.folder, arguments.names):
        if path.parent.name not in arguments.names:
            print(
                f"{path}  -> copy into the keys' folder of {path.parent.name}, and restart its relay"
            )
    names = " ".join(arguments.names)
    print(f"new keys for {names}: rosrun fcsv_multimaster keys {arguments.folder} {names}")
    return 0

# SPDX-License-Identifier: Apache-2.0
"""rosrun fcsv_multimaster keys: make the keys of a fleet."""

import argparse
import sys
from typing import Optional, Sequence

from fcsv_geometry.errors import FcsvError
from fcsv_multimaster.keyring import make_fleet


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Exit status."""
    parser = argparse.ArgumentParser(prog="keys", description=__doc__)
    parser.add_argument("folder", help="where they go; keep fleet.key at home, copy NAME/ to the machine NAME")
    parser.add_argument("names", nargs="+", help="machines, e.g. control uav1 uav2; one that has keys keeps them")
    parser.add_argument("--days", type=int, default=3650, help="how long they are good")
    arguments = parser.parse_args(argv)
    if not 1 <= arguments.days <= 36500:
        parser.error("--days must be in 1..36500")
    try:
        folders = make_fleet(arguments.folder, arguments.names, arguments.days)
    except FcsvError as error:
        print(f"keys: {error}", file=sys.stderr)
        return 1
    for name, folder in zip(arguments.names, folders):
        print(f"{folder}  -> copy to {name}, and give its relay keys:=<that folder>")
    return 0

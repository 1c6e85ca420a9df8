# SPDX-License-Identifier: Apache-2.0
"""The command ``fcsv COMMAND ...`` without ROS: each is what ``rosrun fcsv_stereo`` runs."""

import importlib
import sys
from typing import List, Optional

from fcsv_geometry.programs.commands import loading
from fcsv_geometry.version import VERSION

#: by name: the module whose ``main(arguments)`` it is, and what it does
COMMANDS = {
    "map": (
        "fcsv_stereo.cli",
        "depth, a cloud and a report from a session, a bag or posed photographs",
    ),
    "survey": (
        "fcsv_stereo.survey.command",
        "several sessions, photographs or maps joined to one site",
    ),
    "plan": ("fcsv_stereo.planning.command", "the baselines to fly, their ranges and errors"),
    "import-photos": (
        "fcsv_stereo.photos.command",
        "GPS-tagged photographs as a folder that map reads, in metres",
    ),
    "import-bag": (
        "fcsv_stereo.bag_import.command",
        "any bag with posed cameras as a folder that map reads",
    ),
    "check": (
        "fcsv_control.file_check.command",
        "whether missions, vehicle files and other configuration are good",
    ),
    "ground": (
        "fcsv_guidance.files.command",
        "where a robot can drive, from maps; a route across it",
    ),
}
_HELP = ("-h", "--help")


def main(argv: Optional[List[str]] = None) -> int:
    """Exit status of the command; 2 with one line on stderr where there is none of that name."""
    name, *rest = (sys.argv[1:] if argv is None else argv) or ["--help"]
    if name in COMMANDS:
        with loading(f"fcsv {name}"):
            command = importlib.import_module(COMMANDS[name][0])
        return command.main(rest)
    if name in _HELP:
        print(usage())
        return 0
    if name == "--version":
        print(f"fcsv {VERSION}")
        return 0
    print(f"fcsv: there is no command '{name}'; there are {', '.join(COMMANDS)}", file=sys.stderr)
    return 2


def usage() -> str:
    lines = [f"  {name:14} {words}" for name, (_, words) in COMMANDS.items()]
    return "\n".join(
        [
            "usage: fcsv COMMAND ...   (fcsv COMMAND --help tells its options; fcsv --version)",
            *lines,
        ]
    )

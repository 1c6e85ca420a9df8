# SPDX-License-Identifier: Apache-2.0
"""``rosrun fcsv_control signing``: an autopilot gets the key with which MAVLink is signed, or loses
it."""

import argparse
from typing import List, Optional

from fcsv_control.errors import ControlError, LinkError
from fcsv_control.flight.mavlink.signing import read_key
from fcsv_control.flight_check.autopilot_line import reached_by_nobody_else
from fcsv_control.parameters.vehicle import Vehicle
from fcsv_geometry.programs import commands

_TRIES = 3
_ANSWERS_S = 5.0
_PROBE = "VISO_TYPE"  # every ArduCopter that is flown here has it
_EXAMPLES = """LINE is a line to the vehicle, as the flight link's fcu_url; end the flight link first. A key is set
over a cable or on loopback alone, because it crosses the line as it is; on the ground, with motors off.

examples:
  (umask 077; openssl rand -hex 32 > ~/uav1.key)
  signing set /dev/ttyACM0:115200 --key ~/uav1.key
  signing check udpin:0.0.0.0:14550 --key ~/uav1.key
  signing remove /dev/ttyACM0:115200

exit status: 0 done, and seen on the line; 1 it is otherwise there; 2 a wrong argument, file or line.
"""


def main(argv: Optional[List[str]] = None) -> int:
    """The command."""
    acts = {"set": _set, "check": _check, "remove": _remove}
    return commands.run(_parser(), argv, lambda args: acts[args.action](args))


def _set(args) -> int:
    key = read_key(args.key)
    if not any(key):
        raise ControlError(f"{args.key}: a key of zeros alone means no key; take another")
    if not reached_by_nobody_else(args.line):
        raise ControlError(
            f"'{args.line}' leaves the computer: who listens would have the key; set it over its cable"
        )
    old = read_key(args.old_key) if args.old_key else None
    for _ in range(_TRIES):  # nothing says that it arrived, and a line may lose it
        with Vehicle(args.line, args.system, key=old) as vehicle:
            vehicle.set_up_signing(key)
            said = vehicle.complaints
        if _speaks(args, key):
            print(
                f"the autopilot signs with {args.key}, on all its lines, and goes on after a restart"
            )
            print(
                "give the key to whoever else speaks to it: signing_key:=FILE of uav.launch, and the ground station"
            )
            return 0
    words = f": {said[-1]}" if said else ""
    hint = "is --old-key what it signs with? Within a minute of its start or its last key try again"
    raise ControlError(f"the autopilot does not sign with {args.key}{words}; {hint}")


def _check(args) -> int:
    if not _speaks(args, read_key(args.key)):
        print(f"nobody who signs with {args.key} speaks and answers at '{args.line}'")
        return 1
    print(f"the autopilot signs with {args.key}, and answers who does")
    obeys = _speaks(args, None)
    cable = (
        "; so does ArduCopter on its first port (SERIAL0, USB), whatever it was told"
        if obeys
        else ""
    )
    print(f"it answers {'also' if obeys else 'nobody'} who does not sign{cable}")
    return 1 if obeys and not reached_by_nobody_else(args.line) else 0


def _remove(args) -> int:
    with Vehicle(args.line, args.system, key=read_key(args.key) if args.key else None) as vehicle:
        vehicle.set_up_signing(None)
        said = vehicle.complaints
    if not _speaks(args, None) or said:
        words = f": {said[-1]}" if said else "; on another port than USB give --key"
        raise ControlError(f"the autopilot still has a key{words}")
    print("the autopilot answers who does not sign: whoever reaches one of its lines flies it")
    return 0


def _speaks(args, key: Optional[bytes]) -> bool:
    """Whether an autopilot is heard over a line opened anew, and answers."""
    try:
        with Vehicle(args.line, args.system, patience_s=_ANSWERS_S, key=key) as vehicle:
            return bool(vehicle.read([_PROBE], _TRIES)[0])
    except LinkError:
        return False


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="signing",
        description="An autopilot's key for signed MAVLink: set it, check the line, take it away.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    actions = parser.add_subparsers(dest="action", required=True, metavar="set|check|remove")
    for name, words in (
        ("set", "give the autopilot a key, then speak with it signed"),
        ("check", "speak with it signed, then unsigned"),
        ("remove", "take the key away: nothing is signed"),
    ):
        action = actions.add_parser(name, help=words)
        action.add_argument("line", metavar="LINE")
        words = "key file, mode 0600: 64 hexadecimal digits"
        words = f"{words} (on USB none is needed)" if name == "remove" else words
        action.add_argument("--key", metavar="FILE", required=name != "remove", help=words)
        action.add_argument(
            "--system", type=int, default=0, help="system id (default: the first that is heard)"
        )
        if name == "set":
            action.add_argument(
                "--old-key", metavar="FILE", help="with which it signs now (on USB none is needed)"
            )
    return parser

# SPDX-License-Identifier: Apache-2.0
"""``rosrun fcsv_control parameters``: an autopilot's parameters compared with a profile, written,
saved."""

import argparse
import math
from pathlib import Path
from typing import Dict, List, Optional, Tuple

from tqdm import tqdm

from fcsv_control.errors import ProfileError
from fcsv_control.flight.mavlink.signing import read_key
from fcsv_control.flight.settings import parameter_files
from fcsv_control.flight.settings.profile import Profile, load_profile, port_of
from fcsv_control.parameters.vehicle import Vehicle
from fcsv_geometry.programs import commands
from fcsv_geometry.programs.writing import require_file

_PROFILE = "config/autopilot/arducopter-4.3-t265.param"
_EXAMPLES = """SOURCE is a line to a vehicle, as the flight link's fcu_url (udpin:0.0.0.0:14550, tcp:HOST:5760,
/dev/ttyACM0:115200; end the flight link first), or a file as Mission Planner (.param) or
QGroundControl (.params) saves it.

examples:
  parameters compare /dev/ttyACM0:115200
  parameters compare uav1_before_flight.param
  parameters save tcp:127.0.0.1:5760 -o uav1.param
  parameters write /dev/ttyACM0:115200 --dry-run             # what of the profile would be written
  parameters write /dev/ttyACM0:115200 --values uav1.param   # as it was saved
  parameters write /dev/ttyACM0:115200 --set WPNAV_SPEED=100 # for a mission that plans with 1 m/s

exit status: 0 all that must be so is so; 1 something is not; 2 a wrong argument, file or line.
"""


def main(argv: Optional[List[str]] = None) -> int:
    acts = {"compare": _compare, "write": _write, "save": _save}
    return commands.run(_parser(), argv, lambda args: acts[args.action](args), writes=("output",))


def _profile(args) -> Profile:
    """Reads the profile with the stream rates of the autopilot's port that the option, or else the
    line, names; a file is no line."""
    port = args.port
    if port is None:
        port = 0 if Path(args.source).is_file() else port_of(args.source)
    return load_profile(args.profile).at_port(port)


def _compare(args) -> int:
    profile = _profile(args)
    values, unknown = _values(args, profile)
    return _table(profile, values, unknown)


def _table(profile: Profile, values: Dict[str, float], unknown: List[str]) -> int:
    """Print what does not fit; the exit status."""
    wrong = [rule for rule in profile if rule.name in values and rule.complaint(values[rule.name])]
    for rule in sorted(wrong, key=lambda rule: not rule.must):
        print(f"{_level(rule.must)}  {rule.complaint(values[rule.name])}")
    for name in unknown:
        print(
            f"{_level(profile.rule(name).must)}  {name} is not known there: has this firmware another name for it?"
        )
    blocks = sum(rule.must for rule in wrong) + sum(profile.rule(name).must for name in unknown)
    advised = len(wrong) + len(unknown) - blocks
    print(
        f"{profile.name}: {len(profile.rules)} parameters, {blocks} that must be otherwise, {advised} that should be"
    )
    return 1 if blocks else 0


def _level(must: bool) -> str:
    return "MUST   " if must else "advised"


def _values(args, profile: Profile) -> Tuple[Dict[str, float], List[str]]:
    """Values of the profile's names, and names that are not there."""
    names = [rule.name for rule in profile]
    if Path(args.source).is_file():
        saved = parameter_files.read(args.source)
        return {n: saved[n] for n in names if n in saved}, [n for n in names if n not in saved]
    with _vehicle(args) as vehicle:
        read, unknown = vehicle.read(names)
        return {name: value for name, (value, _) in read.items()}, unknown


def _write(args) -> int:
    profile = _profile(args)
    exactly = bool(args.values or args.set)
    wanted = (
        parameter_files.read(args.values) if args.values else {} if args.set else profile.values
    )
    wanted.update(args.set or ())
    if args.must and not exactly:
        wanted = {n: v for n, v in wanted.items() if profile.rule(n).must}
    with _vehicle(args) as vehicle:
        read, unknown = vehicle.read(wanted)
        due = {
            n: v
            for n, v in wanted.items()
            if n in read and not _same(profile, exactly, n, v, read[n][0])
        }
        for name, value in due.items():
            print(f"{name} {read[name][0]:g} -> {value:g}")
        for name in unknown:
            print(f"{name} is not known there: left out")
        if args.dry_run:
            print(f"{len(due)} would be written")
            return 0
        failed = vehicle.write(due)
        for line in failed:
            print(f"not written: {line}")
        print(
            f"wrote {len(due) - len(failed)} of {len(due)} to the {vehicle.firmware} with system id {vehicle.system}"
        )
        if due:
            print(
                "restart the autopilot, then compare: some count from its start, and some appear with others"
            )
        return 1 if failed else 0


def _same(profile: Profile, exactly: bool, name: str, wanted: float, value: float) -> bool:
    """Whether a value may stay: it is the wanted one, or one that the profile takes as well."""
    if abs(wanted - value) <= 1e-6 * max(1.0, abs(wanted)):
        return True
    return not exactly and not profile.rule(name).complaint(value)


def _save(args) -> int:
    target = Path(args.output)
    if not target.parent.is_dir():
        raise ProfileError(f"{target}: there is no folder {target.parent}")
    require_file(target)
    with _vehicle(args) as vehicle:
        with tqdm(unit="parameter", disable=None) as bar:

            def progress(count: int, total: int) -> None:
                bar.total = total or None
                bar.update(count - bar.n)

            values = vehicle.read_all(progress)
        text = parameter_files.mission_planner(values)
        if target.suffix == ".params":
            text = parameter_files.qgroundcontrol(values, vehicle.system)
    target.write_text(text)
    print(f"wrote {len(values)} parameters to {target}")
    return 0


def _vehicle(args) -> Vehicle:
    if "/" not in args.source and ":" not in args.source:
        raise ProfileError(
            f"'{args.source}' is neither a file nor a line (tcp:HOST:PORT, udpin:HOST:PORT, /dev/...)"
        )
    return Vehicle(args.source, args.system, key=read_key(args.key) if args.key else None)


def _assignment(text: str) -> Tuple[str, float]:
    """
    >>> _assignment("WPNAV_SPEED=100")
    ('WPNAV_SPEED', 100.0)
    """
    name, found, value = text.partition("=")
    try:
        if name and found and math.isfinite(float(value)):
            return name, float(value)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"'{text}' is not NAME=VALUE, as WPNAV_SPEED=100")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="parameters",
        description="An autopilot's parameters: compare with a profile, write it, save all.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    actions = parser.add_subparsers(dest="action", required=True, metavar="compare|write|save")
    for name, words in (
        ("compare", "name what is not as the profile says"),
        ("write", "set what is not as the profile says"),
        ("save", "all parameters into a file"),
    ):
        action = actions.add_parser(name, help=words)
        action.add_argument("source", metavar="SOURCE" if name == "compare" else "LINE")
        action.add_argument(
            "--system", type=int, default=0, help="system id (default: the first that is heard)"
        )
        action.add_argument("--key", metavar="FILE", help="key with which the line is signed")
        if name != "save":
            action.add_argument("--profile", default=_PROFILE, help="(default %(default)s)")
            words = "its port whose stream rates count: 1 for SR1_ (default: 2 for a device that is not USB, else 0)"
            action.add_argument("--port", type=int, choices=range(7), help=words)
        if name == "write":
            action.add_argument("--must", action="store_true", help="only what must be so")
            action.add_argument(
                "--values", metavar="FILE", help="set what this file holds instead, exactly"
            )
            words = "set this one alone, or beside FILE's; may be given several times"
            action.add_argument(
                "--set", metavar="NAME=VALUE", type=_assignment, action="append", help=words
            )
            action.add_argument("--dry-run", action="store_true", help="print only")
        if name == "save":
            action.add_argument(
                "-o", "--output", required=True, help=".param, or .params for QGroundControl"
            )
    return parser

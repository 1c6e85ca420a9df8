# SPDX-License-Identifier: Apache-2.0
"""Prepare this machine for the field: systemd units, clock (chrony), firewall (nftables), ROS_IP.

Without --apply it shows what it would write and run, and changes nothing. Files that it did not
write it leaves alone.
"""

import argparse
import difflib
import getpass
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from typing import Dict, List, Optional

sys.path.insert(0, str(Path(__file__).resolve().parent))
from files import (
    ALL_FILES,
    FIREWALL,
    MARK,
    SERVICE,
    InstallError,
    Plan,
    chrony_conf,
    files,
    parse_peers,
)

WORKSPACE = Path(__file__).resolve().parents[2]
CHRONY_CONF = "/etc/chrony/chrony.conf"
OPTIONAL = ("modprobe", "sysctl")  # congestion control: a kernel may lack bbr
PROGRAMS = {"nft": "nftables", "chronyd": "chrony", "systemctl": "systemd"}


def arguments(argv) -> argparse.Namespace:
    user = os.environ.get("SUDO_USER") or getpass.getuser()
    parser = argparse.ArgumentParser(prog="install_vehicle.sh", description=__doc__)
    parser.add_argument(
        "--role", help="control, or this vehicle's name (config/vehicles/NAME.yaml)"
    )
    parser.add_argument(
        "--radio", default="wlan0", help="network interface of the radio (default %(default)s)"
    )
    parser.add_argument("--peers", default="", help="the other machines: NAME=HOST:PORT,...")
    parser.add_argument(
        "--port", type=int, default=7447, help="of this machine's relay; it uses the next one too"
    )
    parser.add_argument(
        "--keys", help="folder of this machine's keys (default ~/fcsv-keys of the user)"
    )
    parser.add_argument("--user", default=user, help="who runs it (default %(default)s)")
    parser.add_argument("--record-dir", help="where bags go (default ~/fcsv/session of the user)")
    parser.add_argument(
        "--mission", default="", help="control only: start by itself with this mission file"
    )
    parser.add_argument(
        "--ssh", action="store_true", help="leave port 22 open on the radio, to copy keys and bags"
    )
    parser.add_argument(
        "--install-space", default="", metavar="PREFIX", help="start from it, not from devel/"
    )
    parser.add_argument(
        "--launch",
        action="append",
        default=[],
        help="NAME:=VALUE for roslaunch, as often as needed",
    )
    parser.add_argument(
        "--root", default="/", help="write below this folder and run nothing (for images and tests)"
    )
    parser.add_argument("--uninstall", action="store_true", help="take away what was written")
    parser.add_argument("--apply", action="store_true", help="do it; without, only show it")
    return parser.parse_args(argv)


def came_by_ssh() -> bool:
    """Whether an sshd is among the parents of this process; sudo hides SSH_CONNECTION."""
    process = os.getpid()
    while process > 1:
        status = dict(
            line.split(":", 1) for line in Path(f"/proc/{process}/status").read_text().splitlines()
        )
        if status["Name"].strip().startswith("sshd"):
            return True
        process = int(status["PPid"])
    return False


def plan_of(given: argparse.Namespace) -> Plan:
    if not given.role:
        raise InstallError("--role is missing: control, or this vehicle's name")
    if given.apply and given.root == "/" and not given.ssh and came_by_ssh():
        raise InstallError(
            "you came by ssh, which this would close on the radio; add --ssh, or sit down at it"
        )
    home = os.path.expanduser(f"~{given.user}")
    if home.startswith("~"):
        raise InstallError(f"--user '{given.user}' is unknown on this machine")
    space = os.path.abspath(given.install_space) if given.install_space else ""
    if space and not (Path(space) / "setup.bash").is_file():
        raise InstallError(
            f"--install-space {space}: holds no setup.bash; make it with `cmake --install build`"
        )
    config = Path(space) / "share/fcsv_bringup/config" if space else WORKSPACE / "config"
    vehicle = config / "vehicles" / f"{given.role}.yaml"
    if given.role != "control" and given.role.isidentifier() and not vehicle.is_file():
        raise InstallError(
            f"--role '{given.role}': {vehicle} is missing; where camera and tag sit stands there"
        )
    return Plan(
        given.role,
        given.radio,
        parse_peers(given.peers),
        given.port,
        str(WORKSPACE),
        given.user,
        given.keys or f"{home}/fcsv-keys",
        given.record_dir or f"{home}/fcsv/session",
        given.ssh,
        given.mission,
        tuple(given.launch),
        space,
    )


def radio_missing(radio: str) -> str:
    """Why a firewall for this interface would close nothing; "" where the interface is there."""
    here = [name for _, name in socket.if_nameindex()]
    return "" if radio in here else f"--radio '{radio}': this machine has only {', '.join(here)}"


def changes(wanted: Dict[str, str], root: Path) -> Dict[Path, Optional[str]]:
    """Path to new text, or None where a file goes; only what differs from what is there. Raises
    InstallError."""
    out: Dict[Path, Optional[str]] = {}
    for name in ALL_FILES:
        path, text = root / name[1:], wanted.get(name)
        there = path.read_text() if path.exists() else None
        if there is not None and MARK not in there:
            if text is not None:
                raise InstallError(f"{path}: is there and not ours; move it away first")
            continue
        if there != text:
            out[path] = text
    conf = root / CHRONY_CONF[1:]
    if conf.exists():
        new = chrony_conf(conf.read_text(), bool(wanted))
        if new != conf.read_text():
            out[conf] = new
    return out


def show(todo: Dict[Path, Optional[str]]) -> None:
    for path, text in todo.items():
        there = path.read_text().splitlines() if path.exists() else []
        if text is None:
            print(f"--- {path}: is taken away")
        else:
            print(
                "\n".join(
                    difflib.unified_diff(
                        there, text.splitlines(), f"{path} (now)", str(path), lineterm=""
                    )
                )
            )


def write(path: Path, text: Optional[str]) -> None:
    if text is None:
        path.unlink()
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(path.name + ".new")
    fresh.write_text(text)
    fresh.chmod(0o644)
    fresh.replace(path)  # whole or not at all


def commands(wanted: Dict[str, str], plan: Optional[Plan]) -> List[List[str]]:
    """What is run once the files are as they should be."""
    if not wanted:
        return [["systemctl", "daemon-reload"], ["systemctl", "restart", "chrony"]]
    out = [
        ["systemctl", "daemon-reload"],
        ["systemctl", "enable", FIREWALL],
        ["systemctl", "restart", FIREWALL],
        ["systemctl", "restart", "chrony"],
        ["modprobe", "tcp_bbr"],
        ["sysctl", "-q", "-p", "/etc/sysctl.d/90-fcsv.conf"],
    ]
    return out + (
        [["systemctl", "enable", SERVICE]] if plan is not None and plan.starts_by_itself else []
    )


def before(wanted: Dict[str, str], root: Path) -> List[List[str]]:
    """What is stopped while its files are still there."""
    gone = [u for u in (SERVICE, FIREWALL) if f"/etc/systemd/system/{u}" not in wanted]
    there = [u for u in gone if (root / "etc/systemd/system" / u).exists()]
    return [["systemctl", "disable", "--now", unit] for unit in there]


def perform(steps: List[List[str]]) -> None:
    for step in steps:
        print("+ " + " ".join(step), flush=True)
        done = subprocess.run(step, capture_output=True, text=True)
        failed = f"`{' '.join(step)}` failed: {(done.stderr or done.stdout).strip()}"
        if done.returncode and step[0] not in OPTIONAL:
            raise InstallError(failed)
        if done.returncode:
            print(f"install_vehicle.sh: {failed}; pictures come slower without it", file=sys.stderr)


def main(argv=None) -> int:
    """Exit status."""
    given = arguments(argv)
    root = Path(given.root)
    try:
        plan = None if given.uninstall else plan_of(given)
        wanted = {} if plan is None else files(plan)
        todo = changes(wanted, root)
        alone = given.root == "/"
        stops, starts = (before(wanted, root), commands(wanted, plan)) if alone else ([], [])
        if not given.apply:
            show(todo)
            for step in [*stops, *starts] if todo else []:
                print("+ " + " ".join(step))
            print(
                f"nothing was changed: {len(todo)} files would be; add --apply"
                if todo
                else "nothing is to be done"
            )
            if alone and plan is not None and radio_missing(plan.radio):
                print(f"with --apply it would be refused: {radio_missing(plan.radio)}")
            return 0
        if alone and os.geteuid() != 0:
            raise InstallError("--apply needs root: use sudo")
        if alone and plan is not None and radio_missing(plan.radio):
            raise InstallError(radio_missing(plan.radio))
        missing = [
            package
            for program, package in PROGRAMS.items()
            if alone and wanted and not shutil.which(program)
        ]
        if missing:
            raise InstallError(
                f"missing: {', '.join(missing)}; `apt-get install {' '.join(missing)}` first"
            )
        perform(stops)
        for path, text in todo.items():
            write(path, text)
            print(f"{'taken away' if text is None else 'written'}: {path}")
        perform(starts if todo else [])
    except (InstallError, OSError) as error:
        print(f"install_vehicle.sh: {error}", file=sys.stderr)
        return 1
    if plan is not None and alone and plan.starts_by_itself:
        print(f"{SERVICE} starts with the next boot, or now: systemctl start {SERVICE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

# SPDX-License-Identifier: Apache-2.0
"""rosrun fcsv_console status: the operator's view on a terminal of 80 columns, with stop-all and
land by key."""

import argparse
import contextlib
import select
import sys
import termios
import time
import tty
from dataclasses import replace
from typing import Iterator, Optional, Sequence

import rospy
from rich.console import Console as Screen
from rich.live import Live

from fcsv_console.model.actions import paused
from fcsv_console.ros.shell import ConsoleShell, open_shell
from fcsv_console.terminal.screen import WIDTH, screen
from fcsv_geometry.errors import FcsvError

KEYS = {"S": "stop_all", "L": "land", "P": "pause", "G": "hand_over"}
_REFRESH_S = 0.25
_ONCE_S = 3.0


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Exit status: 0; 2 where a vehicle file cannot be used."""
    parser = argparse.ArgumentParser(prog="status", description=__doc__)
    parser.add_argument(
        "--vehicles", default="", help="the column, front first; default: the mission node's"
    )
    parser.add_argument("--mission", default="", help="mission file; default: the mission node's")
    parser.add_argument(
        "--target-m", type=float, default=0.0, help="range wanted; default: the configuration's"
    )
    parser.add_argument("--once", action="store_true", help="print one screen after 3 s, and end")
    arguments = parser.parse_args(argv if argv is not None else rospy.myargv()[1:])
    names = [n for n in arguments.vehicles.split(",") if n]
    try:
        shell = open_shell("console_status", names, arguments.mission, arguments.target_m)
    except FcsvError as error:
        print(f"status: {error}", file=sys.stderr)
        return 2
    try:
        _once(shell) if arguments.once or not sys.stdin.isatty() else _watch(shell)
    except KeyboardInterrupt:
        pass
    finally:
        shell.close()
    return 0


def _once(shell: ConsoleShell) -> None:
    until_s = time.monotonic() + _ONCE_S
    while time.monotonic() < until_s:
        shell.view()
        time.sleep(0.1)
    Screen(width=WIDTH).print(screen(shell.view()))


def _watch(shell: ConsoleShell) -> None:
    shown = Live(screen(shell.view()), console=Screen(width=WIDTH), screen=True, auto_refresh=False)
    with _single_keys(), shown as live:
        while True:
            key = _key(_REFRESH_S)
            if key in ("q", "Q"):
                return
            press(shell, key)
            live.update(screen(shell.view()), refresh=True)


def press(shell: ConsoleShell, key: str) -> None:
    """Capital letters only, so that a slip of the finger does nothing; what is not enabled is told,
    not sent."""
    name = KEYS.get(key)
    if name is None:
        return
    view = shell.view()
    action = view.actions[name]
    if name == "hand_over" and not paused(view.mission.value):
        action = replace(
            action, why_not="nothing waits for Resume; vehicles are handed over in the window"
        )
    if action.enabled:
        shell.do(name)
    else:
        shell.console.answer(
            shell.console.ask(time.monotonic(), name), f"not now: {action.why_not}", False
        )


@contextlib.contextmanager
def _single_keys() -> Iterator[None]:
    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def _key(wait_s: float) -> str:
    ready, _, _ = select.select([sys.stdin], [], [], wait_s)
    return sys.stdin.read(1) if ready else ""

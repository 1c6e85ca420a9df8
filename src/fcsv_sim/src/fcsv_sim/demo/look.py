# SPDX-License-Identifier: Apache-2.0
"""The demo's end: the flight again, with its map, in rviz; the operator's window stays until it is closed."""

import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import List

from fcsv_sim.demo import interrupt
from fcsv_sim.demo.fleet import FleetPlan, assignments, workspace
from fcsv_sim.machines import slow_motion
from fcsv_sim.machines.machines import free_port
from fcsv_sim.robot.guided import BAG

_PLAY = """#!/bin/sh
# The flight again, with its map, in rviz and in the operator's window. More arguments go to playback.launch: rate:=2
# It brings the workspace's environment along: it works from any shell.
exec env {words} {command} "$@"
"""


def playback(plan: FleetPlan, map_folder: str = "map") -> List[str]:
    """The command that shows a demo's session with its map."""
    arguments = [f"session:={plan.session_folder}", f"out:={plan.folder / map_folder}"]
    drive = plan.guide_folder / BAG
    if drive.exists():  # the robot's, after the flight
        arguments += [f"parts:={drive}", "rviz_config:=guidance"]
    return [
        "roslaunch",
        "fcsv_bringup",
        "playback.launch",
        *arguments,
        f"vehicles:={','.join(plan.vehicles)}",
    ]


def write_play(plan: FleetPlan, map_folder: str = "map") -> None:
    """Writes the script that plays the flight back: ``make play OUT=FOLDER`` runs it."""
    script = _script(plan)
    script.write_text(
        _PLAY.format(words=assignments(workspace()), command=shlex.join(playback(plan, map_folder)))
    )
    script.chmod(0o755)


def _script(plan: FleetPlan) -> Path:
    return plan.folder / "play"


def look(plan: FleetPlan, map_folder: str = "map") -> None:
    """Prints the command; where rviz was asked for by somebody at a terminal, runs it until he closes rviz."""
    print(f"again:  {shlex.quote(str(_script(plan)))}")
    if plan.rviz and sys.stdin.isatty():
        print("rviz shows the flight and its map: close it, or press Ctrl-C, to end", flush=True)
        _play(plan, map_folder)


def stay(plan: FleetPlan) -> None:
    """Returns once the operator has closed the window of the flight, or pressed Ctrl-C; at once where none is open."""
    window = plan.window
    if window is None or not window.is_open:
        return
    what = f"After [F5] in it maps {plan.session_folder} and opens the report"
    print(
        f"the operator's window stays open: {what}; close it, or press Ctrl-C, to end", flush=True
    )
    try:
        window.wait()
    except interrupt.Interrupted:
        interrupt.uninterrupted(window.close)


def _play(plan: FleetPlan, map_folder: str) -> None:
    port = free_port()
    env = {
        **slow_motion.in_real_time(dict(os.environ)),
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
    }
    own = ["console:=false"] if plan.window is not None and plan.window.is_open else []
    command = [*playback(plan, map_folder), *own, "-p", str(port)]
    with open(plan.run_folder / "playback.log", "w") as log:
        child = subprocess.Popen(
            command, env=env, preexec_fn=os.setpgrp, stdout=log, stderr=subprocess.STDOUT
        )
    try:
        child.wait()
    except interrupt.Interrupted:
        child.send_signal(signal.SIGINT)
        child.wait()

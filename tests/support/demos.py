# SPDX-License-Identifier: Apache-2.0
"""A demo as a process of its own: what it says, and what it leaves behind."""

import json
import os
import signal
import socket
import subprocess
from pathlib import Path
from typing import List

import psutil

from support.waiting import within

FLIGHT_LIMIT_S = 700.0  # of slow motion, where the machine is busy


def start_demo(out: Path, *args: str) -> subprocess.Popen:
    out.mkdir(parents=True, exist_ok=True)
    command = [
        "rosrun",
        "fcsv_sim",
        "demo",
        "--out",
        str(out),
        "--rviz",
        "0",
        "--ready-s",
        "2",
        *args,
    ]
    log = open(out / "stdout.txt", "wb")
    # it opens no window on somebody's screen
    env = {k: v for k, v in os.environ.items() if k != "DISPLAY"}
    return subprocess.Popen(
        command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True, env=env
    )


def end(demo: subprocess.Popen) -> None:
    """With all that it started, where it is not over: killed, it would leave its masters and nodes
    behind."""
    if demo.poll() is None:
        demo.send_signal(signal.SIGINT)
        try:
            demo.wait(100.0)
        except subprocess.TimeoutExpired:
            demo.kill()


def said(out: Path) -> str:
    return (out / "stdout.txt").read_text(errors="replace")


def wait_for(
    out: Path, words: str, demo: subprocess.Popen, timeout_s: float = FLIGHT_LIMIT_S
) -> None:
    def lives():
        assert demo.poll() is None, f"the demo ended before it said '{words}':\n{said(out)[-3000:]}"

    within(timeout_s)(
        lambda: words in said(out),
        what=lambda: f"the demo says '{words}':\n{said(out)[-3000:]}",
        meanwhile=lives,
        every_s=0.2,
    )


def processes_of(out: Path) -> List[str]:
    """Those of this demo that still live."""
    lines = [
        f"{p.pid} {' '.join(p.info['cmdline'] or [])}" for p in psutil.process_iter(["cmdline"])
    ]
    return [line for line in lines if str(out) in line and "pytest" not in line]


def left_behind(out: Path) -> List[str]:
    """Processes and masters of this demo that still live."""
    mine = processes_of(out)
    for machine in json.loads((out / "run" / "fleet.json").read_text()).values():
        port = int(machine["ROS_MASTER_URI"].rsplit(":", 1)[1])
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                mine.append(f"a master on port {port}")
    return mine

# SPDX-License-Identifier: Apache-2.0
"""From the start of the window's process to its first drawn frame: bench_console --starts N."""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MISSION = Path(__file__).resolve().parents[1] / "config/missions/outdoor.yaml"
#: The console's own command, which tells by the machine's monotonic clock when its plan view was
#: drawn, and ends.
PROCESS = """
import sys, time
from fcsv_console.ros import window_command
from python_qt_binding.QtCore import QEvent, QObject, QTimer

class FirstFrame(QObject):
    def eventFilter(self, watched, event):
        if event.type() == QEvent.Paint:
            watched.removeEventFilter(self)
            QTimer.singleShot(0, self.drawn)
        return False

    def drawn(self):
        print(time.monotonic(), flush=True)
        self.app.quit()

connected = window_command.connected

def watched(shell, app):
    window = connected(shell, app)
    window.frame = FirstFrame(window)
    window.frame.app = app
    window.plan.installEventFilter(window.frame)
    return window

window_command.connected = watched
sys.exit(window_command.main(sys.argv[1:]))
"""


def starts(number: int) -> int:
    """Prints each start, on a master of its own. Without a screen: in memory."""
    from fcsv_sim.machines.machines import Machine

    with tempfile.TemporaryDirectory() as folder, Machine("bench", folder) as machine:
        env = {**os.environ, **{k: v for k, v in machine.env.items() if k.startswith("ROS_")}}
        if not env.get("DISPLAY"):
            env["QT_QPA_PLATFORM"] = "offscreen"
        command = [
            sys.executable,
            "-c",
            PROCESS,
            "--vehicles",
            "uav1,uav2",
            "--mission",
            str(MISSION),
        ]
        took_s, cpu_s = [], []
        for _ in range(number):
            before, begun_s = os.times(), time.monotonic()
            done = subprocess.run(
                command, env=env, stdout=subprocess.PIPE, text=True, timeout=120.0
            )
            words = done.stdout.split()
            if done.returncode or not words:
                print(
                    f"the window ended with status {done.returncode} before it was drawn",
                    file=sys.stderr,
                )
                return 1
            after = os.times()
            took_s.append(float(words[-1]) - begun_s)
            cpu_s.append(
                after.children_user
                + after.children_system
                - before.children_user
                - before.children_system
            )
            print(f"{took_s[-1]:.2f} s, {cpu_s[-1]:.2f} s of the processor", flush=True)
    print(
        f"from the process's start to the first drawn frame, {number} starts: first {took_s[0]:.2f} s, median "
        f"{statistics.median(took_s):.2f} s, longest {max(took_s):.2f} s"
    )
    return 0

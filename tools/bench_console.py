#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How quick the operator's window is, on a screen in memory: start, refreshes, growth of memory (docs/console.md)."""

import argparse
import os
import statistics
import sys
import time
from pathlib import Path

import psutil

BEGUN_S = time.monotonic()
ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    """Prints three figures."""
    parser = argparse.ArgumentParser(prog="bench_console", description=__doc__)
    parser.add_argument("--refreshes", type=int, default=600, help="refreshes to measure (default: a minute's)")
    arguments = parser.parse_args()
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from fcsv_console.model import facts, samples
    from fcsv_console.qt.window import ConsoleWindow
    from fcsv_console.ros.window_command import application

    app = application("dark")
    console = samples.console(str(ROOT / "config/missions/outdoor.yaml"))
    samples.flying(console)
    window = ConsoleWindow(console.view(samples.NOW_S), console.optics.fov_rad("horizontal"))
    window.show()
    app.processEvents()
    print(f"start, without interpreter and ROS: {time.monotonic() - BEGUN_S:.2f} s")
    process, took_s, memory = psutil.Process(), [], []
    for k in range(arguments.refreshes):
        now_s = samples.NOW_S + 0.1 * k
        for third in range(3):  # what two vehicles say in a tenth of a second
            for name, y in (("uav1", 0.0), ("uav2", -6.0 + 0.001 * k)):
                console.tell(now_s + third / 30.0, facts.OdometryHeard(name, (0.0, y, 8.0)))
                console.tell(now_s + third / 30.0, facts.CameraInHome(name, (0.0, y, 0.0), 0.0))
                console.tell(now_s + third / 30.0, facts.AutopilotState(name, True, True, "GUIDED"))
        begun_s = time.monotonic()
        window.show_view(console.view(now_s + 0.1))
        app.processEvents()
        took_s.append(time.monotonic() - begun_s)
        memory.append(process.memory_info().rss / 2**20)
    took_s.sort()
    print(f"refresh with drawing: median {1e3 * statistics.median(took_s):.1f} ms, 99 % within "
          f"{1e3 * took_s[int(0.99 * len(took_s))]:.1f} ms")  # fmt: skip
    half = memory[len(memory) // 2 :]
    print(f"memory: {memory[-1]:.0f} MiB, {half[-1] - half[0]:+.1f} MiB in the second half of {len(memory)} refreshes")
    return 0


if __name__ == "__main__":
    sys.exit(main())

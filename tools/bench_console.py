#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How quick the operator's window is, on a screen in memory: start, refreshes, memory
(docs/lab/results.md)."""

import argparse
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import psutil

BEGUN_S = time.monotonic()
ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    """Prints three figures."""
    parser = argparse.ArgumentParser(prog="bench_console", description=__doc__)
    parser.add_argument(
        "--refreshes", type=int, default=600, help="refreshes to measure (default: a minute's)"
    )
    parser.add_argument(
        "--clicks",
        type=int,
        default=0,
        help="clicks on stop-all until its topic is heard elsewhere",
    )
    parser.add_argument(
        "--playback",
        type=Path,
        metavar="SESSION",
        help="instead: the memory of a window that shows it",
    )
    parser.add_argument(
        "--minutes", type=float, default=30.0, help="of the bags' time to play (default: 30)"
    )
    parser.add_argument(
        "--rate",
        type=float,
        default=10.0,
        help="how much faster than it was recorded (default: 10)",
    )
    parser.add_argument(
        "--live",
        type=Path,
        metavar="SESSION",
        help="instead: beside a live map of it, played in real "
        "time; with rviz embedded where there is a screen (xvfb-run -a)",
    )
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="to measure beside a live map (default: 60)"
    )
    parser.add_argument(
        "--starts", type=int, metavar="N", help="instead: N starts, until the first drawn frame"
    )
    parser.add_argument(
        "--picture", type=Path, metavar="FILE", help="of the screen in the end of --live"
    )
    arguments = parser.parse_args()
    if arguments.live:
        from bench_console_live import beside_a_live_map

        return beside_a_live_map(
            arguments.live.resolve(), arguments.seconds, arguments.clicks, arguments.picture
        )
    if arguments.starts:
        from bench_console_start import starts

        return starts(arguments.starts)
    if arguments.playback:
        return playback(arguments.playback, arguments.minutes, arguments.rate)
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    from fcsv_console.model import facts, samples
    from fcsv_console.qt.window import ConsoleWindow
    from fcsv_console.ros.window_command import application

    app = application("dark")
    console = samples.console(str(ROOT / "config/missions/outdoor.yaml"))
    samples.flying(console)
    window = ConsoleWindow(console.view(samples.NOW_S))
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
    print(
        f"refresh with drawing: median {1e3 * statistics.median(took_s):.1f} ms, 99 % within "
        f"{1e3 * took_s[int(0.99 * len(took_s))]:.1f} ms"
    )
    half = memory[len(memory) // 2 :]
    print(
        f"memory: {memory[-1]:.0f} MiB, {half[-1] - half[0]:+.1f} MiB in the second half of {len(memory)} refreshes"
    )
    if arguments.clicks:
        clicks(arguments.clicks)
    return 0


def playback(session: Path, minutes: float, rate: float) -> int:
    """The bags of a session again and again, shown by the window as playback.launch opens it, its
    pictures too."""
    import tempfile

    import yaml

    from fcsv_sim.machines.machines import Machine

    vehicles = yaml.safe_load((session / "session.yaml").read_text())["vehicles"]
    bags = [str(session / f"{name}.bag") for name in ("control", *vehicles)]
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    with tempfile.TemporaryDirectory() as folder, Machine("playback", folder) as machine:
        shows = ["--recorded", "--vehicles", ",".join(vehicles)]
        window = machine.run(["rosrun", "fcsv_console", "console", *shows], "console")
        time.sleep(10.0)
        player = machine.run(
            ["rosbag", "play", "--quiet", "--loop", "--clock", "--rate", str(rate), *bags], "play"
        )
        begun_s, told, process = time.monotonic(), [], _window_of(window)
        while time.monotonic() - begun_s < 60.0 * minutes / rate:
            time.sleep(1.0)
            if window.returncode is not None or player.returncode is not None:
                print(f"it ended: {window.tail()}\n{player.tail()}", file=sys.stderr)
                return 1
            told.append(
                (rate * (time.monotonic() - begun_s) / 60.0, process.memory_info().rss / 2**20)
            )
        cpu_s = sum(process.cpu_times()[:2])
    for at_min in (0.1 * minutes, 0.25 * minutes, 0.5 * minutes, 0.75 * minutes, minutes):
        most = max(m for t, m in told if t <= at_min)
        print(f"until minute {at_min:g} of the playback: {most:.1f} MiB at most")
    second = [m for t, m in told if t > 0.5 * minutes]
    print(
        f"{second[-1] - second[0]:+.1f} MiB in the second half; {cpu_s:.0f} s of the processor, rate {rate:g}"
    )
    return 0


def _window_of(rosrun) -> psutil.Process:
    """The Python process of a console that rosrun started."""
    found = [psutil.Process(rosrun.pid), *psutil.Process(rosrun.pid).children(recursive=True)]
    return max(found, key=lambda p: p.memory_info().rss)


def clicks(number: int) -> None:
    """From a click that was held long enough to its topic in another process, on a master of its
    own."""
    import tempfile

    from bench_console_live import LISTENER

    from fcsv_console.model.console import Console
    from fcsv_console.ros.shell import Shell
    from fcsv_console.ros.window_command import application, connected
    from fcsv_sim.machines.machines import Machine

    app = application("dark")
    with tempfile.TemporaryDirectory() as folder, Machine("bench", folder) as machine:
        os.environ.update({k: v for k, v in machine.env.items() if k.startswith("ROS_")})
        listener = subprocess.Popen(
            [sys.executable, "-c", LISTENER], stdout=subprocess.PIPE, text=True, env=os.environ
        )
        try:
            shell = Shell(Console(["uav1", "uav2"]), "bench_console")
            window = connected(shell, app)
            window.show()
            ready_s = time.monotonic() + 15.0
            while time.monotonic() < ready_s:
                app.processEvents()
                publisher = shell._commands and shell._commands._all["stop_all"]
                if publisher and publisher.get_num_connections():
                    break
                time.sleep(0.01)
            took_s = []
            for _ in range(number):
                for _ in range(20):
                    app.processEvents()
                    time.sleep(0.005)
                begun_s = time.monotonic()
                window.buttons["stop_all"].asked.emit("stop_all")
                took_s.append(float(listener.stdout.readline()) - begun_s)
            shell.close()
        finally:
            listener.kill()
    took_s.sort()
    median_ms = 1e3 * statistics.median(took_s)
    print(
        f"click to topic: median {median_ms:.1f} ms, longest {1e3 * took_s[-1]:.1f} ms of {number}"
    )


if __name__ == "__main__":
    sys.exit(main())

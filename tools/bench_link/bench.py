# SPDX-License-Identifier: Apache-2.0
"""make bench-link: the figures of the link between machines, over an emulated radio, into
docs/lab/multimaster.md.

Needs root and /dev/net/tun. Each machine is a network namespace with its own ROS master and relay.
"""

import argparse
import datetime
import json
import os
import platform
import sys
import tempfile
import time
from pathlib import Path
from typing import Dict, List

import numpy as np
import psutil
from ending import clean_end
from endurance import SETTLE_S, endure, growth
from flight import whole_mission
from machines import PORT, FleetNet, Net
from radio import Conditions, can_emulate

HERE = Path(__file__).resolve().parent
LINKS, PROBE = HERE / "links.yaml", HERE / "probe.py"
DOC = HERE.parents[1] / "docs" / "lab" / "multimaster.md"
BEGIN, END = "<!-- bench-link begin -->", "<!-- bench-link end -->"
PICTURE_HZ, PICTURE_OCTETS = 30, 60000
WARM_S = 4.0


class Run:
    """A net under load; what the sinks wrote, and what the relays used."""

    def __init__(self, vehicles=("uav1",), pictures=True, conditions=None, sources=True):
        self._folder = tempfile.TemporaryDirectory(prefix="bench-link-")
        self.folder, self.vehicles = Path(self._folder.name), vehicles
        self.net = Net(self.folder, LINKS, ("control", *vehicles), conditions)
        try:
            self._start(vehicles, pictures, sources)
        except BaseException:
            self.net.stop()
            raise

    def _start(self, vehicles, pictures: bool, sources: bool) -> None:
        self.probe("control", "sink", self.folder / "states.jsonl", *vehicles)
        self.probe("control", "commander", self.folder / "acks.jsonl", vehicles[0], 10)
        for v in vehicles:
            if sources:
                self.probe(v, "source", v, 50)
            if pictures:
                self.probe(v, "pictures", v, PICTURE_HZ, PICTURE_OCTETS)

    def probe(self, machine: str, *arguments):
        command = [sys.executable, str(PROBE), *map(str, arguments)]
        return self.net.machines[machine].run(command, f"probe-{arguments[0]}")

    def wait_for_flow(self, timeout_s: float = 40.0) -> None:
        deadline = time.monotonic() + timeout_s
        while not {"state", "ack"} <= {line["topic"] for line in self.lines()}:
            if time.monotonic() > deadline:
                raise SystemExit(f"nothing flows: {self.net.relays['control'].tail(5)}")
            time.sleep(0.3)

    def lines(self, after_s: float = 0.0) -> List[Dict]:
        found = []
        for path in self.folder.glob("*.jsonl"):
            for line in path.read_text().splitlines():
                if line.endswith("}"):
                    found.append(json.loads(line))
        return [f for f in found if f["sent"] >= after_s]

    def relay(self, machine: str) -> psutil.Process:
        return psutil.Process(self.net.relays[machine].pid)

    def __enter__(self) -> "Run":
        return self

    def __exit__(self, *_exc) -> None:
        self.net.stop()
        self._folder.cleanup()


def percentiles_ms(lines: List[Dict], topic: str) -> str:
    ages = [1e3 * (f["came"] - f["sent"]) for f in lines if f["topic"] == topic]
    if not ages:
        return "none came"
    return f"{np.percentile(ages, 50):.1f} / {np.percentile(ages, 99):.1f}"


def latency(rows: List, seconds: float, loss: float, delay_s: float) -> None:
    """States, commands and pictures beside each other."""
    name = f"{100 * loss:.0f} % loss, {1e3 * delay_s:.0f} ms delay each way"
    with Run(conditions=Conditions(loss, delay_s)) as run:
        run.wait_for_flow()
        time.sleep(WARM_S)
        begin_s = time.time()
        cpu_s = {m: cpu(run.relay(m)) for m in ("control", "uav1")}
        time.sleep(seconds)
        share = {m: (cpu(run.relay(m)) - cpu_s[m]) / seconds for m in cpu_s}
        end_s = time.time()
        time.sleep(1.5)
        lines = [f for f in run.lines(begin_s) if f["sent"] < end_s]
    states = sum(f["topic"] == "state" for f in lines)
    commands, acks = (sum(f["topic"] == t for f in lines) for t in ("command", "ack"))
    pictures = sum(f["topic"] == "picture" for f in lines)
    add(rows, f"{name}: state, p50 / p99", percentiles_ms(lines, "state") + " ms")
    add(rows, f"{name}: states that came (50 a second sent)", f"{states / seconds:.1f} Hz")
    add(
        rows,
        f"{name}: command and its answer, there and back, p50 / p99",
        percentiles_ms(lines, "ack") + " ms",
    )
    add(rows, f"{name}: commands answered", f"{acks} of {commands}")
    add(
        rows,
        f"{name}: pictures of 60 kB that came (30 a second sent), age p50 / p99",
        f"{pictures / seconds:.1f} Hz, {percentiles_ms(lines, 'picture')} ms",
    )
    add(
        rows,
        f"{name}: CPU of the relay, control / vehicle",
        f"{100 * share['control']:.0f} / {100 * share['uav1']:.0f} % of a core",
    )


def comes_back(rows: List) -> None:
    """After a cut, and after the restart of either master."""
    with Run() as run:
        run.wait_for_flow()
        time.sleep(WARM_S)
        for cut_s in (5.0, 15.0):
            run.net.radio.cut()
            time.sleep(cut_s)
            run.net.radio.mend()
            mended_s = time.time()
            time.sleep(6.0)
            first = {
                t: min((f["came"] for f in run.lines(mended_s) if f["topic"] == t), default=np.inf)
                - mended_s
                for t in ("state", "ack", "picture")
            }
            stale = sum(
                f.get("came", 0) > mended_s and f["sent"] < mended_s - 1.0
                for f in run.lines()
                if f["topic"] == "state"
            )
            text = ", ".join(f"{t} {s:.2f} s" for t, s in first.items())
            add(
                rows,
                f"after a cut of {cut_s:.0f} s: first",
                f"{text}; {stale} states older than 1 s",
            )
        for name in ("uav1", "control"):
            begin_s = time.time()
            run.net.machines[name].kill_master()
            time.sleep(1.0)
            run.net.machines[name].start_master()
            up_s = time.time()
            sink = run.folder / f"late-{name}.jsonl"
            run.probe("control", "sink", sink, "uav1")
            if name == "uav1":
                run.probe("uav1", "source", "uav1", 50)
            time.sleep(6.0)
            came = sorted(f["came"] for f in run.lines(begin_s) if f["topic"] == "state")
            gap = max(np.diff([begin_s, *came]), default=np.inf)
            late = (
                [json.loads(line)["came"] for line in sink.read_text().splitlines()]
                if sink.exists()
                else []
            )
            first = f"{min(late) - up_s:.2f} s" if late else "never"
            add(
                rows,
                f"restart of the master of {name}: longest gap of states; a new subscriber after it is up",
                f"{gap:.2f} s; {first} (start of its process included)",
            )


def first_message(rows: List) -> None:
    """From a publisher's beginning to the first of its messages at a subscriber that waits on the
    other machine."""
    times = []
    for _ in range(3):
        with Run(pictures=False, sources=False) as run:
            time.sleep(3.0)
            run.probe("uav1", "source", "uav1", 50)
            run.wait_for_flow()
            first_s = min(f["came"] for f in run.lines() if f["topic"] == "state")
            log = (run.folder / "uav1" / "probe-source.log").read_text()
            times.append(
                first_s - json.loads(log[log.index("{") : log.index("}") + 1])["publishes_since"]
            )
    add(rows, "first message after a publisher starts", f"{max(times):.2f} s, worst of 3")


def two_vehicles(rows: List, seconds: float) -> None:
    with Run(vehicles=("uav1", "uav2")) as run:
        run.wait_for_flow()
        time.sleep(WARM_S)
        begin_s, before_s = time.time(), cpu(run.relay("control"))
        time.sleep(seconds)
        share = (cpu(run.relay("control")) - before_s) / (time.time() - begin_s)
        pictures = sum(f["topic"] == "picture" for f in run.lines(begin_s)) / seconds
        lines = run.lines(begin_s)
    add(
        rows,
        "two vehicles with pictures: CPU of the control PC's relay",
        f"{100 * share:.0f} % of a core at {pictures:.0f} pictures/s;"
        f" state p50 / p99 {percentiles_ms(lines, 'state')} ms",
    )


def ten_vehicles(rows: List, seconds: float) -> None:
    """The vehicles' exchanges are the real ones, ten in one process without ROS; the control PC's
    relay is the node."""
    vehicles = tuple(f"uav{i + 1}" for i in range(10))
    with tempfile.TemporaryDirectory(prefix="bench-link-") as folder:
        with FleetNet(Path(folder), LINKS, vehicles) as net:
            file = Path(folder) / "states.jsonl"
            control = net.machines["control"]
            control.run([sys.executable, str(PROBE), "sink", str(file), *vehicles], "probe-sink")
            time.sleep(3.0)
            address = f"{net.radio.addresses['control']}:{PORT}"
            net.run_in(
                "vehicles",
                [
                    sys.executable,
                    str(PROBE),
                    "fleet",
                    str(net.keys),
                    address,
                    "30",
                    str(seconds + 15),
                    *vehicles,
                ],
            )
            time.sleep(12.0)
            relay = psutil.Process(net.relays["control"].pid)
            begin_s, before_s = time.time(), cpu(relay)
            time.sleep(seconds)
            share = (cpu(relay) - before_s) / (time.time() - begin_s)
            lines = [
                json.loads(line) for line in file.read_text().splitlines() if line.endswith("}")
            ]
            lines = [f for f in lines if begin_s <= f["sent"] < begin_s + seconds - 1]
    add(
        rows,
        "ten vehicles, 30 states a second each: CPU of the control PC's relay; latency p50 / p99",
        f"{100 * share:.0f} % of a core; {percentiles_ms(lines, 'state')} ms"
        f" at {len(lines) / (seconds - 1):.0f} Hz",
    )


def endurance(rows: List, minutes: float) -> None:
    with Run(conditions=Conditions(0.02, 0.005)) as run:
        run.wait_for_flow()
        time.sleep(SETTLE_S)
        relays = {m: run.relay(m) for m in ("control", "uav1")}
        series, cuts = endure(run.net.radio, relays, minutes, lambda line: print(line, flush=True))
    for machine, footprints in series.items():
        name = f"{minutes:g} minutes at 2 % loss with {cuts} cuts of 3 s, relay of {machine}"
        add(rows, f"{name}; in brackets the slope of the second half", growth(footprints))


def cpu(process: psutil.Process) -> float:
    times = process.cpu_times()
    return times.user + times.system


def add(rows: List, what: str, figure: str) -> None:
    rows.append((what, figure))
    print(f"{what}: {figure}", flush=True)


def write(rows: List, command: str) -> None:
    """Put these rows into the table of docs/lab/multimaster.md; rows that were not measured now
    stay."""
    with open("/proc/sys/net/ipv4/tcp_congestion_control") as file:
        congestion = file.read().strip()
    head = (
        f"Measured {datetime.date.today()} with `{command}`; {os.cpu_count()} cores of {_processor()}, Linux"
        f" {platform.release().split('-')[0]}, Python {platform.python_version()}, TCP {congestion}."
        " Publishers, masters, relays, subscribers and the emulated radio all share these cores."
    )
    text = DOC.read_text()
    before, rest = text.split(BEGIN)
    known = [
        line[2:-2].split(" | ") for line in rest.split(END)[0].splitlines() if line.startswith("| ")
    ][1:]
    table = dict([*known, *rows])
    lines = [
        head,
        "",
        "| figure | measured |",
        "|---|---|",
        *(f"| {a} | {b} |" for a, b in table.items()),
    ]
    table = "\n".join(lines)
    DOC.write_text(f"{before}{BEGIN}\n{table}\n{END}{rest.split(END)[1]}")
    print(f"wrote {DOC}")


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


PARTS = ("first", "clean", "loss5", "loss30", "back", "two", "ten", "flight", "clean-flight")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", default=",".join(PARTS), help="of " + ",".join(PARTS))
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement")
    parser.add_argument("--minutes", type=float, default=0.0, help="of endurance; 0: not measured")
    parser.add_argument(
        "--write", action="store_true", help="the table into docs/lab/multimaster.md"
    )
    a = parser.parse_args()
    measure = {
        "first": lambda rows: first_message(rows),
        "clean": lambda rows: latency(rows, a.seconds, 0.0, 0.0),
        "loss5": lambda rows: latency(rows, a.seconds, 0.05, 0.01),
        "loss30": lambda rows: latency(rows, a.seconds, 0.3, 0.01),
        "back": comes_back,
        "two": lambda rows: two_vehicles(rows, a.seconds),
        "ten": lambda rows: ten_vehicles(rows, a.seconds),
        "flight": lambda rows: add(rows, *whole_mission(Conditions(0.05, 0.01), 10.0)),
        "clean-flight": lambda rows: add(rows, *whole_mission(Conditions(), 0.0)),
    }
    unknown = set(filter(None, a.parts.split(","))) - set(measure)
    if unknown:
        parser.error(f"unknown part '{sorted(unknown)[0]}'; known: {', '.join(PARTS)}")
    rows: List = []
    with clean_end():
        if not can_emulate():
            print("bench-link: needs root, /dev/net/tun and network namespaces", file=sys.stderr)
            return 2
        for part in filter(None, a.parts.split(",")):
            measure[part](rows)
        if a.minutes:
            endurance(rows, a.minutes)
    if a.write:
        write(
            rows,
            "make bench-link" + (f' ARGS="--write --minutes {a.minutes:g}"' if a.minutes else ""),
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())

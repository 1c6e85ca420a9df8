# SPDX-License-Identifier: Apache-2.0
"""make bench-link ends without a trace however it is ended, and judges growth by its slope."""

import os
import signal
import subprocess
import sys

import psutil
import pytest
from support.waiting import within

until = within(120.0)


@pytest.fixture
def begin(bench_link, root, tmp_path):
    """begin() -> a bench that has begun; its namespaces end with its process id, its files are in
    tmp_path."""
    begun = []

    def start():
        command = [sys.executable, str(root / "tools/bench_link/bench.py"), "--parts", "first"]
        env = dict(os.environ, TMPDIR=str(tmp_path))
        begun.append(
            subprocess.Popen(
                command, env=env, stderr=subprocess.PIPE, text=True, start_new_session=True
            )
        )
        return begun[-1]

    yield start
    for bench in begun:
        bench.kill()
        bench.wait()
    import ending

    ending.sweep()


def namespaces(bench):
    listed = subprocess.run(
        ["ip", "netns", "list"], capture_output=True, text=True, check=True
    ).stdout
    return [
        line.split()[0] for line in listed.splitlines() if line.split()[0].endswith(f"-{bench.pid}")
    ]


def inside(bench):
    """What runs in the namespaces of a bench."""
    import ending

    return [process for name in namespaces(bench) for process in ending.processes_in(name)]


def relays(bench):
    found = []
    for process in inside(bench):
        try:
            found += [process] if "relay" in " ".join(process.cmdline()) else []
        except psutil.NoSuchProcess:
            continue
    return found


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("number, begun", [(signal.SIGTERM, namespaces), (signal.SIGINT, relays)])
def test_a_bench_that_is_ended_leaves_nothing_behind(begin, tmp_path, number, begun):
    bench = begin()
    until(lambda: begun(bench), what="the bench's machines")
    tree = inside(bench) + psutil.Process(bench.pid).children(recursive=True)
    bench.send_signal(number)
    bench.send_signal(number)  # impatience must not stop the tidying
    assert bench.wait(120.0) == 128 + number and number.name in bench.stderr.read()
    assert not namespaces(bench) and not [
        p for p in tree if p.is_running() and p.status() != psutil.STATUS_ZOMBIE
    ]
    assert not list(tmp_path.glob("bench-link-*"))


@pytest.mark.ros
@pytest.mark.slow
def test_what_a_killed_bench_left_is_swept_away_by_the_next(begin):
    import ending

    bench = begin()
    until(lambda: relays(bench), what="the bench's relays")
    tree = inside(bench)
    bench.kill()
    bench.wait()
    left = namespaces(bench)
    assert left and set(left) <= set(ending.sweep())
    assert not namespaces(bench)
    until(lambda: not any(p.is_running() for p in tree), what="the end of what ran in them")


def test_every_signal_ends_by_the_same_way_and_only_once(bench_link, capsys):
    import ending

    for number in ending.SIGNALS:
        with pytest.raises(SystemExit) as ended:
            ending._end(number, None)
        assert (
            ended.value.code == 128 + number
            and signal.Signals(number).name in capsys.readouterr().err
        )
        assert all(signal.getsignal(n) == signal.SIG_IGN for n in ending.SIGNALS)


def test_growth_is_the_slope_of_the_second_half(bench_link):
    from endurance import Footprint, growth, per_hour

    times = [60.0 * n for n in range(61)]
    assert per_hour(times, [100.0 + 2.0 * t / 3600 for t in times]) == pytest.approx(
        (2.0, 0.0), abs=1e-6
    )
    # 20 MB in the first ten minutes, then nothing: no growth
    series = [Footprint(t, 100.0 + min(t, 600.0) / 30, 40, 43, 16) for t in times]
    assert growth(series).startswith("memory 100 → 120 MB (+0.0 ± 0.0 an hour), threads 40 → 40 (")

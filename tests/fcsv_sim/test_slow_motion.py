# SPDX-License-Identifier: Apache-2.0
"""Whole programs in slow motion: every wait lasts longer, by one clock, and nothing notices."""

import os
import subprocess
import sys
import time

import pytest
from support.waiting import within

from fcsv_sim.machines import slow_motion
from fcsv_sim.machines.slow_motion import (
    LEAST_RATE,
    Page,
    SlowMotionError,
    in_real_time,
    next_rate,
    parse_rate,
    shared_time,
)

until = within(60.0)

WAITS = """
import queue, select, socket, subprocess, sys, threading, time
a, b = socket.socketpair()
poll, epoll = select.poll(), select.epoll()
poll.register(a, select.POLLIN), epoll.register(a, select.EPOLLIN)
condition = threading.Condition()
lock = threading.Lock()
lock.acquire()
def wait_for_condition():
    with condition:
        condition.wait(0.3)
def wait_for_queue():
    try:
        queue.Queue().get(timeout=0.3)
    except queue.Empty:
        pass
def wait_for_socket():
    a.settimeout(0.3)
    try:
        a.recv(1)
    except socket.timeout:
        pass
waits = dict(
    sleep=lambda: time.sleep(0.3), condition=wait_for_condition, queue=wait_for_queue, socket=wait_for_socket,
    event=lambda: threading.Event().wait(0.3), lock=lambda: lock.acquire(timeout=0.3),
    select=lambda: select.select([a], [], [], 0.3), poll=lambda: poll.poll(300), epoll=lambda: epoll.poll(0.3),
    child=lambda: subprocess.run(["sleep", "0.3"]),
)
wait = waits[sys.argv[1]]
since = time.monotonic(), time.time()
wait()
print(time.monotonic() - since[0], time.time() - since[1])
"""
NOW = "import time; print(time.monotonic(), time.time())"


@pytest.fixture
def kept_by_hand(monkeypatch, tmp_path):
    """A page that no process writes but the test, and the environment of who reads it."""
    with slow_motion.slow_motion(1.0):
        preload = os.environ["LD_PRELOAD"]
    page = Page(tmp_path / "page", create=True)
    return page, dict(os.environ, LD_PRELOAD=preload, FCSV_SLOW_MOTION=str(tmp_path / "page"))


def run(*command, **options):
    return [
        float(x)
        for x in subprocess.check_output(
            [sys.executable, "-c", *command], text=True, **options
        ).split()
    ]


@pytest.mark.parametrize(
    "wait",
    ["sleep", "condition", "queue", "socket", "event", "lock", "select", "poll", "epoll", "child"],
)
def test_a_wait_is_as_long_as_it_says_by_its_own_clocks_and_longer_by_ours(wait):
    with slow_motion.slow_motion(0.5):
        began_s = time.monotonic()
        monotonic_s, wall_s = run(WAITS, wait)
        took_s = time.monotonic() - began_s
    assert monotonic_s >= 0.295 and wall_s >= 0.295  # poll counts whole milliseconds
    assert took_s >= 0.59


def test_programs_share_one_time_that_lags_on_every_clock():
    with slow_motion.slow_motion(0.5) as page:
        time.sleep(1.0)
        first = run(NOW)
        before_s, lag_s = page.now_s(), time.monotonic() - page.now_s()
        second = run(NOW)
        after_s, wall_s = page.now_s(), time.time()
    assert first[0] < second[0] and first[1] < second[1]
    assert lag_s >= 0.45 and before_s <= second[0] <= after_s
    assert wall_s - second[1] >= lag_s


def test_time_of_the_processor_is_not_slowed():
    burn = "import time; a = time.thread_time(), time.monotonic()\nwhile time.thread_time() - a[0] < 0.4: pass\n"
    with slow_motion.slow_motion(0.5):
        assert (
            run(burn + "print(time.thread_time() - a[0], time.thread_time_ns() * 1e-9)")[0] >= 0.4
        )


def test_a_sleep_goes_by_the_rate_as_it_changes(kept_by_hand):
    ready = (
        "import time; print('ready', flush=True); t = time.monotonic(); time.sleep(1.0); "
        "print(time.monotonic() - t)"
    )
    page, env = kept_by_hand
    page.write(time.monotonic(), 1.0)
    sleeper = subprocess.Popen(
        [sys.executable, "-c", ready], stdout=subprocess.PIPE, text=True, env=env
    )
    assert sleeper.stdout.readline() == "ready\n"
    began_s = time.monotonic()
    page.write(began_s, 0.5)
    slept_s = float(sleeper.stdout.readline())
    assert sleeper.wait() == 0 and slept_s >= 1.0
    # the first look at the clock may have been before the change
    assert time.monotonic() - began_s >= 1.6


@pytest.mark.parametrize(
    "wait", ["sleep", "condition", "socket", "select", "poll", "epoll", "lock"]
)
def test_nothing_is_over_before_time_goes_on_after_a_halt(kept_by_hand, wait):
    page, env = kept_by_hand
    page.write(time.monotonic(), 1.0, ahead_s=0.1)
    waiter = subprocess.Popen(
        [sys.executable, "-c", WAITS, wait], stdout=subprocess.PIPE, text=True, env=env
    )
    time.sleep(1.5)
    assert waiter.poll() is None and page.slow_s(time.monotonic() + 100.0) == page.now_s()
    page.write(time.monotonic(), 1.0)
    took_s = float(waiter.communicate(timeout=60.0)[0].split()[0])
    assert waiter.returncode == 0 and 0.295 <= took_s


def test_a_program_begins_again_once_and_knows_how_fast_its_time_passed(tmp_path):
    script = tmp_path / "again.py"
    script.write_text("""
import os, time
from fcsv_sim.machines import slow_motion
print(os.getpid())
slow_motion.begin_again_in(0.5)
began = slow_motion.both_clocks()
time.sleep(0.5)
print(slow_motion.share_of_real_time(began), os.environ["FCSV_SLOW_MOTION"])
""")
    said = subprocess.check_output([sys.executable, "-u", str(script)], text=True).split()
    assert said[0] == said[1] and len(said) == 4  # the same process, from its beginning
    assert 0.1 <= float(said[2]) <= 0.55  # a busy machine's ticks come late
    until(lambda: not os.path.exists(said[3]), what="its keeper removes it")
    # here: real time
    assert slow_motion.share_of_real_time((0.0, 0.0)) == pytest.approx(1.0, abs=1e-3)


def test_the_environment_is_given_back_and_the_page_removed():
    before = dict(os.environ)
    with slow_motion.slow_motion(0.5):
        path = os.environ["FCSV_SLOW_MOTION"]
        assert set(shared_time(dict(os.environ))) == {"LD_PRELOAD", "FCSV_SLOW_MOTION"}
        assert in_real_time(dict(os.environ)) == before and os.path.exists(path)
    assert dict(os.environ) == before and not os.path.exists(path)


def test_a_page_goes_on_without_a_jump(tmp_path):
    page, reader = Page(tmp_path / "page", create=True), Page(tmp_path / "page")
    page.write(100.0, 0.5)
    page.write(110.0, 0.25, ahead_s=2.0)
    assert reader.rate == 0.25
    assert [reader.slow_s(t) for t in (110.0, 114.0, 118.0, 130.0)] == pytest.approx(
        [105.0, 106.0, 107.0, 107.0]
    )
    page.write(130.0, 1.0)  # the halt is over
    assert [reader.slow_s(t) for t in (130.0, 131.0)] == pytest.approx([107.0, 108.0])


def test_time_goes_on_where_the_page_is_deserted(kept_by_hand):
    """A process that was killed keeps no clock: who waits for something with a time limit must not
    wait for ever."""
    page, env = kept_by_hand
    page.write(time.monotonic() - 20.0, 1.0, ahead_s=0.1)
    assert run(WAITS, "sleep", env=env)[0] >= 0.295


@pytest.mark.parametrize("word", ["0", "1.5", "-1", "nan", "fast", ""])
def test_a_speed_that_cannot_be_is_refused_by_name(word):
    with pytest.raises(SlowMotionError, match="auto or a share"):
        parse_rate(word)


def test_the_rate_follows_the_load_and_stays_in_its_bounds():
    assert next_rate(1.0, 0.3) == 1.0 and next_rate(LEAST_RATE, 1.0) == LEAST_RATE
    assert LEAST_RATE < next_rate(0.8, 1.0) < 0.8 < next_rate(0.8, 0.5) < 1.0
    rate = 1.0
    for _ in range(200):
        rate = next_rate(rate, min(1.0, 1.6 * rate))  # work for 1.6 machines in real time
    assert 1.6 * rate == pytest.approx(0.85, abs=0.01)


def test_a_workspace_without_the_library_is_named(monkeypatch):
    monkeypatch.setenv("CMAKE_PREFIX_PATH", "/nowhere")
    with pytest.raises(SlowMotionError, match="make setup"), slow_motion.slow_motion(0.5):
        pass

# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C counts whenever it comes, also in the middle of a fork."""

import subprocess
import sys
import time

DEMO = """
from fcsv_sim.demo.interrupt import Interrupted as Ended, listen, uninterrupted
listen()
"""
PROGRAM = """
import os, signal, subprocess, time
{begin}
def ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.02)
os.register_at_fork(after_in_parent=ctrl_c)
try:
    subprocess.run(["true"], preexec_fn=lambda: None)
    time.sleep(10.0)
    print("lost")
except Ended:
    print("ended")
    {then}
"""


def printed(begin, then="pass"):
    program = PROGRAM.format(begin=begin, then=then)
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60.0
    ).stdout.split()


def test_ctrl_c_while_the_demo_starts_a_process_is_not_lost():
    assert printed(DEMO) == ["ended"]


def test_a_second_one_does_not_stop_what_must_come_to_its_end():
    action = "uninterrupted(lambda: (ctrl_c(), subprocess.run(['true'], preexec_fn=lambda: None), print('tidied')))"
    assert printed(DEMO, action) == ["ended", "tidied"]


def test_other_errors_in_such_places_are_told_as_before():
    begin = "from fcsv_geometry.programs.interruption import raise_again\nraise_again(KeyError)"
    program = f"{begin}\nclass A:\n    def __del__(self): raise ValueError('told')\na = A()\ndel a\nprint('on')"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60.0
    )
    assert "ValueError: told" in done.stderr and done.stdout == "on\n"


def test_a_bench_that_is_ended_while_it_starts_a_process_ends(root):
    begin = f"import sys\nsys.path.insert(0, {str(root / 'tools/bench_link')!r})\nimport ending\nEnded = SystemExit\n"
    within = "ending.sweep = list\nblock = ending.clean_end()\nblock.__enter__()"
    assert printed(begin + within) == ["ended"]


def test_a_command_that_is_interrupted_where_python_drops_errors_ends_with_one_line():
    program = """
import argparse, os, signal, sys, time
from fcsv_geometry.programs import commands
signal.signal(signal.SIGINT, signal.default_int_handler)  # who started the tests may have it ignored
class Falls:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.02)
def action(args):
    Falls()
    time.sleep(10.0)
    print("lost")
sys.exit(commands.run(argparse.ArgumentParser(prog="map"), [], action))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60.0
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "map: interrupted\n")


LONG = """
import os, signal, sys, threading, time
from fcsv_geometry.programs.interruption import ended_soon
signal.signal(signal.SIGINT, signal.default_int_handler)
def pressed(times):
    for _ in range(times):
        time.sleep(0.3)
        os.kill(os.getpid(), signal.SIGINT)
def busy():  # a library that lets no interrupt through
    ends = time.monotonic() + 20.0
    while time.monotonic() < ends:
        try:
            time.sleep(0.05)
        except KeyboardInterrupt:
            pass
def put(word):
    os.write(1, (word + "\\n").encode())
say, give_up = (lambda: put("said")), (lambda: put("gave up"))
"""


def ended_after(program):
    """What was printed, the exit status, and whole seconds."""
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", LONG + program], capture_output=True, text=True, timeout=60.0
    )
    assert not done.stderr, done.stderr
    return done.stdout.split("\n")[:-1], done.returncode, time.monotonic() - began


def test_ctrl_c_is_answered_at_once_and_ends_what_does_not_return():
    program = "threading.Thread(target=pressed, args=(1,)).start()\nwith ended_soon(1.0, say, give_up): busy()"
    said, status, took_s = ended_after(program)
    assert said == ["said", "gave up"] and status == 130 and took_s < 10.0


def test_a_second_ctrl_c_ends_it_now():
    program = "threading.Thread(target=pressed, args=(2,)).start()\nwith ended_soon(15.0, say, give_up): busy()"
    said, status, took_s = ended_after(program)
    assert said == ["said", "gave up"] and status == 130 and took_s < 10.0


def test_what_ends_by_itself_after_ctrl_c_is_left_alone():
    program = """
threading.Thread(target=pressed, args=(1,)).start()
try:
    with ended_soon(5.0, say, give_up): time.sleep(20.0)
except KeyboardInterrupt:
    put("ended")
"""
    said, status, _ = ended_after(program)
    assert sorted(said) == ["ended", "said"] and status == 0


def test_after_the_block_ctrl_c_is_as_before():
    program = """
with ended_soon(0.2, say, give_up): pass
try:
    with ended_soon(0.2, say, give_up): raise KeyboardInterrupt  # of code
except KeyboardInterrupt: pass
try:
    pressed(1)
    time.sleep(20.0)
except KeyboardInterrupt:
    time.sleep(0.5)
    put("ended")
"""
    assert ended_after(program)[:2] == (["ended"], 0)

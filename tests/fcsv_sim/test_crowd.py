# SPDX-License-Identifier: Apache-2.0
"""A flight that other programs leave too little of the processors ends early, and names them."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fcsv_sim.machines.crowd import Crowd, CrowdRules, CrowdWatch, Load, MachineTooBusy

QUICK = CrowdRules(most_others=0.65, lasting_s=0.5, every_s=0.5)
_LOOP = "while True: pass"


def judged(loads):
    crowd = Crowd()
    return [crowd.too_busy(Load(s, others)) for s, others in loads]


def test_what_passes_soon_is_no_crowd():
    """A compiler beside it for 6 s, and again."""
    loads = [(s, 0.9 if s % 10 < 6 else 0.3) for s in range(0, 60, 2)]
    assert not any(judged(loads))


def test_others_at_half_of_the_processors_leave_enough():
    assert not any(judged([(s, 0.6) for s in range(0, 600, 2)]))


@pytest.mark.parametrize("others", [0.66, 0.9, 1.0])
def test_a_lasting_crowd_is_said_in_eight_seconds(others):
    words = judged([(s, others) for s in range(0, 12, 2)])
    assert [bool(w) for w in words] == [False] * 4 + [True] * 2
    assert f"{100 * others:.0f} % of the processors" in words[-1] and "end them" in words[-1]


def test_a_share_that_is_not_known_is_no_crowd():
    assert not any(judged([(s, float("nan")) for s in range(0, 60, 2)]))


@pytest.fixture
def loops():
    """Two busy loops a core, which belong to no flight."""
    running = [subprocess.Popen([sys.executable, "-c", _LOOP]) for _ in range(2 * os.cpu_count())]
    yield running
    for process in running:
        process.kill()
        process.wait()


@pytest.fixture
def flight():
    """A process that waits, in place of a demo."""
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    yield process
    process.kill()
    process.wait()


@pytest.mark.alone
@pytest.mark.skipif(os.nice(0) == 19, reason="loops started at the lowest priority are no crowd")
def test_busy_loops_of_others_are_seen_and_named(loops, flight):
    watch = CrowdWatch(flight.pid, QUICK)
    said = []
    with pytest.raises(MachineTooBusy, match=r"too busy to fly: other programs .*python"):
        watch.look_before(said.append, time.sleep)
    assert len(said) == 1 and "waiting for them" in said[0]


def test_programs_of_the_lowest_priority_give_way_where_their_session_does_too(root, flight):
    """A session of normal priority has its share of the processors, whatever nice(1) says."""
    both, alone = [root / "src/fcsv_bringup/scripts/priority", "19"], ["nice", "-n", "19"]
    others = [
        subprocess.Popen([*words, "sleep", "600"], start_new_session=True)
        for words in (both, alone)
    ]
    try:
        time.sleep(0.5)  # until they have it
        used = CrowdWatch(flight.pid, QUICK)._sample()[3]
        assert [used[p.pid][2] for p in others] == [True, not Path("/proc/self/autogroup").exists()]
    finally:
        for process in others:
            process.kill()
            process.wait()


@pytest.mark.alone
def test_loops_of_its_own_are_no_crowd(loops):
    """All processes here are children of this one."""
    watch = CrowdWatch(os.getpid(), CrowdRules(most_others=0.9, lasting_s=0.5, every_s=0.5))
    time.sleep(1.5)
    watch.look()
    assert not watch.crowded

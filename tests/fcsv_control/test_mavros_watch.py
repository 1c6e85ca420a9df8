# SPDX-License-Identifier: Apache-2.0
"""A MAVROS that hangs is told from one that has nothing to say, and from one that is dead; only the
first is ended."""

import os
import signal
import subprocess
import sys

import pytest

from fcsv_control.flight.mavros_watch import MavrosWatch, MavrosWatchRules
from fcsv_control.ros.flight_link.mavros_process import MavrosProcess, is_here, mind

PASS_S = 0.5
NAME = "/uav1/mavros"
NODE = """
import os, sys, xmlrpc.server
server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
server.register_function(lambda caller: [1, "", os.getpid()], "getPid")
print(server.server_address[1], flush=True)
server.serve_forever()
"""


class Board:
    """A watch and the time. ``says``: messages of the autopilot come through; ``pid``: what it
    answers."""

    def __init__(self, **rules):
        self.now_s, self.says, self.pid, self.killed = 100.0, True, 41, []
        self.watch = MavrosWatch(MavrosWatchRules(**rules), self.now_s)

    def run(self, seconds):
        for _ in range(int(round(seconds / PASS_S))):
            self.now_s += PASS_S
            if self.says:
                self.watch.on_message(self.now_s)
            if self.watch.asks(self.now_s):
                self.watch.answered(self.pid)
            pid = self.watch.step(self.now_s)
            self.killed += [] if pid is None else [(self.now_s, pid)]
        return self


def test_one_that_hangs_is_ended_before_the_autopilots_failsafe():
    """ArduCopter flies on for 8 s without poses, and MAVROS needs some seconds to be there
    again."""
    board = Board().run(5.0)
    board.says, board.pid, begun_s = False, None, board.now_s
    board.run(10.0)
    ((at_s, pid),) = board.killed
    assert pid == 41 and 1.5 < at_s - begun_s <= 4.0 and board.watch.ended == 1


def test_the_next_one_is_left_alone_while_it_starts_and_ended_where_it_hangs_too():
    board = Board().run(5.0)
    board.says, board.pid = False, None
    board.run(60.0)
    assert [pid for _, pid in board.killed] == [41], "nothing answers yet: it starts"
    board.pid = 42
    board.run(30.0)
    assert len(board.killed) == 1, "it answers: its autopilot is not there"
    board.pid = None
    board.run(5.0)
    assert [pid for _, pid in board.killed] == [41, 42]


@pytest.mark.parametrize("says, pid", [(True, None), (False, 41)])
def test_one_that_speaks_or_answers_is_left_alone(says, pid):
    """It answers late on a busy machine, or its line is cut."""
    board = Board().run(5.0)
    board.says, board.pid = says, pid
    assert not board.run(120.0).killed


def test_one_answer_that_is_late_is_no_proof():
    board = Board().run(5.0)
    board.says = False
    for _ in range(50):
        board.pid = None
        board.run(2 * PASS_S)
        board.pid = 41
        board.run(PASS_S)
    assert not board.killed


def test_a_companion_that_got_no_processor_time_blames_nobody():
    board = Board().run(5.0)
    board.says, board.pid = False, None
    for _ in range(20):
        board.now_s += 5.0
        board.run(PASS_S)
    assert not board.killed


def test_one_that_died_is_not_said_to_hang():
    board = Board().run(5.0)
    board.says, board.pid = False, None
    board.watch.gone()
    assert not board.run(20.0).killed and board.watch.ended == 0


@pytest.mark.parametrize(
    "rules", [{"silent_s": 0.1}, {"silent_s": float("nan")}, {"unanswered": 1}]
)
def test_rules_out_of_range(rules):
    with pytest.raises(ValueError, match=next(iter(rules))):
        MavrosWatchRules(**rules)


@pytest.fixture
def node():
    """(process, address) of a node that answers getPid as ROS's nodes do."""
    command, env = (
        [sys.executable, "-c", NODE, "__name:=mavros"],
        {**os.environ, "ROS_NAMESPACE": "/uav1/"},
    )
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=env) as process:
        yield process, f"http://127.0.0.1:{int(process.stdout.readline())}/"
        process.kill()


def pid_of(mavros):
    """Its answer; on a busy machine one question is not enough."""
    return next(pid for pid in (mavros.pid() for _ in range(60)) if pid is not None)


def test_a_stopped_process_does_not_answer_and_is_ended(node):
    process, uri = node
    mavros = MavrosProcess(NAME, lambda: uri)
    assert pid_of(mavros) == process.pid and mavros.lives(process.pid)
    os.kill(process.pid, signal.SIGSTOP)
    assert mavros.pid() is None and mavros.lives(process.pid)
    assert mavros.end(process.pid) == ""
    assert process.wait(20.0) == -signal.SIGKILL
    assert not mavros.lives(process.pid) and mavros.pid() is None
    assert mavros.end(process.pid) == "", "it is gone already"


class Minded:
    """A process under watch, by a clock of its own: half a second a turn."""

    def __init__(self, uri, pid):
        self.now_s, self.said = 100.0, []
        self.watch, self.process = (
            MavrosWatch(MavrosWatchRules(), self.now_s),
            MavrosProcess(NAME, lambda: uri),
        )
        for _ in range(60):  # on a busy machine one question is not enough
            if self.watch.pid != pid:
                self.turn(self.now_s)
        assert self.watch.pid == pid

    def turn(self, heard_s):
        self.now_s += PASS_S
        words = mind(self.watch, self.process, lambda: heard_s, lambda: self.now_s)
        self.said += [words] if words else []


def test_a_mavros_that_stops_in_flight_is_ended_and_said(node):
    process, uri = node
    minded = Minded(uri, process.pid)
    heard_s = minded.now_s
    os.kill(process.pid, signal.SIGSTOP)
    while minded.now_s < heard_s + 4.0:
        minded.turn(heard_s)
    assert minded.said == ["MAVROS hung and was ended, it starts again"]
    assert process.wait(20.0) == -signal.SIGKILL


def test_a_mavros_that_dies_is_left_to_roslaunch(node):
    process, uri = node
    minded = Minded(uri, process.pid)
    heard_s = minded.now_s
    process.kill()
    process.wait()
    for _ in range(20):
        minded.turn(heard_s)
    assert not minded.said and minded.watch.ended == 0


@pytest.mark.parametrize("name", ["/uav1/other", "/uav2/mavros", "/mavros"])
def test_a_process_of_another_name_is_not_ended(node, name):
    process, uri = node
    other = MavrosProcess(name, lambda: uri)
    assert not other.lives(process.pid) and other.end(process.pid) == ""
    assert pid_of(MavrosProcess(NAME, lambda: uri)) == process.pid, "it lives"


def unknown():
    raise OSError("unknown node")


def test_what_is_no_node_gives_no_process_id():
    assert MavrosProcess(NAME, unknown).pid() is None
    assert is_here("http://127.0.0.1:1234/") and not is_here("http://192.0.2.1:1234/")
    assert MavrosProcess(NAME, lambda: "http://192.0.2.1:1234/").pid() is None, (
        "a process id of another machine"
    )

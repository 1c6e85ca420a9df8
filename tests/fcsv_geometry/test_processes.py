# SPDX-License-Identifier: Apache-2.0
"""A node's process is found by how roslaunch started it; masters and nodes that hang or talk
nonsense end a call in time."""

import os
import socket
import subprocess
import sys
import threading
import xmlrpc.server

import psutil
import pytest

from fcsv_geometry.ros.processes import address_of, ask_pid, ask_to_end, is_node, processes_of

NODE, NAME, SOON_S = "/uav1/camera", "/tests", 0.3


@pytest.fixture
def silent():
    """Address of one that takes a call and never answers: a process that is stopped."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        s.listen()
        yield f"http://127.0.0.1:{s.getsockname()[1]}/"


@pytest.fixture
def answers():
    """Address of a master and node in one; ``answers.said`` gives its answer by method."""
    with xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.said, server.calls = {}, []
        server.uri = f"http://127.0.0.1:{server.server_address[1]}/"

        def answer(method, fields):
            server.calls.append((method, *fields))
            return server.said[method]

        server._dispatch = answer
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def test_a_master_that_hangs_ends_a_look_up_in_time(silent, monkeypatch):
    """Before, the watch of a driver or of MAVROS waited for it for ever."""
    monkeypatch.setenv("ROS_MASTER_URI", silent)
    with pytest.raises(OSError):
        address_of(NAME, NODE, SOON_S)
    with pytest.raises(OSError):
        ask_to_end(NAME, NODE, "it is silent", SOON_S)


def test_a_node_is_looked_up_and_asked_to_end(answers, monkeypatch):
    monkeypatch.setenv("ROS_MASTER_URI", answers.uri)
    answers.said = {
        "lookupNode": [1, "", answers.uri],
        "shutdown": [1, "", 0],
        "getPid": [1, "", 41],
    }
    assert address_of(NAME, NODE, 20.0) == answers.uri and ask_pid(NAME, answers.uri, 20.0) == 41
    ask_to_end(NAME, NODE, "it is silent", 20.0)
    assert answers.calls[-1] == ("shutdown", NAME, "it is silent")


def test_a_node_that_the_master_does_not_know_is_named(answers, monkeypatch):
    monkeypatch.setenv("ROS_MASTER_URI", answers.uri)
    answers.said = {"lookupNode": [-1, "unknown node [/uav1/camera]", ""]}
    with pytest.raises(OSError, match="unknown node"):
        ask_to_end(NAME, NODE, "it is silent", 20.0)


@pytest.mark.parametrize("answer", [[0, "", 41], [1, "", 1], [1, "", "41"], [1], "none", {}])
def test_an_answer_that_is_not_sound_is_no_process_id(answers, answer):
    answers.said = {"getPid": answer}
    assert ask_pid(NAME, answers.uri, 20.0) is None


def test_who_hangs_or_is_not_there_tells_no_process_id(silent):
    assert ask_pid(NAME, silent, SOON_S) is None
    assert (
        ask_pid(NAME, "http://127.0.0.1:9/", SOON_S) is None
        and ask_pid(NAME, "nonsense", SOON_S) is None
    )


@pytest.fixture
def started():
    """A process as roslaunch starts the node /uav1/camera."""
    command = [
        sys.executable,
        "-c",
        "import time; print('', flush=True); time.sleep(600)",
        "__name:=camera",
    ]
    env = {**os.environ, "ROS_NAMESPACE": "/uav1/", "ROS_MASTER_URI": "http://127.0.0.1:1/"}
    with subprocess.Popen(command, env=env, stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        yield process
        process.kill()


def test_a_process_is_found_by_name_namespace_and_master(started, monkeypatch):
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1/")
    assert [p.pid for p in processes_of(NODE)] == [started.pid]
    process = psutil.Process(started.pid)
    assert is_node(process, NODE)
    assert not any(
        is_node(process, other)
        for other in ("/uav1/came", "/uav2/camera", "/camera", "/uav1/front/camera")
    )
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:2/")
    assert not is_node(process, NODE), "another master's"


def test_one_that_ended_is_no_node(started):
    process = psutil.Process(started.pid)
    started.kill()
    started.wait()
    assert not is_node(process, NODE)

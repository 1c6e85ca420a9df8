# SPDX-License-Identifier: Apache-2.0
"""Machines of a fleet on one computer: each its own ROS master on a free loopback port, and its
processes.

Whatever a machine starts runs in a process group of its own and is stopped by it, also when the
process that holds the machine dies (the kernel then interrupts the children).
"""

import ctypes
import os
import random
import signal
import socket
import subprocess
import time
import xmlrpc.client
from contextlib import suppress
from pathlib import Path
from typing import Collection, Dict, List, Optional, Sequence, Set

import psutil

from fcsv_geometry.errors import FcsvError

_PR_SET_PDEATHSIG = 1
_PORTS = 15000, 32000  # below Linux's ip_local_port_range
_given: Set[int] = set()
# loaded once: nothing may be imported between fork and exec
_LIBC = ctypes.CDLL(None, use_errno=True)


class MachineError(FcsvError):
    """A master or a launch did not come up; the message names the log that says why."""


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    """A port on loopback that nobody listened on a moment ago, and that no connection is given for
    its own end.

    Never the same twice in one process: what is given is often listened on only once the next is
    asked for. Raises MachineError where a hundred are taken.
    """
    for _ in range(100):
        port = random.SystemRandom().randrange(*_PORTS)  # tests seed the usual one
        if port in _given:
            continue
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            _given.add(port)
            return port
    raise MachineError(
        f"no free port on 127.0.0.1 among those tried from {_PORTS[0]} to {_PORTS[1]}"
    )


class Process:
    """A command in its own process group, with its output in a log file."""

    def __init__(self, command: Sequence[str], log: Path, env: Optional[Dict[str, str]] = None):
        self.command = list(command)
        self.log = Path(log)
        self.log.parent.mkdir(parents=True, exist_ok=True)
        with open(self.log, "ab") as output:
            self._popen = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=env,
                start_new_session=True,
                preexec_fn=_begin,
            )

    @property
    def pid(self) -> int:
        return self._popen.pid

    @property
    def returncode(self) -> Optional[int]:
        """Exit status, None while it runs."""
        return self._popen.poll()

    def wait(self, timeout_s: float) -> Optional[int]:
        """Exit status, None when it still runs after ``timeout_s``."""
        try:
            return self._popen.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None

    def signal(self, number: int) -> None:
        """A signal to the leader alone, as a terminal would give it to roslaunch."""
        if self.returncode is None:
            self._popen.send_signal(number)

    def stop(self, grace_s: float = 12.0) -> None:
        """Interrupt, wait, then kill whatever is left of the tree. Safe to call again."""
        tree = self._tree()
        for number, patience_s in ((signal.SIGINT, grace_s), (signal.SIGTERM, 3.0)):
            self.signal(number)
            if self.wait(patience_s) is not None:
                break
        _kill(tree)
        self._popen.wait()

    def kill(self) -> None:
        """The whole tree dies at once, as in a crash."""
        _kill(self._tree())
        self._popen.wait()

    def _tree(self) -> List[psutil.Process]:
        """This process and its descendants: roslaunch gives each of its own a group."""
        if self.returncode is not None:
            return []
        try:
            leader = psutil.Process(self.pid)
            return [leader, *leader.children(recursive=True)]
        except psutil.NoSuchProcess:
            return []

    def tail(self, lines: int = 12) -> str:
        """The end of its log."""
        return "\n".join(self.log.read_text(errors="replace").splitlines()[-lines:])


def _begin() -> None:
    """Runs in the child before its program: SIGINT ends it, also where a shell started this process
    in the background with SIGINT ignored; it is sent when this process dies."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGINT)


def _kill(tree: Sequence[psutil.Process]) -> None:
    """SIGKILL to those of a tree that still are who they were."""
    for process in tree:
        with suppress(psutil.Error):
            process.kill()


def node_process(folder, node: str) -> psutil.Process:
    """The process of a node that roslaunch started on a machine whose files are in ``folder``, or
    in a folder below it.

    Raises MachineError where there is none.
    """
    for process in psutil.process_iter(["cmdline"]):
        words = process.info["cmdline"] or []
        if f"__name:={node}" in words and any(str(folder) in w for w in words):
            return process
    raise MachineError(f"{folder}: no {node} runs there")


class Machine:
    """One machine: a roscore on ``port`` (free by default), its own ROS home, and what is launched
    on it."""

    def __init__(self, name: str, folder, port: Optional[int] = None):
        self.name = name
        self.folder = Path(folder) / name
        self.folder.mkdir(parents=True, exist_ok=True)
        self.port = port or free_port()
        self._core: Optional[Process] = None
        self._processes: List[Process] = []

    @property
    def master_uri(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def env(self) -> Dict[str, str]:
        """The environment in which this machine's processes run."""
        env = dict(
            os.environ, ROS_MASTER_URI=self.master_uri, ROS_IP="127.0.0.1", PYTHONUNBUFFERED="1"
        )
        env.update(ROS_HOME=str(self.folder / "ros"), ROS_LOG_DIR=str(self.folder / "log"))
        env.pop("ROS_HOSTNAME", None)
        return env

    @property
    def core(self) -> Optional[Process]:
        """The roscore, where one was started."""
        return self._core

    def begin_master(self) -> None:
        """Start the roscore, where none runs, without a wait for it."""
        if self._core is None or self._core.returncode is not None:
            command = self._inside(["roscore", "-p", str(self.port)])
            self._core = Process(command, self.folder / "roscore.log", self.env)

    def start_master(self, timeout_s: float = 30.0) -> "Machine":
        """Start the roscore and wait until it answers. Raises MachineError."""
        self.begin_master()
        deadline = time.monotonic() + timeout_s
        while not self.master_alive():
            if self._core.returncode is not None or time.monotonic() > deadline:
                tail = self._core.tail(3)
                self._core.stop()
                raise MachineError(
                    f"{self.name}: no ROS master on port {self.port}; {self._core.log}: {tail}"
                )
            time.sleep(0.05)
        return self

    def master_alive(self) -> bool:
        """Whether the master and its rosout answer."""
        try:
            return xmlrpc.client.ServerProxy(self.master_uri).lookupNode("/fcsv", "/rosout")[0] == 1
        except OSError:
            return False

    def kill_master(self) -> None:
        """The roscore dies at once, as a crash would have it; the nodes go on."""
        if self._core is not None:
            self._core.kill()

    def run(self, command: Sequence[str], log: str) -> Process:
        """A process of this machine; its output in ``log``.log in the machine's folder."""
        process = Process(self._inside(command), self.folder / f"{log}.log", self.env)
        self._processes.append(process)
        return process

    def launch(self, package: str, launch_file: str, **args) -> Process:
        """roslaunch a file with arguments; booleans as true and false."""
        spelled = [f"{k}:={str(v).lower() if isinstance(v, bool) else v}" for k, v in args.items()]
        command = ["roslaunch", "--wait", package, launch_file, *spelled]
        return self.run(command, f"roslaunch-{Path(launch_file).stem}")

    def stop(self) -> None:
        """Stop everything, the launches first, together; the master last."""
        stop_together([self])

    def interrupt(self) -> None:
        """Ask all but the master to end."""
        for process in self._processes:
            process.signal(signal.SIGINT)

    def stop_processes(self) -> None:
        """End all but the master."""
        for process in reversed(self._processes):
            process.stop()
        self._processes.clear()

    def interrupt_master(self) -> None:
        """Ask the roscore to end."""
        if self._core is not None:
            self._core.signal(signal.SIGINT)

    def stop_master(self) -> None:
        """End the roscore."""
        if self._core is not None:
            self._core.stop(grace_s=5.0)
            self._core = None

    def _inside(self, command: Sequence[str]) -> Sequence[str]:
        """The command as it is run on this machine."""
        return command

    def __enter__(self) -> "Machine":
        return self.start_master()

    def __exit__(self, *_exc) -> None:
        self.stop()


def start_together(machines: Collection[Machine]) -> None:
    """The masters of machines, whose starts wait more than they work. Raises MachineError."""
    for machine in machines:
        machine.begin_master()
    for machine in machines:
        machine.start_master()


def stop_together(machines: Collection[Machine]) -> None:
    """Machines, each step on all of them: what runs there, then their masters."""
    for step in (
        Machine.interrupt,
        Machine.stop_processes,
        Machine.interrupt_master,
        Machine.stop_master,
    ):
        for machine in machines:
            step(machine)

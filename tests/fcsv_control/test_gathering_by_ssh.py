# SPDX-License-Identifier: Apache-2.0
"""A flight's bags gathered from a machine behind OpenSSH's own server, on loopback."""

import getpass
import os
import shlex
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from support.bags import write_strings
from support.waiting import within

from fcsv_control.commands.gather_session import main
from fcsv_control.gathering import RSH
from fcsv_sim.machines.machines import free_port

SSHD = shutil.which("sshd", path=f"{os.environ['PATH']}:/usr/sbin")
SILENT = "-o ServerAliveInterval=1 -o ServerAliveCountMax=2"
#: What the server runs: what it was asked for; where there is a file "silent", it stops itself
#: after 2 MB.
FORCED = """
import os, signal, subprocess
from pathlib import Path
asked = ["sh", "-c", os.environ["SSH_ORIGINAL_COMMAND"]]
if not Path({folder!r}, "silent").exists():
    os.execvp("sh", asked)
left, process = 2_000_000, subprocess.Popen(asked, stdout=subprocess.PIPE)
while True:
    data = os.read(process.stdout.fileno(), 65536)
    if not data:
        break
    left -= len(data)
    if left < 0:
        os.kill(os.getppid(), signal.SIGSTOP)
    os.write(1, data)
"""
until = within(20.0)

pytestmark = pytest.mark.skipif(
    None in (SSHD, shutil.which("ssh"), shutil.which("rsync")),
    reason="needs openssh-server, openssh-client and rsync",
)


@pytest.fixture
def server(tmp_path):
    """OpenSSH's server on a free port, that lets this user in by a key of the test."""
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # it refuses to start without
    for name in ("host", "key"):
        command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(tmp_path / name)]
        subprocess.run(command, check=True)
    port = free_port(socket.SOCK_STREAM)
    (tmp_path / "forced").write_text(FORCED.format(folder=str(tmp_path)))
    lines = {
        "Port": port,
        "ListenAddress": "127.0.0.1",
        "HostKey": tmp_path / "host",
        "PidFile": "none",
        "UsePAM": "no",
        "AuthorizedKeysFile": tmp_path / "key.pub",
        "StrictModes": "no",
        "PasswordAuthentication": "no",
        "PermitRootLogin": "yes",
        "ForceCommand": f"exec {sys.executable} {shlex.quote(str(tmp_path / 'forced'))}",
    }
    (tmp_path / "sshd_config").write_text(
        "".join(f"{key} {value}\n" for key, value in lines.items())
    )
    with (tmp_path / "sshd.txt").open("w") as log:
        process = subprocess.Popen(
            [SSHD, "-D", "-e", "-f", str(tmp_path / "sshd_config")], stderr=log
        )
    try:
        until(lambda: listens(port), what="the server")
        yield Server(tmp_path, port)
    finally:
        everybody = [process, *psutil.Process(process.pid).children(recursive=True)]
        for each in everybody:
            each.kill()
        process.wait()


class Server:
    """An ssh that gets in (or not, with another key), and a place behind it."""

    def __init__(self, folder, port):
        self._folder, self._port = folder, port
        host = (folder / "host.pub").read_text()
        (folder / "known").write_text(f"[127.0.0.1]:{port} {host}")

    def ssh(self, key="key", more=""):
        known = shlex.quote(f"UserKnownHostsFile={self._folder / 'known'}")
        return (
            f"ssh -F none -p {self._port} -i {shlex.quote(str(self._folder / key))} -o {known} "
            f"-o IdentitiesOnly=yes -o IdentityAgent=none -o BatchMode=yes {more}"
        )

    def place(self, folder):
        return f"{getpass.getuser()}@127.0.0.1:{folder}"


def listens(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@pytest.fixture
def vehicle(tmp_path):
    """The folder of one whose bag of 6 MB does not shrink on its way."""
    (tmp_path / "uav1").mkdir()
    write_strings(tmp_path / "uav1" / "uav1.bag", messages=60, size=6_000_000)
    return tmp_path / "uav1"


def test_bags_come_through_ssh(server, vehicle, tmp_path, capsys):
    out = tmp_path / "out"
    # there is no control PC
    assert main([str(out), f"uav1={server.place(vehicle)}", "--rsh", server.ssh()]) == 1
    assert (out / "uav1.bag").read_bytes() == (vehicle / "uav1.bag").read_bytes()
    assert "uav1: uav1.bag\n" in capsys.readouterr().out


def test_who_is_not_let_in_or_does_not_know_the_machine_is_told(server, vehicle, tmp_path, capsys):
    arguments = [str(tmp_path / "out"), f"uav1={server.place(vehicle)}", "--rsh"]
    assert main([*arguments, server.ssh(key="host")]) == 2
    assert "uav1: " in (said := capsys.readouterr().err) and "Permission denied" in said
    (tmp_path / "known").write_text("")
    assert main([*arguments, server.ssh()]) == 2
    assert "Host key verification failed" in capsys.readouterr().err


def test_a_machine_that_falls_silent_in_the_middle_is_given_up_and_goes_on_later(
    server, vehicle, tmp_path, capsys
):
    """As where its radio goes: the connection stands, and nothing comes."""
    out, bag = tmp_path / "out", vehicle / "uav1.bag"
    arguments = [str(out), f"uav1={server.place(vehicle)}", "--rsh", server.ssh(more=SILENT)]
    (tmp_path / "silent").touch()
    assert main(arguments) == 2
    assert "uav1: Timeout, server 127.0.0.1 not responding" in (said := capsys.readouterr().err), (
        said
    )
    assert "what has come is kept: gather again" in said and not (out / bag.name).exists()
    assert (out / ".gathering" / bag.name).stat().st_size > 1_000_000

    (tmp_path / "silent").unlink()
    assert main(arguments) == 1 and (out / bag.name).read_bytes() == bag.read_bytes()


def test_who_asks_for_nothing_else_waits_15_s_for_ssh():
    told = dict(word.split("=") for word in shlex.split(RSH) if "=" in word)
    assert (
        int(told["ServerAliveInterval"]) * int(told["ServerAliveCountMax"]) == 15
        and int(told["ConnectTimeout"]) < 15
    )

# SPDX-License-Identifier: Apache-2.0
"""tools/install_vehicle.sh: what it writes its programs read, and on the radio only the relay is
open."""

import os
import shutil
import socket
import subprocess
import sys
from contextlib import ExitStack, contextmanager

import pytest

VEHICLE = [
    "--role",
    "uav1",
    "--radio",
    "radio0",
    "--peers",
    "control=10.77.1.2:7447,uav2=10.77.1.3:7447",
]
CONTROL = [
    "--role",
    "control",
    "--radio",
    "radio0",
    "--peers",
    "uav1=10.77.1.1:7447,uav2=10.77.1.3:7447",
]
CHRONY = "pool 2.debian.pool.ntp.org iburst\nmakestep 1 3\n"


@pytest.fixture
def install(root, tmp_path):
    """install(*arguments) below a folder of its own -> (exit status, what it said)."""
    (tmp_path / "etc/chrony").mkdir(parents=True)
    (tmp_path / "etc/chrony/chrony.conf").write_text(CHRONY)

    def run(*arguments):
        command = [root / "tools/install_vehicle.sh", "--root", tmp_path, *arguments]
        done = subprocess.run(command, capture_output=True, text=True)
        return done.returncode, done.stdout + done.stderr

    return run


def tree(folder):
    return {str(p.relative_to(folder)): p.read_text() for p in folder.rglob("*") if p.is_file()}


def test_it_shows_first_writes_when_told_and_takes_away_what_it_wrote(install, tmp_path):
    before = tree(tmp_path)
    status, said = install(*VEHICLE)
    assert status == 0 and tree(tmp_path) == before
    assert (
        "+    tcp dport { 7447, 7448 } accept" in said
        and "uav.launch uav:=uav1" in said
        and "add --apply" in said
    )
    assert install(*VEHICLE, "--apply")[0] == 0
    written = tree(tmp_path)
    assert "etc/systemd/system/fcsv.service" in written and len(written) == 8
    assert "export ROS_IP=127.0.0.1" in written["etc/profile.d/fcsv.sh"]
    assert (
        install(*VEHICLE, "--apply") == (0, "") and "nothing is to be done" in install(*VEHICLE)[1]
    )
    assert install("--uninstall")[0] == 0 and tree(tmp_path) == written
    assert install("--uninstall", "--apply")[0] == 0 and tree(tmp_path) == before


def test_a_control_pc_starts_by_itself_only_with_its_mission(install, tmp_path):
    assert install(*CONTROL, "--apply", "--mission", "/m.yaml")[0] == 0
    assert "control.launch mission:=/m.yaml" in tree(tmp_path)["etc/systemd/system/fcsv.service"]
    status, said = install(*CONTROL, "--apply")
    assert (
        status == 0
        and "taken away" in said
        and "etc/systemd/system/fcsv.service" not in tree(tmp_path)
    )
    assert "udp dport 123 accept" in tree(tmp_path)["etc/fcsv/nftables.nft"]


def test_a_machine_starts_from_an_install_space(install, tmp_path):
    space = tmp_path / "fcsv"
    status, said = install(*VEHICLE, "--install-space", str(space))
    assert status == 1 and f"--install-space {space}: holds no setup.bash" in said
    vehicles = space / "share/fcsv_bringup/config/vehicles"
    vehicles.mkdir(parents=True)
    (space / "setup.bash").write_text("")
    status, said = install(*VEHICLE, "--install-space", str(space))
    assert status == 1 and f"{vehicles}/uav1.yaml is missing" in said
    (vehicles / "uav1.yaml").write_text("")
    assert install(*VEHICLE, "--install-space", str(space), "--apply")[0] == 0
    assert (
        f"'. {space}/setup.bash && exec roslaunch"
        in tree(tmp_path)["etc/systemd/system/fcsv.service"]
    )


def test_files_of_others_are_left_alone(install, tmp_path):
    mine = tmp_path / "etc/profile.d/fcsv.sh"
    mine.parent.mkdir()
    mine.write_text("export ROS_IP=10.0.0.1\n")
    status, said = install(*VEHICLE, "--apply")
    assert status == 1 and f"{mine}: is there and not ours" in said and len(tree(tmp_path)) == 2
    assert (
        install("--uninstall", "--apply")[0] == 0 and mine.read_text() == "export ROS_IP=10.0.0.1\n"
    )


@pytest.mark.parametrize(
    "arguments, said",
    [
        ([], "--role is missing"),
        (["--role", "uav9", *VEHICLE[2:]], "config/vehicles/uav9.yaml is missing"),
        (["--role", "uav 1", *VEHICLE[2:]], "--role 'uav 1'"),
        ([*VEHICLE, "--radio", "lo"], "--radio 'lo' is no network interface"),
        ([*VEHICLE, "--radio", 'a" accept'], "is no network interface"),
        ([*VEHICLE, "--port", "65535"], "--port 65535"),
        ([*VEHICLE, "--peers", "uav2=10.0.0.1:7447"], "must name the control PC"),
        ([*VEHICLE, "--peers", "control=10.0.0.1"], "write NAME=HOST:PORT"),
        ([*VEHICLE, "--peers", "control=a:1,control=b:1"], "names control twice"),
        ([*VEHICLE, "--peers", "control=a:1,uav1=b:1"], "which is this machine"),
        ([*VEHICLE, "--launch", "camera"], "write NAME:=VALUE"),
        ([*VEHICLE, "--launch", "camera:=a';reboot"], "without blanks or quotes"),
        ([*VEHICLE, "--keys", "/a b"], "blanks and quotes"),
        ([*VEHICLE, "--user", "nobody-here"], "unknown on this machine"),
    ],
)
def test_what_cannot_be_is_refused_with_a_word(install, tmp_path, arguments, said):
    status, output = install(*arguments, "--apply")
    assert status == 1 and said in output and len(tree(tmp_path)) == 1


@pytest.mark.parametrize("arguments", [VEHICLE, CONTROL], ids=["vehicle", "control"])
def test_chrony_and_systemd_read_what_was_written(install, tmp_path, arguments):
    mission = ["--mission", "/m.yaml"] if arguments is CONTROL else []
    assert install(*arguments, *mission, "--apply")[0] == 0
    chronyd = shutil.which("chronyd") or "/usr/sbin/chronyd"
    if not os.path.exists(chronyd) or not shutil.which("systemd-analyze"):
        pytest.skip("needs chrony and systemd (apt-get install chrony systemd)")
    read = subprocess.run(
        [chronyd, "-p", "-f", tmp_path / "etc/chrony/fcsv.conf"], capture_output=True, text=True
    )
    assert read.returncode == 0, read.stderr
    assert (
        "server 10.77.1.2 iburst" if arguments is VEHICLE else "allow 10.77.1.0/24"
    ) in read.stdout
    units = sorted((tmp_path / "etc/systemd/system").iterdir())
    text = units[0].read_text() + units[1].read_text()
    if not os.path.exists("/usr/sbin/nft") or "WorkingDirectory=/" not in text:
        pytest.skip("needs nftables (apt-get install nftables)")
    verify = ["systemd-analyze", "verify", "--recursive-errors=no", *units]
    read = subprocess.run(verify, capture_output=True, text=True)
    ours = [line for line in read.stderr.splitlines() if "fcsv" in line]
    assert len(units) == 2 and not ours, ours


# ---- the firewall, in namespaces -----------------------------------------------------------------


def permitted():
    """Whether this process may make namespaces and load rules; else why not."""
    if os.geteuid() != 0:
        return "needs root"
    if not shutil.which("nft", path=os.environ["PATH"] + ":/usr/sbin"):
        return "needs nftables (apt-get install nftables)"
    name = f"fcsv-nft-probe-{os.getpid()}"
    try:
        for command in (
            f"ip netns add {name}".split(),
            f"ip netns exec {name} nft add table inet a".split(),
        ):
            if subprocess.run(command, capture_output=True).returncode:
                return f"`{' '.join(command)}` is not permitted here"
    finally:
        subprocess.run(["ip", "netns", "del", name], capture_output=True)
    return ""


# in a namespace: connects to each port on the command line, and says which took it
SCAN = """
import socket, sys
for port in map(int, sys.argv[2:]):
    with socket.socket() as s:
        s.settimeout(2.0)
        if s.connect_ex((sys.argv[1], port)) == 0: print(port)
"""
SEND = (
    "import socket, sys; s = socket.socket(type=socket.SOCK_DGRAM)\n"
    "for p in sys.argv[2:]: s.sendto(b'x', (sys.argv[1], int(p)))"
)


@contextmanager
def two_machines():
    """Namespaces of a vehicle (10.77.1.1) and somebody (10.77.1.2) on its radio."""
    names = [f"fcsv-{n}-{os.getpid()}" for n in ("guarded", "other")]
    ip = lambda *words: subprocess.run(["ip", *words], check=True, capture_output=True)  # noqa: E731
    with ExitStack() as stack:
        for name in names:
            ip("netns", "add", name)
            stack.callback(ip, "netns", "del", name)
        ip(
            "link",
            "add",
            "radio0",
            "netns",
            names[0],
            "type",
            "veth",
            "peer",
            "name",
            "radio0",
            "netns",
            names[1],
        )
        for i, name in enumerate(names):
            ip("-n", name, "addr", "add", f"10.77.1.{i + 1}/24", "dev", "radio0")
            for device in ("radio0", "lo"):
                ip("-n", name, "link", "set", device, "up")
        yield names


@contextmanager
def listening(namespace, tcp, udp):
    """Sockets of that namespace which take what comes; (port to socket) of the datagrams'."""
    sys.path.insert(0, os.path.join(os.path.dirname(__file__), "../../tools/bench_link"))
    from radio import in_namespace

    def open_all():
        out = {}
        for kind, port in [(socket.SOCK_STREAM, p) for p in tcp] + [
            (socket.SOCK_DGRAM, p) for p in udp
        ]:
            s = out[kind, port] = socket.socket(type=kind)
            s.bind(("0.0.0.0", port))
            s.setblocking(False)
            if kind == socket.SOCK_STREAM:
                s.listen(16)
        return out

    sockets = in_namespace(namespace, open_all)
    try:
        yield {port: s for (kind, port), s in sockets.items() if kind == socket.SOCK_DGRAM}
    finally:
        for s in sockets.values():
            s.close()


@pytest.mark.parametrize(
    "arguments, more_tcp, more_udp",
    [(VEHICLE, set(), set()), ([*VEHICLE, "--ssh"], {22}, set()), (CONTROL, set(), {123})],
    ids=["vehicle", "vehicle with ssh", "control"],
)
def test_on_the_radio_only_the_relay_is_open(install, tmp_path, arguments, more_tcp, more_udp):
    why_not = permitted()
    if why_not:
        pytest.skip(why_not)
    assert install(*arguments, "--apply")[0] == 0
    # ssh, NTP, a web server, the ROS master, nodes on ports that the kernel gave, the relay and its
    # neighbour
    tcp, udp = (
        [22, 80, 11311, 33033, 37999, 45678, 60999, 7446, 7447, 7448, 7449],
        [123, 5353, 7447, 7448, 40000],
    )

    def open_ports(guarded, other, datagrams):
        run = lambda *command: subprocess.run(  # noqa: E731
            ["ip", "netns", "exec", other, sys.executable, "-c", *command],
            check=True,
            capture_output=True,
            text=True,
        ).stdout.split()
        streams = set(map(int, run(SCAN, "10.77.1.1", *map(str, tcp))))
        run(SEND, "10.77.1.1", *map(str, udp))
        return streams, {port for port, s in datagrams.items() if came(s)}

    def came(s):
        try:
            return bool(s.recv(10))
        except BlockingIOError:
            return False

    with two_machines() as (guarded, other), listening(guarded, tcp, udp) as datagrams:
        # the scan finds what is open
        assert open_ports(guarded, other, datagrams) == (set(tcp), set(udp))
        load = ["ip", "netns", "exec", guarded, "nft", "-f", tmp_path / "etc/fcsv/nftables.nft"]
        for _ in range(2):  # again, as a restart of the unit does
            subprocess.run(load, check=True)
        assert open_ports(guarded, other, datagrams) == ({7447, 7448} | more_tcp, {7447} | more_udp)
        home = [
            "ip",
            "netns",
            "exec",
            guarded,
            sys.executable,
            "-c",
            SCAN,
            "127.0.0.1",
            *map(str, tcp),
        ]
        assert len(
            subprocess.run(home, check=True, capture_output=True, text=True).stdout.split()
        ) == len(tcp)


def test_a_radio_that_is_not_there_is_told_before_it_is_refused():
    """Its firewall would close nothing. Shown only: nothing is written without --apply."""
    command = ["tools/install_vehicle.sh", *VEHICLE, "--radio", "nosuch0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (
        done.returncode == 0
        and "--radio 'nosuch0': this machine has only lo" in done.stdout.splitlines()[-1]
    )

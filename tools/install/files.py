# SPDX-License-Identifier: Apache-2.0
"""The files that prepare a machine for the field, as text; nothing here reads or writes."""

import ipaddress
import re
from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

MARK = "written by tools/install_vehicle.sh"
CONTROL = "control"
FIREWALL, SERVICE = "fcsv-firewall.service", "fcsv.service"
_WORD = re.compile(r"[\w./:=,@+~-]+")
_INTERFACE = re.compile(r"[A-Za-z0-9_.-]{1,15}")
_LAUNCH = re.compile(r"[a-z_]\w*:=[\w./:=,@+~-]*")
_CHRONY, _CHRONY_LINE = "/etc/chrony/chrony.conf", "include /etc/chrony/fcsv.conf"


class InstallError(Exception):
    """Something that was asked for and cannot be; the text says what to give."""


@dataclass(frozen=True)
class Plan:
    """What this machine is to be. ``peers``: NAME to (host, port); ``port``: of the relay, which
    takes the next too."""

    role: str
    radio: str
    peers: Dict[str, Tuple[str, int]]
    port: int
    workspace: str
    user: str
    keys: str
    record_dir: str
    ssh: bool = False
    mission: str = ""
    launch: Tuple[str, ...] = ()
    install_space: str = ""  # of `cmake --install`; empty: the workspace's devel space

    def __post_init__(self):
        if not self.role.isidentifier() or self.role == "fleet":
            raise InstallError(
                f"--role '{self.role}': give control or a vehicle's name, of letters, digits and _"
            )
        if not _INTERFACE.fullmatch(self.radio) or self.radio == "lo":
            raise InstallError(
                f"--radio '{self.radio}' is no network interface; `ip link` lists them"
            )
        if not 1024 <= self.port < 65535:
            raise InstallError(
                f"--port {self.port}: must be in 1024..65534; the relay uses it and the one after it"
            )
        if self.role in self.peers:
            raise InstallError(f"--peers names {self.role}, which is this machine; give the others")
        if self.role != CONTROL and CONTROL not in self.peers:
            raise InstallError(
                "--peers must name the control PC: control=HOST:PORT,...; its clock is everybody's"
            )
        for entry in self.launch:
            if not _LAUNCH.fullmatch(entry):
                raise InstallError(
                    f"--launch '{entry}': write NAME:=VALUE, as for roslaunch, without blanks or quotes"
                )
        for option in ("workspace", "user", "keys", "record_dir", "mission", "install_space"):
            value = getattr(self, option)
            if value and not _WORD.fullmatch(value):
                raise InstallError(
                    f"--{option.replace('_', '-')} '{value}': blanks and quotes cannot stand in a unit"
                )

    @property
    def environment(self) -> str:
        """The file that a shell reads to know the packages; from ``workspace``."""
        return f"{self.install_space}/setup.bash" if self.install_space else "devel/setup.sh"

    @property
    def starts_by_itself(self) -> bool:
        """A vehicle does; the control PC only where its mission is given."""
        return self.role != CONTROL or bool(self.mission)


def parse_peers(text: str) -> Dict[str, Tuple[str, int]]:
    """NAME=HOST:PORT,... Raises InstallError."""
    peers: Dict[str, Tuple[str, int]] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, _, address = part.partition("=")
        host, _, port = address.rpartition(":")
        if not name.isidentifier() or not host or not port.isdigit() or not _WORD.fullmatch(host):
            raise InstallError(f"--peers '{part}': write NAME=HOST:PORT")
        if name in peers:
            raise InstallError(f"--peers names {name} twice")
        peers[name] = (host, int(port))
    return peers


def files(plan: Plan) -> Dict[str, str]:
    """Path to text of every file of this role."""
    out = {
        "/etc/fcsv/nftables.nft": firewall(plan),
        f"/etc/systemd/system/{FIREWALL}": _firewall_unit(),
        "/etc/chrony/fcsv.conf": clock(plan),
        "/etc/sysctl.d/90-fcsv.conf": f"# {MARK}\n# pictures over a radio that loses packets: docs/user/radio.md\n"
        "net.ipv4.tcp_congestion_control = bbr\n",
        "/etc/modules-load.d/fcsv.conf": f"# {MARK}\ntcp_bbr\n",
        "/etc/profile.d/fcsv.sh": f"# {MARK}\n# ROS stays on this machine; topics cross by the relay\n"
        "export ROS_IP=127.0.0.1 ROS_MASTER_URI=http://127.0.0.1:11311\nunset ROS_HOSTNAME\n",
    }
    if plan.starts_by_itself:
        out[f"/etc/systemd/system/{SERVICE}"] = _service(plan)
    return out


ALL_FILES = (
    "/etc/fcsv/nftables.nft",
    f"/etc/systemd/system/{FIREWALL}",
    f"/etc/systemd/system/{SERVICE}",
    "/etc/chrony/fcsv.conf",
    "/etc/sysctl.d/90-fcsv.conf",
    "/etc/modules-load.d/fcsv.conf",
    "/etc/profile.d/fcsv.sh",
)


def firewall(plan: Plan) -> str:
    """nftables: on the radio only the relay is open, and the control PC's clock. Other interfaces
    stay as they are."""
    more = ["    tcp dport 22 accept"] if plan.ssh else []
    more += ["    udp dport 123 accept  # chrony"] if plan.role == CONTROL else []
    extra = "".join(line + "\n" for line in more)
    return f"""# {MARK}
# The relay checks certificates; ROS checks nothing. So ROS is not to be reached over the radio.
table inet fcsv
delete table inet fcsv
table inet fcsv {{
  chain input {{
    type filter hook input priority -10; policy accept;
    iifname != "{plan.radio}" accept
    ct state established,related accept
    meta l4proto {{ icmp, ipv6-icmp }} accept
    udp sport 67 udp dport 68 accept  # DHCP
    tcp dport {{ {plan.port}, {plan.port + 1} }} accept
    udp dport {plan.port} accept
{extra}    meta l4proto tcp reject with tcp reset
    drop
  }}
  chain forward {{
    type filter hook forward priority -10; policy accept;
    iifname "{plan.radio}" drop
  }}
}}
"""


def clock(plan: Plan) -> str:
    """chrony: vehicles follow the control PC, which serves its own time where nobody gives it a
    better one."""
    if plan.role == CONTROL:
        nets = sorted({n for n in map(_net, (host for host, _ in plan.peers.values())) if n})
        allow = "".join(f"allow {net}\n" for net in nets) or "allow\n"
        return f"# {MARK}\n{allow}local stratum 10\n"
    host = plan.peers[CONTROL][0]
    return (
        f"# {MARK}\n# a picture's pose is found by its stamp: at 20 ms calibration is refused\n"
        f"server {host} iburst minpoll 2 maxpoll 4 prefer\n"
        "# stepped only at the start: in flight the clock is slewed\nmakestep 0.05 3\n"
    )


def _net(host: str) -> Optional[str]:
    try:
        return str(ipaddress.ip_network(f"{host}/24", strict=False))
    except ValueError:
        return None


def _firewall_unit() -> str:
    return f"""# {MARK}
[Unit]
Description=fcsv: only the relay is open on the radio
Wants=network-pre.target
Before=network-pre.target {SERVICE}
DefaultDependencies=no
After=local-fs.target

[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart=/usr/sbin/nft -f /etc/fcsv/nftables.nft
ExecStop=/usr/sbin/nft delete table inet fcsv

[Install]
WantedBy=sysinit.target
"""


def launch_command(plan: Plan) -> List[str]:
    """As one would type it."""
    peers = ",".join(f"{name}={host}:{port}" for name, (host, port) in plan.peers.items())
    link = [
        f"listen:=0.0.0.0:{plan.port}",
        f"peers:={peers}",
        f"keys:={plan.keys}",
        f"record_dir:={plan.record_dir}",
    ]
    if plan.role == CONTROL:
        return [
            "roslaunch",
            "fcsv_bringup",
            "control.launch",
            f"mission:={plan.mission}",
            *link,
            *plan.launch,
        ]
    return ["roslaunch", "fcsv_bringup", "uav.launch", f"uav:={plan.role}", *link, *plan.launch]


def _service(plan: Plan) -> str:
    """Without the firewall it does not start; flight nodes may raise their priority."""
    return f"""# {MARK}
[Unit]
Description=fcsv: everything that runs on {plan.role}
Requires={FIREWALL}
After={FIREWALL} network.target chrony.service
StartLimitIntervalSec=0

[Service]
User={plan.user}
Environment=ROS_IP=127.0.0.1 ROS_MASTER_URI=http://127.0.0.1:11311
WorkingDirectory={plan.workspace}
ExecStart=/bin/bash -c '. {plan.environment} && exec {" ".join(launch_command(plan))}'
AmbientCapabilities=CAP_SYS_NICE
KillMode=mixed
KillSignal=SIGINT
TimeoutStopSec=30
Restart=on-failure
RestartSec=1

[Install]
WantedBy=multi-user.target
"""


def chrony_conf(text: str, wanted: bool) -> str:
    """chrony's own file with our line (Ubuntu 20.04 reads no conf.d), or without it."""
    mark = f"{_CHRONY_LINE}  # {MARK}"
    lines = [
        line for line in text.splitlines() if line.strip() not in (_CHRONY_LINE, f"# {MARK}:", mark)
    ]
    ours = [f"# {MARK}:", _CHRONY_LINE] if wanted else []
    return "\n".join(lines + ours) + "\n"

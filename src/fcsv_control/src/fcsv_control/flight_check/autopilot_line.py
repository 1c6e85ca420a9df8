# SPDX-License-Identifier: Apache-2.0
"""Who else may speak on the line to the autopilot: nobody on a cable and on loopback, nobody
without the key."""

import ipaddress
from dataclasses import dataclass

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Check, Found

_CABLE = ("/", "serial:")


@dataclass(frozen=True)
class AutopilotLine:
    """``url``: the flight link's fcu_url, empty where it has none; ``signed``: it was given a
    key."""

    url: str = ""
    signed: bool = False


def reached_by_nobody_else(url: str) -> bool:
    """Whether a line is a cable, or stays in the computer.

    >>> [reached_by_nobody_else(url) for url in ("/dev/ttyACM0:115200", "tcp:127.0.0.1:5760", "tcp:10.0.0.2:5760", "")]
    [True, True, False, False]
    >>> [reached_by_nobody_else(url) for url in ("tcp:localhost:5760", "tcp:localhost.my.net:1", "tcp:127.my.net:1")]
    [True, False, False]
    """
    if url.startswith(_CABLE):
        return True
    # of MAVROS's form: here, and there
    ends = url.partition("://" if "://" in url else ":")[2].split("@")
    hosts = [end for end in ends if end and not end.startswith(":")]
    return bool(hosts) and all(_on_loopback(host) for host in hosts)


def _on_loopback(end: str) -> bool:
    """Judges the address of HOST:PORT. A name that only begins so is another machine's."""
    host = end.rpartition(":")[0] or end
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def grade(line: AutopilotLine) -> Found:
    """
    >>> [grade(AutopilotLine(u))[0].word for u in ("/dev/ttyACM0:115200", "udpin:127.0.0.1:1455", "udpin:0.0.0.0:1455")]
    ['green', 'green', 'amber']
    >>> [grade(AutopilotLine(u))[0].word for u in ("udp://127.0.0.1:14550@", "udp://:0@10.0.0.2:14550", "tcp:h:5760")]
    ['green', 'amber', 'amber']
    >>> grade(AutopilotLine("tcp:192.168.1.5:5760", signed=True))
    (<Grade.GREEN: 1>, 'signed')
    """
    if line.signed:
        return Grade.GREEN, "signed"
    if not line.url:
        return Grade.GREEN, "it speaks no MAVLink"
    if reached_by_nobody_else(line.url):
        return Grade.GREEN, "by cable" if line.url.startswith(_CABLE) else "on loopback alone"
    return Grade.AMBER, f"{line.url} is not signed: whoever reaches it flies the vehicle"


def check(of) -> Check:
    """The line; ``of(now_s, facts, rules)`` finds it."""
    remedy = "signing_key:=FILE (docs/user/vehicles.md)"
    return Check("signing", "nobody else can speak for autopilot or companion", remedy, of)

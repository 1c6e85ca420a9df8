# SPDX-License-Identifier: Apache-2.0
"""Who else may speak on the line to the autopilot: nobody on a cable and on loopback, nobody without the key."""

from dataclasses import dataclass

from fcsv_control.flight_check.lines import Check, Found, State

_LOOPBACK = ("127.", "localhost")


@dataclass(frozen=True)
class AutopilotLine:
    """``url``: the flight link's fcu_url, empty where it has none; ``signed``: it was given a key."""

    url: str = ""
    signed: bool = False


def judge(line: AutopilotLine) -> Found:
    """
    >>> [judge(AutopilotLine(u))[0].word for u in ("/dev/ttyACM0:115200", "udpin:127.0.0.1:1455", "udpin:0.0.0.0:1455")]
    ['green', 'green', 'amber']
    >>> [judge(AutopilotLine(u))[0].word for u in ("udp://127.0.0.1:14550@", "udp://:0@10.0.0.2:14550", "tcp:h:5760")]
    ['green', 'amber', 'amber']
    >>> judge(AutopilotLine("tcp:192.168.1.5:5760", signed=True))
    (<State.GREEN: 1>, 'signed')
    """
    if line.signed:
        return State.GREEN, "signed"
    if not line.url or line.url.startswith(("/", "serial:")):
        return State.GREEN, "by cable" if line.url else "it speaks no MAVLink"
    ends = line.url.partition("://" if "://" in line.url else ":")[2].split("@")  # of MAVROS's form: here, and there
    hosts = [end for end in ends if end and not end.startswith(":")]
    if hosts and all(host.startswith(_LOOPBACK) for host in hosts):
        return State.GREEN, "on loopback alone"
    return State.AMBER, f"{line.url} is not signed: whoever reaches it flies the vehicle"


def check(of) -> Check:
    """The line; ``of(now_s, facts, rules)`` finds it."""
    return Check("signing", "nobody else can speak for autopilot or companion", "signing_key:=FILE (autopilot.md)", of)

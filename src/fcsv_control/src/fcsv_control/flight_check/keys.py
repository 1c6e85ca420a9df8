# SPDX-License-Identifier: Apache-2.0
"""The keys of this machine's relay, as it tells of them in its diagnostics; of a vehicle and of the
control PC."""

from dataclasses import dataclass

from fcsv_control.conditions import Grade
from fcsv_control.flight_check.lines import Check, Found
from fcsv_geometry.streams.stream import Stream

RELAY = "relay"


@dataclass(frozen=True)
class Keys:
    """``encrypted``: the relay has keys; ``warning``: what is wrong with them; ``exposed``: how ROS
    is open."""

    encrypted: bool
    warning: str = ""
    exposed: str = ""


def grade(now_s: float, keys: Stream[Keys], link: str, most_s: float) -> Found:
    """``link``: which program stands between the machines; another one than the relay encrypts
    nothing."""
    if link != RELAY:
        return Grade.AMBER, f"{link} encrypts nothing: fly inside a VPN only"
    if not keys.fresh(now_s, most_s):
        return Grade.UNKNOWN, "the relay is not heard"
    k = keys.value
    if k.exposed:
        return Grade.RED, k.exposed
    if k.warning:
        return Grade.AMBER, k.warning
    return Grade.GREEN, "they last" if k.encrypted else "none: the relay speaks on loopback alone"


def check(of) -> Check:
    """The line; ``of(now_s, facts, rules)`` finds it."""
    remedy = "make new keys (docs/user/radio.md); close ROS: ROS_IP=127.0.0.1"
    return Check("keys", "what crosses the radio is encrypted, by keys that last", remedy, of)

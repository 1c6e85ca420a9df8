# SPDX-License-Identifier: Apache-2.0
"""rosrun fcsv_multimaster link_status: the links of this machine as they are measured now."""

import argparse
import sys
import time
from typing import Dict, List, Optional, Sequence

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

_LEVELS = {DiagnosticStatus.OK: "ok", DiagnosticStatus.WARN: "WARN", DiagnosticStatus.ERROR: "ERROR"}
_WAIT_S = 4.0


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Exit status: 0 all well, 1 some link is not, 2 no relay speaks here."""
    parser = argparse.ArgumentParser(prog="link_status", description=__doc__)
    parser.add_argument("--watch", action="store_true", help="again every second, until Ctrl-C")
    arguments = parser.parse_args(argv if argv is not None else rospy.myargv()[1:])
    try:
        topics = [n for n, kind in rosgraph.Master("/link_status").getTopicTypes() if n.endswith("/relay/links")]
    except OSError:
        print("link_status: no ROS master answers; is ROS_MASTER_URI right?", file=sys.stderr)
        return 2
    if not topics:
        print("link_status: no relay runs on this machine's master", file=sys.stderr)
        return 2
    rospy.init_node("link_status", anonymous=True)
    return _show(topics, arguments.watch)


def _show(topics: Sequence[str], watch: bool) -> int:
    newest: Dict[str, DiagnosticStatus] = {}

    def keep(message: DiagnosticArray) -> None:
        newest.update((s.name, s) for s in message.status)

    subscribers = [rospy.Subscriber(t, DiagnosticArray, keep, queue_size=5) for t in topics]
    until_s = time.monotonic() + _WAIT_S
    while not newest and time.monotonic() < until_s and not rospy.is_shutdown():
        time.sleep(0.05)
    while newest and watch and not rospy.is_shutdown():
        print("\033[2J\033[H" + render(list(newest.values())), flush=True)
        time.sleep(1.0)
    if not newest:
        print(f"link_status: the relay says nothing on {', '.join(topics)}", file=sys.stderr)
        return 2
    if not watch:
        print(render(list(newest.values())))
    del subscribers
    return int(any(s.level != DiagnosticStatus.OK for s in newest.values()))


def render(statuses: Sequence[DiagnosticStatus]) -> str:
    """A table of links, then of the topics that come in."""
    lines = [
        f"{'link':<18}{'state':<7}{'round trip':>11}{'loss in':>9}{'in':>12}{'carries':>12}"
        f"{'waiting':>9}{'clock':>10}  "
    ]
    for status in sorted(statuses, key=lambda s: s.name):
        v = {kv.key: kv.value for kv in status.values}
        lines.append(
            f"{status.name[5:]:<18}{_LEVELS.get(status.level, '?'):<7}"
            f"{_ms(v['round_trip_s']):>11}{_percent(v['in_loss']):>9}"
            f"{v['in_kbit_s'] + ' kbit/s':>12}{_rate(v['carries_kbit_s']):>12}"
            f"{int(v['waiting']) + int(v['pictures_waiting']):>9}{_ms(v['clock_offset_s']):>10}  {status.message}"
        )
    for status in sorted(statuses, key=lambda s: s.name):
        lines += _topics(status)
    return "\n".join(lines)


def _topics(status: DiagnosticStatus) -> List[str]:
    rows = [(kv.key[3:], dict(p.split("=") for p in kv.value.split())) for kv in status.values if kv.key[:3] == "in "]
    if not rows:
        return []
    lines = ["", f"{'in over ' + status.name[5:]:<48}{'Hz':>8}{'loss':>8}{'age':>10}{'silent':>10}{'kbit/s':>9}"]
    for name, r in rows:
        lines.append(f"{name:<48}{r['rate_hz']:>8}{_percent(r['loss']):>8}{_ms(r['age_s']):>10}{_ms(r['silent_s']):>10}"
                     f"{r['kbit_s']:>9}")  # fmt: skip
    return lines


def _ms(text: str) -> str:
    return "-" if text == "-" else f"{1e3 * float(text):.1f} ms"


def _percent(text: str) -> str:
    return "-" if text == "-" else f"{100 * float(text):.1f} %"


def _rate(text: str) -> str:
    return "all" if text == "-" else f"{float(text):.0f} kbit/s"

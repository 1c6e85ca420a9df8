# SPDX-License-Identifier: Apache-2.0
"""rosrun fcsv_multimaster link_status: the links of this machine as they are measured now."""

import argparse
import sys
import threading
import time
from typing import Dict, List, Optional, Sequence

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from fcsv_geometry.ros import node

_LEVELS = {
    DiagnosticStatus.OK: "ok",
    DiagnosticStatus.WARN: "WARN",
    DiagnosticStatus.ERROR: "ERROR",
}
_WAIT_S = 10.0  # the relay reports once a second; a machine that is busy starts this program slowly
_WORDS = ("state", "says")
_LINK_HEAD = ("link", "state", "round trip", "loss in", "in", "carries", "waiting", "clock", "says")


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Exit status: 0 all well, 1 some link is not, 2 no relay speaks here."""
    parser = argparse.ArgumentParser(prog="link_status", description=__doc__)
    parser.add_argument("--watch", action="store_true", help="again every second, until Ctrl-C")
    arguments = parser.parse_args(argv if argv is not None else rospy.myargv()[1:])
    try:
        topics = [
            n
            for n, kind in rosgraph.Master("/link_status").getTopicTypes()
            if n.endswith("/relay/links")
        ]
    except OSError:
        print("link_status: no ROS master answers; is ROS_MASTER_URI right?", file=sys.stderr)
        return 2
    if not topics:
        print("link_status: no relay runs on this machine's master", file=sys.stderr)
        return 2
    node.begin("link_status", anonymous=True)
    return _show(topics, arguments.watch)


def _show(topics: Sequence[str], watch: bool) -> int:
    newest: Dict[str, DiagnosticStatus] = {}
    heard = threading.Event()

    def keep(message: DiagnosticArray) -> None:
        heard.set()
        newest.update((s.name, s) for s in message.status)

    subscribers = [rospy.Subscriber(t, DiagnosticArray, keep, queue_size=5) for t in topics]
    until_s = time.monotonic() + _WAIT_S
    while not newest and time.monotonic() < until_s and not rospy.is_shutdown():
        time.sleep(0.05)
    while newest and watch and not rospy.is_shutdown():
        print("\033[2J\033[H" + render(list(newest.values())), flush=True)
        time.sleep(1.0)
    if not newest:
        why = (
            "the relay has no peer"
            if heard.is_set()
            else f"nothing came on {', '.join(topics)} in {_WAIT_S:.0f} s"
        )
        print(f"link_status: {why}", file=sys.stderr)
        return 2
    if not watch:
        print(render(list(newest.values())))
    del subscribers
    return int(any(s.level != DiagnosticStatus.OK for s in newest.values()))


def render(statuses: Sequence[DiagnosticStatus]) -> str:
    """A table of links, then of the topics that come in; a column is as wide as what stands in
    it."""
    statuses = sorted(statuses, key=lambda s: s.name)
    lines = _table(_LINK_HEAD, [_link(s) for s in statuses])
    for status in statuses:
        lines += _topics(status)
    return "\n".join(lines)


def _link(status: DiagnosticStatus) -> Sequence[str]:
    v = {kv.key: kv.value for kv in status.values}
    return (
        status.name[5:],
        _LEVELS.get(status.level, "?"),
        _ms(v["round_trip_s"]),
        _percent(v["in_loss"]),
        v["in_kbit_s"] + " kbit/s",
        _rate(v["carries_kbit_s"]),
        str(int(v["waiting"]) + int(v["pictures_waiting"])),
        _ms(v["clock_offset_s"]),
        status.message,
    )


def _topics(status: DiagnosticStatus) -> List[str]:
    rows = [
        (kv.key[3:], dict(p.split("=") for p in kv.value.split()))
        for kv in status.values
        if kv.key[:3] == "in "
    ]
    if not rows:
        return []
    cells = [
        (name, r["rate_hz"], _percent(r["loss"]), _ms(r["age_s"]), _ms(r["silent_s"]), r["kbit_s"])
        for name, r in rows
    ]
    return [
        "",
        *_table((f"in over {status.name[5:]}", "Hz", "loss", "age", "silent", "kbit/s"), cells),
    ]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> List[str]:
    """Two blanks between columns; words to the left, figures to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows)]
    left = {0} | {k for k, name in enumerate(head) if name in _WORDS}
    cell = [str.ljust if k in left else str.rjust for k in range(len(head))]
    return [
        "  ".join(c(text, w) for c, text, w in zip(cell, row, widths)).rstrip()
        for row in (head, *rows)
    ]


def _ms(text: str) -> str:
    return "-" if text == "-" else f"{1e3 * float(text):.1f} ms"


def _percent(text: str) -> str:
    return "-" if text == "-" else f"{100 * float(text):.1f} %"


def _rate(text: str) -> str:
    return "all" if text == "-" else f"{float(text):.0f} kbit/s"

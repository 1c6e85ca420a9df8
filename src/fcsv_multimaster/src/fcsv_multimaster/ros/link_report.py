# SPDX-License-Identifier: Apache-2.0
"""The measured links as diagnostics: one status per peer, with the figures of the link and of every
topic."""

from typing import Dict, Optional

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from fcsv_multimaster.relay.measure import CLOCKS_APART_S

_BAD_LOSS = 0.2
_SLOW_S = 0.5


def congestion_control() -> str:
    """The kernel's TCP congestion control, which matters more to pictures than anything here."""
    try:
        with open("/proc/sys/net/ipv4/tcp_congestion_control") as file:
            return file.read().strip()
    except OSError:
        return "unknown"


def status_of(
    machine: str, peer: str, report: Dict[str, Dict], encrypted: bool, picture_steps: Dict[str, int]
):
    """A DiagnosticStatus of the link from ``machine`` to ``peer``."""
    link = report["link"]
    level, text = assess(link)
    values = [KeyValue(k, _spell(v)) for k, v in link.items()]
    values += [KeyValue("encrypted", str(encrypted)), KeyValue("tcp", congestion_control())]
    values += [KeyValue(f"jpeg step {name}", str(step)) for name, step in picture_steps.items()]
    for topic, figures in sorted(report["topics"].items()):
        values.append(
            KeyValue(f"in {topic}", " ".join(f"{k}={_spell(v)}" for k, v in figures.items()))
        )
    return DiagnosticStatus(
        level=level, name=f"link {machine}-{peer}", message=text, hardware_id=machine, values=values
    )


def assess(link: Dict) -> tuple:
    """(level, one line) of a link's figures."""
    if not link["alive"]:
        return DiagnosticStatus.ERROR, "no answer"
    if link["ping_loss"] > _BAD_LOSS:
        return DiagnosticStatus.WARN, f"{100 * link['ping_loss']:.0f} % of the pings were lost"
    if link["pictures_give_way"]:
        carries = (
            ""
            if link["carries_kbit_s"] is None
            else f": the link carries {link['carries_kbit_s']:.0f} kbit/s"
        )
        return DiagnosticStatus.WARN, "pictures give way to state and commands" + carries
    if link["clock_offset_s"] is not None and abs(link["clock_offset_s"]) > CLOCKS_APART_S:
        return (
            DiagnosticStatus.WARN,
            f"the clocks differ by {abs(link['clock_offset_s']):.1f} s; synchronise them",
        )
    if link["round_trip_s"] is not None and link["round_trip_s"] > _SLOW_S:
        return DiagnosticStatus.WARN, f"slow: {1e3 * link['round_trip_s']:.0f} ms there and back"
    return DiagnosticStatus.OK, "well"


def _spell(value: Optional[object]) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "-" if value is None else str(value)


def array(stamp, statuses) -> DiagnosticArray:
    message = DiagnosticArray(status=list(statuses))
    message.header.stamp = stamp
    return message

# SPDX-License-Identifier: Apache-2.0
"""The table of link_status: its columns stay apart, whatever stands in them."""

import re

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from fcsv_multimaster.ros.link_status import render


def link(name, **changed):
    values = {
        "round_trip_s": "0.0123",
        "in_loss": "0.001",
        "in_kbit_s": "12.5",
        "carries_kbit_s": "-",
        "waiting": "3",
        "pictures_waiting": "1",
        "clock_offset_s": "0.0004",
        **changed,
    }
    topic = "rate_hz=30.0 loss=0.01 age_s=0.02 silent_s=0.1 kbit_s=88.1"
    pairs = [KeyValue(k, v) for k, v in values.items()] + [
        KeyValue("in /uav1/odometry/state", topic)
    ]
    return DiagnosticStatus(
        level=DiagnosticStatus.OK, name=f"link {name}", message="all well", values=pairs
    )


def test_columns_stay_apart_where_names_and_rates_are_long():
    long_name = "a_vehicle_whose_name_is_rather_long"
    table = render(
        [
            link("uav1"),
            link(long_name, in_kbit_s="123456789.0", carries_kbit_s="99999999", in_loss="1.0"),
        ]
    )
    rows = [re.split(r"  +", line) for line in table.splitlines() if line]
    head, long, short = rows[:3]
    assert head == [
        "link",
        "state",
        "round trip",
        "loss in",
        "in",
        "carries",
        "waiting",
        "clock",
        "says",
    ]
    assert long == [
        long_name,
        "ok",
        "12.3 ms",
        "100.0 %",
        "123456789.0 kbit/s",
        "99999999 kbit/s",
        "4",
        "0.4 ms",
        "all well",
    ]
    assert short[:2] == ["uav1", "ok"] and len(short) == len(head)
    assert rows[3][0] == f"in over {long_name}" and rows[4] == [
        "/uav1/odometry/state",
        "30.0",
        "1.0 %",
        "20.0 ms",
        "100.0 ms",
        "88.1",
    ]

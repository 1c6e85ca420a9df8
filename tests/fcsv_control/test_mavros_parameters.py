# SPDX-License-Identifier: Apache-2.0
"""MAVROS is given parameters that MAVROS 1.21 reads: an unknown one it ignores without a word."""

import pytest
import yaml

#: Those of the plugins that run, with the type that MAVROS 1.21.0 reads (its sources; a scalar is
#: no list).
READ = {
    "startup_px4_usb_quirk": bool,
    "conn/heartbeat_rate": float,
    "conn/heartbeat_mav_type": str,
    "conn/timeout": float,
    "conn/timesync_rate": float,
    "conn/system_time_rate": float,
    "time/time_ref_source": str,
    "time/timesync_mode": str,
    "time/timesync_alpha_initial": float,
    "time/timesync_beta_initial": float,
    "time/timesync_alpha_final": float,
    "time/timesync_beta_final": float,
    "time/convergence_window": int,
    "time/max_rtt_sample": int,
    "time/max_deviation_sample": int,
    "time/max_consecutive_high_rtt": int,
    "time/max_consecutive_high_deviation": int,
    "sys/min_voltage": [float],
    "sys/disable_diag": bool,
    "cmd/use_comp_id_system_control": bool,
    "cmd/command_ack_timeout": float,
    "local_position/tf/send": bool,
    "global_position/tf/send": bool,
    "setpoint_position/mav_frame": str,
    "setpoint_position/tf/listen": bool,
}


def flat(document, above=""):
    for key, value in document.items():
        if isinstance(value, dict):
            yield from flat(value, f"{above}{key}/")
        else:
            yield above + key, value


def wrong(document):
    """Names that MAVROS does not read, or not of this type."""
    kinds = {
        k: [type(x) for x in v] or [None] if isinstance(v, list) else type(v)
        for k, v in flat(document)
    }
    return sorted(k for k, kind in kinds.items() if READ.get(k) != kind)


def test_all_that_is_given_is_read(root):
    assert wrong(yaml.safe_load((root / "config/mavros/ardupilot.yaml").read_text())) == []


@pytest.mark.parametrize(
    "document",
    [
        {"time": {"timesync_avg_alpha": 0.6}},
        {"sys": {"min_voltage": 10.0}},
        {"sys": {"min_voltage": []}},
        {"conn": {"timeout": "3"}},
    ],
)
def test_another_name_or_type_would_be_noticed(document):
    assert len(wrong(document)) == 1

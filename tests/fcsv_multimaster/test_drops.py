# SPDX-License-Identifier: Apache-2.0
"""What is dropped is counted every time and told seldom."""

import pytest

drops = pytest.importorskip("fcsv_multimaster.ros.drops")


class Health(dict):
    def value(self, key, number):
        self[key] = number


def test_every_reason_is_told_once_in_five_seconds_and_counted_always(monkeypatch):
    told, health, now_s = [], Health(), [0.0]
    monkeypatch.setattr(drops.rospy, "logwarn", lambda text, *values: told.append((now_s[0], text % values)))
    drop = drops.Drops(health, clock=lambda: now_s[0])
    for step in range(600):  # 50 a second for 12 seconds, of two kinds
        now_s[0] = step / 50
        drop("oversized message", "/large")
        if step % 2:
            drop("late message", "/late")
    assert [at_s for at_s, text in told if "oversized" in text] == [0.0, 5.0, 10.0]
    assert [at_s for at_s, text in told if "late" in text] == pytest.approx([0.02, 5.02, 10.02])
    assert told[-2][1] == "dropped: oversized message: /large (501 so far)"
    assert health == {"dropped: oversized message": 600, "dropped: late message": 300}

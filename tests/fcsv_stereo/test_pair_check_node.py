# SPDX-License-Identifier: Apache-2.0
"""Pairs of pictures as they come by radio, looked at by the node."""

import time

import numpy as np
import pytest
from support.radio_pictures import NAMES, RadioPictures
from support.waiting import within

pytestmark = pytest.mark.ros
until = within(40.0)


@pytest.mark.parametrize(
    "wrong", [{"vehicles": ["uav1"]}, {"rate_hz": 0.0}, {"most_share": float("nan")}]
)
def test_wrong_parameters_are_named(wrong):
    from fcsv_stereo.ros.pair_check_node import PairCheckParameters

    with pytest.raises(ValueError, match=next(iter(wrong))):
        PairCheckParameters(**{"vehicles": list(NAMES), **wrong})


def test_a_pair_is_looked_at_and_a_drift_is_told(ros_master, start_node):
    import rospy

    from fcsv_msgs.msg import PairLook

    start_node("fcsv_stereo", "pair_check", ns="p_check", params={"vehicles": list(NAMES)})
    radio, looks = RadioPictures(), []
    heard = rospy.Subscriber("/pair_check", PairLook, looks.append)
    try:
        until(lambda: radio.listened_to(NAMES) and heard.get_num_connections(), what="the node")
        stamp_s = time.time()
        radio.picture("l_two", stamp_s, jpeg=b"no jpeg at all")
        radio.picture("l_one", stamp_s)
        radio.frames()

        def next_look(name, than=lambda m: True):
            """At a pair, once it is ``than``; pictures until it comes, each a second later than the
            one before."""
            count, found = len(looks), []

            def came():
                sent.append(name)
                radio.picture("l_one", stamp_s + len(sent))
                radio.picture(name, stamp_s + len(sent) + 0.1)
                time.sleep(0.2)
                found.extend(m for m in looks[count:] if m.vehicle == name and than(m))
                return found

            until(came, what=f"a look at {name}")
            return found[0]

        sent = []
        for name in NAMES[1:]:
            calm = next_look(name)
            assert (
                (calm.reference, calm.off) == ("l_one", False)
                and calm.matches > 60
                and calm.agree > 50
            )
            assert calm.off_m < 0.4
        radio.off_m["l_three"] = np.array([0.0, 1.5, 0.0])
        drifted = next_look("l_three", than=lambda m: m.off)
        assert drifted.surprise > 12.0 and drifted.off_m == pytest.approx(1.5, abs=0.4)
    finally:
        heard.unregister()
        radio.close()

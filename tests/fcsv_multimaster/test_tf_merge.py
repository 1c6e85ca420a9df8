# SPDX-License-Identifier: Apache-2.0
"""/tf between machines: prefixes, listed frames, one merged latched message."""

import pytest
from geometry_msgs.msg import TransformStamped

from fcsv_multimaster.errors import WireError
from fcsv_multimaster.ros.tf_merge import TfIn, TfOut, read, write


def transform(parent, child, x=0.0):
    t = TransformStamped(child_frame_id=child)
    t.header.frame_id = parent
    t.transform.translation.x = x
    t.transform.rotation.w = 1.0
    return t


def test_listed_frames_leave_with_their_prefix_and_the_newest_wins():
    out = TfOut("uav1", ["uav1/arm"], static=False)
    out.add(write([transform("base_link", "arm", 1.0), transform("base_link", "secret")]))
    out.add(write([transform("base_link", "arm", 2.0), transform("home", "uav2/arm")]))
    (t,) = read(out.drain()).transforms
    assert (t.header.frame_id, t.child_frame_id, t.transform.translation.x) == (
        "uav1/base_link",
        "uav1/arm",
        2.0,
    )
    assert out.drain() is None


def test_static_transforms_of_all_peers_are_one_message():
    merged = TfIn(static=True)
    merged.merge(write([transform("uav1/base_link", "uav1/tag")]), ["uav1/tag"])
    both = merged.merge(
        write([transform("uav2/base_link", "uav2/tag"), transform("home", "uav1/odom")]),
        ["uav2/tag"],
    )
    # not another's frame
    assert [t.child_frame_id for t in read(both).transforms] == ["uav1/tag", "uav2/tag"]


def test_malformed_tf_is_an_error():
    with pytest.raises(WireError):
        TfIn(static=False).merge(b"\xff\xff\xff\xff", ["a"])

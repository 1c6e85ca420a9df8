# SPDX-License-Identifier: Apache-2.0
"""Bags whose content does not matter."""

import os

import genpy
import rosbag
from std_msgs.msg import String


def write_strings(path, close=True, messages=20, size=400_000):
    """A bag of ``size`` bytes; not closed, it is as a recorder that was killed leaves it."""
    bag = rosbag.Bag(str(path), "w", chunk_threshold=100_000)
    for i in range(messages):
        bag.write("/a", String(data=os.urandom(size // messages // 2).hex()), genpy.Time(100 + i))
    if close:
        bag.close()
    else:
        bag._file.flush()
        bag._file.close()

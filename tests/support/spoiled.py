# SPDX-License-Identifier: Apache-2.0
"""Bags of a session with single messages changed, as drivers, radios and disks spoil them."""

import rosbag
from sensor_msgs.msg import CompressedImage


def spoil(bag, topic_end, change):
    """Each message of the topics that end so becomes ``change(i, message)``: the message, or None
    to drop it."""
    with rosbag.Bag(str(bag)) as source:
        messages = [(topic, message, t) for topic, message, t in source.read_messages()]
    count = {}
    with rosbag.Bag(str(bag), "w") as target:
        for topic, message, t in messages:
            if topic.endswith(topic_end):
                i = count[topic] = count.get(topic, -1) + 1
                message = change(i, message)
            if message is not None:
                target.write(topic, message, t)
    return bag


def one(number, change):
    """Only message ``number`` is changed, in place."""

    def changed(i, message):
        if i == number:
            change(message)
        return message

    return changed


def every(change):
    """All are changed, in place."""

    def changed(_i, message):
        change(message)
        return message

    return changed


def retyped(bag, topic_end, new_end, convert):
    """Messages of one topic as those of another topic and type."""
    with rosbag.Bag(str(bag)) as source:
        messages = list(source.read_messages())
    with rosbag.Bag(str(bag), "w") as target:
        for topic, message, t in messages:
            if topic.endswith(topic_end):
                topic, message = topic[: -len(topic_end)] + new_end, convert(message)
            target.write(topic, message, t)
    return bag


def compressed(image, data, words):
    """A CompressedImage at the stamp of an Image."""
    return CompressedImage(header=image.header, format=words, data=data)

# SPDX-License-Identifier: Apache-2.0
"""What runs on the machines of the bench: sources and sinks; sinks write one JSON line per message.

probe.py source VEHICLE STATE_HZ        odometry with the time of sending, and an answer to every
command probe.py pictures VEHICLE HZ OCTETS     JPEGs of about that size probe.py sink FILE
VEHICLE...           {"topic", "sent", "came"} of odometry and pictures probe.py commander FILE
VEHICLE HZ      {"topic": "ack", "sent", "came"}: a command's way there and back probe.py fleet KEYS
CONTROL HZ SECONDS VEHICLE...   vehicles without ROS in one process, state only
"""

import json
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CompressedImage

from fcsv_msgs.msg import Command, CommandAck


def main() -> None:
    role, *arguments = sys.argv[1:]
    if role != "fleet":
        from fcsv_geometry.ros import node

        node.begin(role, anonymous=True)
    {"source": source, "pictures": pictures, "sink": sink, "commander": commander, "fleet": fleet}[
        role
    ](*arguments)


def source(vehicle: str, state_hz: str) -> None:
    acks = rospy.Publisher(f"/{vehicle}/command_ack", CommandAck, queue_size=20, tcp_nodelay=True)

    def answer(c: Command) -> None:
        acks.publish(CommandAck(vehicle=vehicle, sender=c.sender, number=c.number, header=c.header))

    rospy.Subscriber(f"/{vehicle}/command", Command, answer, queue_size=20, tcp_nodelay=True)
    print(json.dumps({"publishes_since": time.time()}), flush=True)
    states = rospy.Publisher(f"/{vehicle}/odometry/state", Odometry, queue_size=1, tcp_nodelay=True)
    for _ in steadily(float(state_hz)):
        states.publish(odometry(vehicle))


def pictures(vehicle: str, rate_hz: str, octets: str) -> None:
    publisher = rospy.Publisher(
        f"/{vehicle}/camera/color/image_raw/compressed", CompressedImage, queue_size=1
    )
    jpeg = jpeg_of(int(octets))
    for _ in steadily(float(rate_hz)):
        message = CompressedImage(format="jpeg", data=jpeg)
        message.header.stamp = rospy.Time.from_sec(time.time())
        publisher.publish(message)


def sink(path: str, *vehicles: str) -> None:
    with open(path, "a", buffering=1) as file:

        def note(message, name: str) -> None:
            line = {"topic": name, "sent": message.header.stamp.to_sec(), "came": time.time()}
            file.write(json.dumps(line) + "\n")

        for v in vehicles:
            rospy.Subscriber(
                f"/{v}/odometry/state", Odometry, note, "state", queue_size=50, tcp_nodelay=True
            )
            topic = f"/{v}/camera/color/image_raw/compressed"
            rospy.Subscriber(
                topic, CompressedImage, note, "picture", queue_size=2, buff_size=1 << 22
            )
        rospy.spin()


def commander(path: str, vehicle: str, rate_hz: str) -> None:
    sent, lock = {}, threading.Lock()
    with open(path, "a", buffering=1) as file:

        def note(ack: CommandAck) -> None:
            with lock:
                at_s = sent.pop(ack.number, None)
            if at_s is not None:
                file.write(json.dumps({"topic": "ack", "sent": at_s, "came": time.time()}) + "\n")

        rospy.Subscriber(
            f"/{vehicle}/command_ack", CommandAck, note, queue_size=50, tcp_nodelay=True
        )
        commands = rospy.Publisher(f"/{vehicle}/command", Command, queue_size=20, tcp_nodelay=True)
        for number in steadily(float(rate_hz)):
            if not commands.get_num_connections():
                continue
            with lock:
                sent[number] = time.time()
            file.write(json.dumps({"topic": "command", "sent": sent[number]}) + "\n")
            commands.publish(Command(vehicle=vehicle, sender="bench", number=number))


def fleet(keys: str, control: str, rate_hz: str, seconds: str, *vehicles: str) -> None:
    """Real exchanges with keys, each on ports of its own; only ROS is missing."""
    from machines import vehicle_ports

    from fcsv_multimaster.keys.keyring import open_keyring
    from fcsv_multimaster.links import load_links
    from fcsv_multimaster.network.endpoints import parse_endpoint
    from fcsv_multimaster.relay.exchange import Exchange
    from fcsv_multimaster.ros.pictures import serialized

    links = load_links(Path(__file__).with_name("links.yaml"))
    exchanges = [
        Exchange(
            v,
            links,
            parse_endpoint(f"0.0.0.0:{vehicle_ports(i)}"),
            {"control": parse_endpoint(control)},
            open_keyring(Path(keys) / v, v),
            lambda _p: None,
            print,
            lambda *_: None,
        )
        for i, v in enumerate(vehicles)
    ]
    until_s = time.monotonic() + float(seconds)
    # one after the other, as they are in life
    for number in steadily(float(rate_hz) * len(vehicles)):
        at = number % len(vehicles)
        v, m = vehicles[at], odometry(vehicles[at])
        exchanges[at].send(f"/{v}/odometry/state", m._type, m._md5sum, m._full_text, serialized(m))
        if time.monotonic() > until_s:
            break
    for exchange in exchanges:
        exchange.close()


def odometry(vehicle: str) -> Odometry:
    message = Odometry(child_frame_id=f"{vehicle}/base_link")
    message.header.frame_id = f"{vehicle}/odom"
    message.header.stamp = rospy.Time.from_sec(time.time())
    return message


def jpeg_of(octets: int) -> bytes:
    """A JPEG of noise over a gradient that is within a few per cent of a size."""
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 60, (480, 640, 3), dtype=np.uint8)
    gradient = np.linspace(0, 190, 640, dtype=np.uint8)[None, :, None]
    qualities = (
        cv2.imencode(".jpg", noise + gradient, [cv2.IMWRITE_JPEG_QUALITY, q])[1]
        for q in range(2, 96)
    )
    return min((d.tobytes() for d in qualities), key=lambda d: abs(len(d) - octets))


def steadily(rate_hz: float):
    """Numbers from 1 at a rate, until ROS ends."""
    number, next_s = 0, time.monotonic()
    while not rospy.is_shutdown():
        number += 1
        yield number
        next_s = max(next_s + 1.0 / rate_hz, time.monotonic() - 0.5)
        time.sleep(max(0.0, next_s - time.monotonic()))


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""The node that watches drivers: one that stops is reset, one that hangs is ended, and both are
told."""

import signal
import sys
import threading
import time

import pytest
from support.waiting import within

pytestmark = pytest.mark.ros
until = within(30.0)

HANGS = """
import rospy
from std_msgs.msg import String
from fcsv_geometry.ros import node
node.begin('driver')
p = rospy.Publisher('/w/hangs', String, queue_size=1)
while not rospy.is_shutdown():
    p.publish('x'); rospy.sleep(0.05)
"""


def test_drivers_that_stop_are_reset_or_ended_and_told(start_node, ros_master, tmp_path):
    import rospy
    from diagnostic_msgs.msg import DiagnosticArray
    from std_msgs.msg import String
    from std_srvs.srv import Empty, EmptyResponse

    for name, kind in (("2-1", "8086:0b07"), ("2-2", "8087:0b37")):
        (tmp_path / name).mkdir()
        for file, text in zip(("idVendor", "idProduct", "speed"), (*kind.split(":"), "5000")):
            (tmp_path / name / file).write_text(text)
    hangs = ros_master.run([sys.executable, "-c", HANGS, "__name:=w_driver"], "hanging-driver")
    speaks, over = threading.Event(), threading.Event()
    speaks.set()
    publisher = rospy.Publisher("/w/stops", String, queue_size=1)

    def speak():
        while not over.wait(0.02):
            if speaks.is_set():
                publisher.publish("x")

    thread = threading.Thread(target=speak)
    thread.start()
    resets = []
    service = rospy.Service(
        "/w/reset",
        Empty,
        lambda _: (resets.append(time.monotonic()), speaks.set()) and EmptyResponse(),
    )
    told = {}
    ear = rospy.Subscriber(
        "/diagnostics",
        DiagnosticArray,
        lambda m: told.update((s.name, (s.level, s.message)) for s in m.status),
    )
    said = lambda device, words: words in told.get(f"driver {device}", (0, ""))[1]  # noqa: E731
    try:
        start_node(
            "fcsv_tracking",
            "driver_watch",
            ns="w",
            params={
                "vehicle": "w",
                "usb": str(tmp_path),
                "devices": {
                    "odometry": {
                        "topic": "stops",
                        "least_hz": 10.0,
                        "silent_s": 0.6,
                        "starts_s": 6.0,
                        "reset": "reset",
                        "nodes": ["absent"],
                        "usb": ["8087:0b37"],
                    },
                    "camera": {
                        "topic": "/w/hangs",
                        "least_hz": 5.0,
                        "silent_s": 0.6,
                        "starts_s": 3.5,
                        "nodes": ["/w_driver"],
                        "usb": ["8086:0b07"],
                    },
                },
            },
        )
        until(
            lambda: all(said(d, "sends at") for d in ("odometry", "camera")),
            what="both drivers, in the diagnostics",
        )
        assert said("camera", "it shares USB bus 2 with odometry") and told["driver camera"][0] == 1
        hangs.signal(signal.SIGSTOP)
        speaks.clear()
        stopped_s = time.monotonic()
        until(lambda: resets, what="the reset")
        assert resets[0] - stopped_s < 3.0  # 0.6 s of silence, and a busy machine
        until(
            lambda: said("odometry", "it was silent 1 times, last remedy: the device is reset"),
            what="its recovery",
        )
        until(
            lambda: said("camera", "is silent for"), what="the one that hangs, in the diagnostics"
        )
        until(lambda: hangs.returncode is not None, what="the end of the one that hangs")
        assert hangs.returncode == -signal.SIGKILL and len(resets) == 1
    finally:
        over.set()
        thread.join()
        service.shutdown()
        ear.unregister()
        publisher.unregister()
        hangs.kill()

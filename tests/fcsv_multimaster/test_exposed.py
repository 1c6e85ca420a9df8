# SPDX-License-Identifier: Apache-2.0
"""A relay with keys beside a ROS that listens to the network, in a namespace without one."""

import os
import subprocess

import pytest
from support.waiting import within

from fcsv_multimaster.keys.keyring import make_fleet

pytestmark = [pytest.mark.ros, pytest.mark.slow]
until = within(60.0)


@pytest.fixture
def machine(tmp_path, bench_link):
    """A machine of its own namespace, whose loopback has a second address that looks like the
    radio's."""
    machines, _ = bench_link
    namespace = f"fcsv-open-{os.getpid()}"

    class Open(machines.NamespaceMachine):
        ros_ip = "127.0.0.1"

        @property
        def env(self):
            return dict(super().env, ROS_IP=self.ros_ip)

    try:
        for command in (
            ["add", namespace],
            ["exec", namespace, "ip", "link", "set", "lo", "up"],
            ["exec", namespace, "ip", "addr", "add", "10.77.0.9/32", "dev", "lo"],
        ):
            subprocess.run(["ip", "netns", *command], check=True)
        made = Open("uav1", tmp_path, namespace)
        try:
            yield made
        finally:
            made.stop()
    finally:
        subprocess.run(["ip", "netns", "del", namespace], capture_output=True)


def test_a_relay_with_keys_waits_until_ros_is_closed(machine, tmp_path, root):
    make_fleet(tmp_path / "keys", ["uav1"])

    def relay(log):
        return machine.run(
            [
                "rosrun",
                "fcsv_multimaster",
                "relay",
                "_machine:=uav1",
                "_listen:=127.0.0.1:7447",
                f"_links:={root}/config/links/default.yaml",
                f"_keys:={tmp_path}/keys/uav1",
            ],
            log,
        )

    machine.ros_ip = "10.77.0.9"
    machine.start_master()
    refused = relay("open")
    assert refused.wait(60.0) == 2
    assert (
        "the ROS master listens on 0.0.0.0:11311" in refused.tail()
        and "ROS_IP=127.0.0.1" in refused.tail()
    )
    machine.stop()

    machine.ros_ip = "127.0.0.1"
    machine.start_master()
    runs = relay("closed")  # rosout, which is roscpp, is open in a way that nobody can set
    ear = machine.python(
        """
        from diagnostic_msgs.msg import DiagnosticArray
        seen = set()
        def hear(m):
            for s in m.status:
                if s.name not in seen or s.level:
                    seen.add(s.name); print(s.name, s.level, s.message, flush=True)
        rospy.Subscriber('/diagnostics', DiagnosticArray, hear)
        rospy.spin()
    """,
        "ear",
    )
    until(lambda: "keys uav1 0 well" in ear.log.read_text(), what="the keys' diagnostics")
    machine.ros_ip = "10.77.0.9"
    machine.python("rospy.spin()", "guest")
    until(
        lambda: "announces itself as 10.77.0.9" in ear.log.read_text(),
        what="the guest, in the diagnostics",
    )
    assert runs.returncode is None  # said, not cut

# SPDX-License-Identifier: Apache-2.0
"""Real relays between real masters: what crosses, what does not, and what comes back by itself."""

import subprocess
import sys
import textwrap
import time

import psutil
import pytest
from support.waiting import within

from fcsv_sim.machines.machines import Machine, free_port

pytestmark = [pytest.mark.ros, pytest.mark.slow]
until = within(90.0)


class Net:
    """Two machines with a relay each."""

    def __init__(self, folder, root):
        self.links = root / "config/links/default.yaml"
        self.machines = {n: Machine(n, folder).start_master() for n in ("control", "uav1")}
        self.endpoints = {n: f"127.0.0.1:{free_port()}/{free_port()}" for n in self.machines}
        self.relays = {n: self.relay(n) for n in self.machines}

    def relay(self, name):
        peers = ",".join(f"{n}={e}" for n, e in self.endpoints.items() if n != name)
        return self.machines[name].run(
            ["rosrun", "fcsv_multimaster", "relay", f"_machine:={name}", f"_links:={self.links}",
             f"_listen:={self.endpoints[name]}", f"_peers:={peers}"], "relay",
        )  # fmt: skip

    def python(self, name, code):
        """A rospy script on a machine; it runs until the test ends."""
        path = self.machines[name].folder / f"script-{time.time()}.py"
        path.write_text("import rospy, sys, time\nrospy.init_node('t', anonymous=True)\n" + textwrap.dedent(code))
        return self.machines[name].run([sys.executable, str(path)], path.stem)

    def hears(self, name, topic, timeout_s=15.0):
        """The next message of a topic on a machine as text, or "" when none comes."""
        command = ["timeout", str(timeout_s), "rostopic", "echo", "-n", "1", topic]
        return subprocess.run(command, env=self.machines[name].env, capture_output=True, text=True).stdout

    def stop(self):
        for machine in self.machines.values():
            machine.stop()


@pytest.fixture
def net(tmp_path, root):
    net = Net(tmp_path, root)
    try:
        for name, relay in net.relays.items():
            until(lambda r=relay: "is there" in r.log.read_text() or r.returncode is not None, what=f"{name}'s peer")
            assert relay.returncode is None, f"{name}: {relay.tail()}"
        yield net
    finally:
        net.stop()


STATE = """
    from fcsv_msgs.msg import State
    p = rospy.Publisher('/uav1/mavros/state', State, queue_size=1)
    from std_msgs.msg import String
    q = rospy.Publisher('/uav1/secret', String, queue_size=1)
    while not rospy.is_shutdown():
        p.publish(State(mode='{mode}')); q.publish('x'); time.sleep(0.05)
"""
HOME = """
    from fcsv_msgs.msg import Home
    p = rospy.Publisher('/home', Home, queue_size=1, latch=True)
    p.publish(Home(reference='uav1')); rospy.spin()
"""


def test_listed_topics_cross_and_others_do_not(net):
    for relay in net.relays.values():  # what the threads before a cut left behind is used again by those after it
        assert psutil.Process(relay.pid).environ()["MALLOC_ARENA_MAX"] == "2"
    net.python("uav1", STATE.format(mode="GUIDED"))
    assert 'mode: "GUIDED"' in net.hears("control", "/uav1/mavros/state")
    assert net.hears("control", "/uav1/secret", 6.0) == ""


def test_latched_events_reach_who_comes_late_and_nothing_echoes(net):
    net.relays["uav1"].stop()
    net.python("control", HOME)
    time.sleep(1.0)
    net.relays["uav1"] = net.relay("uav1")
    assert "uav1" in net.hears("uav1", "/home")
    env = net.machines["control"].env
    count = subprocess.run(["rosnode", "list"], env=env, capture_output=True, text=True).stdout
    info = subprocess.run(["rostopic", "info", "/home"], env=env, capture_output=True, text=True)
    assert "relay" in count and info.stdout.split("Subscribers")[0].count("*") == 1  # only the one who publishes it


def test_commands_from_before_the_link_reach_who_waits_for_them_in_order_and_once(net, tmp_path):
    heard = tmp_path / "heard"
    net.links = tmp_path / "links.yaml"
    net.links.write_text("""
classes: {critical: {link: datagram, priority: real_time, reliable: true, max_age_s: 30.0}}
to_vehicle: [{topic: "/{vehicle}/command", class: critical}]
""")
    for name in ("control", "uav1"):
        net.relays[name].stop()
    net.python("uav1", f"""
        from fcsv_msgs.msg import Command
        f = open({str(heard)!r}, 'a', buffering=1)
        rospy.Subscriber('/uav1/command', Command, lambda c: f.write('%d\\n' % c.number), queue_size=1000)
        rospy.spin()
    """)  # fmt: skip
    net.relays["control"] = net.relay("control")
    net.python("control", """
        from fcsv_msgs.msg import Command
        p = rospy.Publisher('/uav1/command', Command, queue_size=1000)
        while not p.get_num_connections(): time.sleep(0.02)  # the relay beside it
        for n in range(200):
            p.publish(Command(vehicle='uav1', number=n)); time.sleep(0.05)
        rospy.spin()
    """)  # fmt: skip
    time.sleep(3.0)
    net.relays["uav1"] = net.relay("uav1")
    until(lambda: heard.exists() and "199\n" in heard.read_text(), what="the last command")
    assert heard.read_text().split() == [str(n) for n in range(200)]


def test_a_restarted_master_is_told_again(net):
    net.python("uav1", STATE.format(mode="LOITER"))
    assert "LOITER" in net.hears("control", "/uav1/mavros/state")
    net.machines["uav1"].kill_master()
    time.sleep(1.0)
    net.machines["uav1"].start_master()
    net.python("uav1", STATE.format(mode="BRAKE"))  # the old publisher is lost with its master, a new one comes
    until(lambda: "BRAKE" in net.hears("control", "/uav1/mavros/state"), what="the state of who came after the restart")
    assert net.relays["uav1"].returncode is None


def test_another_version_of_a_message_is_named_and_dropped(net):
    net.python("uav1", """
        from std_msgs.msg import String
        class State(String):
            _type = 'fcsv_msgs/State'; _md5sum = 'f' * 32
        p = rospy.Publisher('/uav1/mavros/state', State, queue_size=1)
        while not rospy.is_shutdown():
            p.publish(State('x')); time.sleep(0.05)
    """)  # fmt: skip
    until(lambda: "another" in net.relays["control"].log.read_text(), what="a line that names the version")
    assert net.hears("control", "/uav1/mavros/state", 6.0) == ""


def test_a_wrong_links_file_ends_the_relay_with_one_line(net, tmp_path):
    net.relays["control"].stop()
    net.links = tmp_path / "links.yaml"
    net.links.write_text("classes: {}\nto_control: [{topic: /x, class: nope}]")
    relay = net.relay("control")
    assert relay.wait(60.0) == 2 and "to_control[0].class" in relay.log.read_text()

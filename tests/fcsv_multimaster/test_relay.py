# SPDX-License-Identifier: Apache-2.0
"""Real relays between real masters: what crosses, what does not, and what comes back by itself.

The masters are started once for the module; a test that ends a relay begins another.
"""

import subprocess
import sys
import textwrap
import time
import xmlrpc.client

import psutil
import pytest
import yaml
from support.waiting import within

from fcsv_sim.machines.machines import Machine, free_port

pytestmark = [pytest.mark.ros, pytest.mark.slow]
until = within(90.0)


class Net:
    """Two machines with a relay each."""

    def __init__(self, folder, root):
        self.default_links = root / "config/links/default.yaml"
        self.machines = {n: Machine(n, folder).start_master() for n in ("control", "uav1")}
        self.endpoints = {n: f"127.0.0.1:{free_port()}/{free_port()}" for n in self.machines}
        self.scripts, self.relays, self.count = [], {}, 0
        for name in self.machines:
            self.start_relay(name)

    def relay(self, name, links, node="relay"):
        peers = ",".join(f"{n}={e}" for n, e in self.endpoints.items() if n != name)
        self.count += 1
        return self.machines[name].run(
            [
                "rosrun",
                "fcsv_multimaster",
                "relay",
                f"__name:={node}",
                f"_machine:={name}",
                f"_links:={links}",
                f"_listen:={self.endpoints[name]}",
                f"_peers:={peers}",
            ],
            f"relay-{self.count}",
        )

    def start_relay(self, name, links=None):
        """The relay of a machine, in place of the one that ran there."""
        if name in self.relays:
            self.relays[name].stop()
        self.relays[name] = self.relay(name, links or self.default_links)

    def wait_for_relays(self):
        for name, relay in self.relays.items():
            until(
                lambda r=relay: "is there" in r.log.read_text() or r.returncode is not None,
                what=f"{name}'s peer",
            )
            assert relay.returncode is None, f"{name}: {relay.tail()}"

    def python(self, name, code):
        """A rospy script on a machine; it runs until the test ends."""
        path = self.machines[name].folder / f"script-{time.time()}.py"
        path.write_text(
            "import rospy, sys, time\nfrom fcsv_geometry.ros import node\nnode.begin('t', anonymous=True)\n"
            + textwrap.dedent(code)
        )
        self.scripts.append(self.machines[name].run([sys.executable, str(path)], path.stem))

    def hears(self, name, topic, timeout_s=15.0):
        """The next message of a topic on a machine as text, or "" when none comes."""
        command = [
            "timeout",
            "--kill-after",
            "2",
            str(timeout_s),
            "rostopic",
            "echo",
            "-n",
            "1",
            topic,
        ]
        return subprocess.run(
            command, env=self.machines[name].env, capture_output=True, text=True
        ).stdout

    def publishers(self, name, topic):
        """Nodes that publish a topic, as the master of a machine knows them."""
        published = xmlrpc.client.ServerProxy(self.machines[name].master_uri).getSystemState(
            "/test"
        )[2][0]
        return dict(published).get(topic, [])

    def end_scripts(self):
        for process in self.scripts:
            process.signal(2)
        for process in self.scripts:
            process.stop(grace_s=5.0)
        self.scripts.clear()

    def stop(self):
        for machine in self.machines.values():
            machine.stop()


@pytest.fixture(scope="module")
def machines(tmp_path_factory, root):
    net = Net(tmp_path_factory.mktemp("relays"), root)
    try:
        yield net
    finally:
        net.stop()


@pytest.fixture
def net(machines):
    machines.wait_for_relays()
    yield machines
    machines.end_scripts()


STATE = """
    from mavros_msgs.msg import State
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
    # what the threads before a cut left behind is used again by those after it
    for relay in net.relays.values():
        assert psutil.Process(relay.pid).environ()["MALLOC_ARENA_MAX"] == "2"
    net.python("uav1", STATE.format(mode="GUIDED"))
    assert 'mode: "GUIDED"' in net.hears("control", "/uav1/mavros/state")
    assert net.publishers("uav1", "/uav1/secret") and net.publishers(
        "control", "/uav1/mavros/state"
    ) == ["/relay"]
    assert (
        net.publishers("control", "/uav1/secret") == []
        and net.hears("control", "/uav1/secret", 4.0) == ""
    )


def test_those_here_are_told_when_what_crossed_was_sent(net):
    net.python("uav1", STATE.format(mode="LAND"))
    began_s = time.monotonic()
    until(lambda: 'mode: "LAND"' in net.hears("control", "/uav1/mavros/state"), what="the state")
    told = next(yaml.safe_load_all(net.hears("control", "/relay/ages")))
    sent_s = dict(zip(told["topics"], told["sent_s"]))
    assert (
        list(sent_s) == ["/uav1/mavros/state"]
        and began_s < sent_s["/uav1/mavros/state"] < time.monotonic()
    )


def test_another_version_of_a_message_is_named_and_dropped(net):
    net.python(
        "uav1",
        """
        from std_msgs.msg import String
        class RecorderStatus(String):
            _type = 'fcsv_msgs/RecorderStatus'; _md5sum = 'f' * 32
        p = rospy.Publisher('/uav1/recorder/status', RecorderStatus, queue_size=1)
        while not rospy.is_shutdown():
            p.publish(RecorderStatus('x')); time.sleep(0.05)
    """,
    )
    until(
        lambda: "another" in net.relays["control"].log.read_text(),
        what="a line that names the version",
    )
    assert net.publishers("control", "/uav1/recorder/status") == []
    assert net.hears("control", "/uav1/recorder/status", 4.0) == ""


def test_a_wrong_links_file_ends_the_relay_with_one_line(net, tmp_path):
    links = tmp_path / "links.yaml"
    links.write_text("classes: {}\nto_control: [{topic: /x, class: nope}]")
    relay = net.relay("control", links, node="wrong")
    assert relay.wait(60.0) == 2 and "to_control[0].class" in relay.log.read_text()


def test_latched_events_reach_who_comes_late_and_nothing_echoes(net):
    net.relays["uav1"].stop()
    net.python("control", HOME)
    until(lambda: net.publishers("control", "/home"), what="who sets home")
    net.start_relay("uav1")
    assert "uav1" in net.hears("uav1", "/home", 30.0)
    env = net.machines["control"].env
    count = subprocess.run(["rosnode", "list"], env=env, capture_output=True, text=True).stdout
    info = subprocess.run(["rostopic", "info", "/home"], env=env, capture_output=True, text=True)
    # only the one who publishes it
    assert "relay" in count and info.stdout.split("Subscribers")[0].count("*") == 1


def test_a_restarted_master_is_told_again(net):
    net.python("uav1", STATE.format(mode="LOITER"))
    until(lambda: "LOITER" in net.hears("control", "/uav1/mavros/state"), what="the state")
    net.machines["uav1"].kill_master()
    until(
        lambda: "master does not answer" in net.relays["uav1"].log.read_text(),
        what="the relay's word about it",
    )
    net.machines["uav1"].start_master()
    # the old publisher is lost with its master, a new one comes
    net.python("uav1", STATE.format(mode="BRAKE"))
    until(
        lambda: "BRAKE" in net.hears("control", "/uav1/mavros/state"),
        what="the state of who came after the restart",
    )
    assert net.relays["uav1"].returncode is None


def test_commands_from_before_the_link_reach_who_waits_for_them_in_order_and_once(net, tmp_path):
    heard, said, links = tmp_path / "heard", tmp_path / "said", tmp_path / "links.yaml"
    links.write_text("""
classes: {critical: {link: datagram, priority: real_time, reliable: true, max_age_s: 30.0}}
to_vehicle: [{topic: "/{vehicle}/command", class: critical}]
""")
    net.relays["uav1"].stop()
    net.python(
        "uav1",
        f"""
        from fcsv_msgs.msg import Command
        f = open({str(heard)!r}, 'a', buffering=1)
        rospy.Subscriber('/uav1/command', Command, lambda c: f.write('%d\\n' % c.number), queue_size=1000)
        rospy.spin()
    """,
    )
    net.start_relay("control", links)
    net.python(
        "control",
        f"""
        from fcsv_msgs.msg import Command
        f = open({str(said)!r}, 'a', buffering=1)
        p = rospy.Publisher('/uav1/command', Command, queue_size=1000)
        while not p.get_num_connections(): time.sleep(0.02)  # the relay beside it
        for n in range(200):
            p.publish(Command(vehicle='uav1', number=n)); f.write('+\\n'); time.sleep(0.03)
        rospy.spin()
    """,
    )
    until(lambda: said.exists() and said.stat().st_size > 60, what="commands before the link")
    net.start_relay("uav1", links)
    until(lambda: heard.exists() and "199\n" in heard.read_text(), what="the last command")
    assert heard.read_text().split() == [str(n) for n in range(200)]

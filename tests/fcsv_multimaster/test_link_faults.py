# SPDX-License-Identifier: Apache-2.0
"""Relays with keys in network namespaces, over a radio that fails in every way it can."""

import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import time
import xmlrpc.client
from pathlib import Path

import numpy as np
import psutil
import pytest
from support.waiting import within

pytestmark = [pytest.mark.ros, pytest.mark.slow]
until = within(30.0)

LINKS = """
classes:
  critical: {link: datagram, priority: real_time, reliable: true, max_age_s: 5.0}
  state: {link: datagram, priority: interactive_high, reliable: false, max_age_s: 1.0, rate_hz: 50.0, max_bytes: 8000}
  events: {link: urgent, priority: data_high, reliable: true, latched: true}
  captures: {link: bulk, priority: data, reliable: true, max_age_s: 30.0}
  bulk: {link: bulk, priority: background, reliable: false, max_age_s: 3.0}
to_control:
  - {topic: "/{vehicle}/text", class: state}
  - {topic: "/{vehicle}/command_ack", class: critical}
  - {topic: "/{vehicle}/capture", class: captures}
  - {topic: "/{vehicle}/image", class: bulk, codec: h264}
  - {topic: /tf, class: state, frames: ["{vehicle}/arm"]}
to_vehicle:
  - {topic: "/{vehicle}/command", class: critical}
to_all_vehicles:
  - {topic: /home, class: events}
  - {topic: /tf, class: state, frames: [mocap]}
"""
TALK = """
    from std_msgs.msg import String
    p = rospy.Publisher('/uav1/text', String, queue_size=1)
    n = 0
    while not rospy.is_shutdown():
        n += 1; p.publish('%d' % n{extra}); time.sleep(0.02)
"""


@pytest.fixture
def make(tmp_path, bench_link):
    machines, radio = bench_link
    nets = []

    def make_net(**arguments):
        links = tmp_path / "links.yaml"
        links.write_text(LINKS)
        nets.append(
            machines.Net(tmp_path, links, conditions=radio.Conditions(**arguments.pop("conditions", {})), **arguments)
        )
        return nets[-1]

    yield make_net
    for net in nets:
        net.stop()


AGE_LIMIT_S = 5.0  # of commands, in the list above


class Ear:
    """A subscriber in a process of its own on a machine; what it hears, as (time, what ``expression`` makes of it)."""

    def __init__(self, net, machine, topic, kind, expression="m.data"):
        self._path = net.machines[machine].folder / f"ear-{time.time()}.jsonl"
        package, name = kind.split("/")
        net.machines[machine].python(f"""
            import json
            from {package}.msg import {name}
            f = open({str(self._path)!r}, 'a', buffering=1)
            def hear(m): f.write(json.dumps([time.time(), {expression}]) + '\\n')
            rospy.Subscriber({topic!r}, {name}, hear, queue_size=100, buff_size=1 << 24)
            rospy.spin()
        """)  # fmt: skip

    def heard(self, since_s=0.0):
        lines = self._path.read_text().splitlines() if self._path.exists() else []
        return [h for h in map(json.loads, lines) if h[0] >= since_s]

    def wait(self, since_s=0.0, timeout_s=10.0, until=lambda value: True):
        """Seconds from ``since_s`` to the first that fits; fails when none comes."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            for at_s, value in self.heard(since_s):
                if until(value):
                    return at_s - since_s
            time.sleep(0.05)
        raise AssertionError(f"nothing that fits in {timeout_s} s; last: {self.heard()[-2:]}")


def status_of(net, machine):
    """What link_status prints there."""
    machine = net.machines[machine]
    command = ["ip", "netns", "exec", machine.namespace, "rosrun", "fcsv_multimaster", "link_status"]
    return subprocess.run(command, env=machine.env, capture_output=True, text=True).stdout


def log(net, machine):
    return net.relays[machine].log.read_text(errors="replace")


def test_cuts_one_way_links_and_new_addresses_are_got_over(make):
    net = make()
    net.machines["uav1"].python(TALK.format(extra=""))
    ear = Ear(net, "control", "/uav1/text", "std_msgs/String")
    ear.wait(timeout_s=30.0)
    time.sleep(2.0)
    for cut in ([], [("control", "uav1")], [("uav1", "control")]):
        net.radio.cut(*cut)
        time.sleep(5.0)
        net.radio.mend()
        mended_s = time.time()
        assert ear.wait(mended_s) <= 2.0  # the bound
        time.sleep(1.5)
    net.radio.move("uav1", "10.77.0.77")  # it finds the control PC from there; nobody tells the control PC
    moved_s = time.time()
    ear.wait(moved_s, timeout_s=15.0)
    assert "is gone" in log(net, "control")


def test_peers_without_addresses_are_found_and_found_again(make):
    net = make()
    for relay in net.relays.values():
        relay.stop()
    for name, peer in (("control", "uav1"), ("uav1", "control")):
        net.start_relay(name, peers=peer, discovery=True)
    net.machines["uav1"].python(TALK.format(extra=""))
    ear = Ear(net, "control", "/uav1/text", "std_msgs/String")
    ear.wait(timeout_s=30.0)
    net.radio.cut()
    time.sleep(5.0)
    net.radio.mend()
    ear.wait(time.time(), timeout_s=15.0)
    net.relays["uav1"].stop()
    net.radio.move("uav1", "10.77.0.77")  # a machine that comes back elsewhere
    net.start_relay("uav1", peers="control", discovery=True)
    ear.wait(time.time(), timeout_s=30.0)
    time.sleep(2.0)
    for name, address in (("uav1", "10.77.0.88"), ("control", "10.77.0.99")):  # one that gets another while it runs
        net.radio.move(name, address)
        moved_s = time.time()
        ear.wait(moved_s + 1.5, timeout_s=30.0)  # what was under way has come by then
        assert "its addresses are others now" in log(net, name)


def test_a_clock_that_steps_neither_drops_nor_delays_and_is_named(make, tmp_path):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("needs a C compiler (cc) for the library that steps the clock of single processes")
    source, library, clock = Path(__file__).with_name("step_clock.c"), tmp_path / "step_clock.so", tmp_path / "clock"
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-Wall", "-Werror", source, "-o", library, "-ldl"], check=True)
    clock.write_bytes(struct.pack("q", 0))
    net = make()
    net.relays["uav1"].stop()
    net.machines["uav1"].prefix = ["env", f"LD_PRELOAD={library}", f"STEP_CLOCK_FILE={clock}"]
    net.start_relay("uav1")
    talk = """
        from std_msgs.msg import String
        p = rospy.Publisher('{topic}', String, queue_size=10)
        n = 0
        while not rospy.is_shutdown():
            n += 1; p.publish('%d %f %f' % (n, time.monotonic(), time.time())); time.sleep(0.05)
    """
    net.machines["uav1"].python(talk.format(topic="/uav1/text"))
    net.machines["control"].python(talk.format(topic="/uav1/command"))
    age = "[int(m.data.split()[0]), time.monotonic() - float(m.data.split()[1]), float(m.data.split()[2]), time.time()]"
    states = Ear(net, "control", "/uav1/text", "std_msgs/String", age)
    commands = Ear(net, "uav1", "/uav1/command", "std_msgs/String", age)
    states.wait(timeout_s=30.0)
    commands.wait(timeout_s=30.0)
    time.sleep(3.0)
    came = len(states.heard()), len(commands.heard())
    for offset_s in (3600, -86400, 0):
        with open(clock, "r+b") as file:
            file.write(struct.pack("q", offset_s))
        time.sleep(4.0)
        ahead_s = np.subtract(*states.heard()[-1][1][2:])  # the vehicle's time of day against ours
        assert ahead_s == pytest.approx(offset_s, abs=1.0), "the step did not take place"
        shown = status_of(net, "control")
        assert (f"the clocks differ by {abs(offset_s)}.0 s" in shown) == bool(offset_s), shown
    for ear, before in zip((states, commands), came):
        lines = [value for _, value in ear.heard()][before:]
        numbers = [v[0] for v in lines]
        assert len(numbers) > 200 and numbers == list(range(numbers[0], numbers[0] + len(numbers)))  # none dropped
        assert np.percentile([v[1] for v in lines], 99) < 0.5  # an hour late, had anybody looked at the time of day
    assert "the clock of uav1 is +3600.0 s off" in log(net, "control")


def test_lost_doubled_and_reordered_packets_leave_order_and_commands_whole(make):
    net = make(conditions={"loss": 0.05, "delay_s": 0.005, "jitter_s": 0.03, "duplicate": 0.2})
    net.machines["uav1"].python(TALK.format(extra=""))
    net.machines["uav1"].python("""
        from std_msgs.msg import String
        p = rospy.Publisher('/uav1/command_ack', String, queue_size=50)
        for _ in range(60):
            p.publish('-1'); time.sleep(0.2)  # until the other machine's subscriber has found the new topic
        for n in range(200):
            p.publish(str(n)); time.sleep(0.02)
        rospy.spin()
    """)
    states = Ear(net, "control", "/uav1/text", "std_msgs/String", "int(m.data)")
    acks = Ear(net, "control", "/uav1/command_ack", "std_msgs/String", "int(m.data)")
    acks.wait(timeout_s=60.0, until=lambda n: n == 199)
    time.sleep(1.0)
    numbers = [n for _, n in states.heard()]
    assert len(numbers) > 100 and numbers == sorted(set(numbers))  # newest wins: none twice, none backwards
    got = [n for _, n in acks.heard() if n >= 0]
    assert len(got) == len(set(got)) and set(range(200)) <= set(got)  # every one, once


def test_commands_that_fell_into_a_cut_come_after_it_in_order_and_once(make):
    net = make(conditions={"loss": 0.05, "delay_s": 0.01})
    commands = Ear(net, "uav1", "/uav1/command", "std_msgs/String", "int(m.data)")
    net.machines["control"].python("""
        from std_msgs.msg import String
        p = rospy.Publisher('/uav1/command', String, queue_size=50)
        while not p.get_num_connections(): time.sleep(0.02)
        n = 0
        while not rospy.is_shutdown():
            p.publish(str(n)); n += 1; time.sleep(0.1)
    """)
    commands.wait(timeout_s=30.0)
    time.sleep(2.0)
    net.radio.cut()
    time.sleep(3.0)
    begin_s, begin = commands.heard()[-1]
    net.radio.mend()
    commands.wait(until=lambda n: n > begin + 60)
    got = [n for _, n in commands.heard()]
    since = got[got.index(begin) :]
    after_s, after = next((at_s, n) for at_s, n in commands.heard() if n > begin)
    assert len(got) == len(set(got)) and set(since) >= set(range(after, begin + 60))  # all that came in time, once
    assert since[1:21] == list(range(after, after + 20))  # 3 s of cut were 30 commands
    dropped = after - begin - 1  # a busy machine finds its peers late: what is too old by then is not executed
    assert dropped <= max(0.0, after_s - begin_s - AGE_LIMIT_S) * 10 + 1


def test_pictures_cut_in_the_middle_come_whole_and_codecs_keep_the_type(make):
    net = make(conditions={"rate_bit_s": 4e6})
    net.machines["uav1"].python("""
        from std_msgs.msg import UInt8MultiArray
        from sensor_msgs.msg import Image
        import zlib, os
        p = rospy.Publisher('/uav1/capture', UInt8MultiArray, queue_size=10)
        q = rospy.Publisher('/uav1/image', Image, queue_size=1)
        row = bytes(range(0, 240, 3)) * 4
        for n in range(10000):
            if rospy.is_shutdown(): break
            if n % 10 == 0:
                body = os.urandom(200000)
                p.publish(UInt8MultiArray(data=zlib.crc32(body).to_bytes(4, 'little') + body))
            i = Image(height=80, width=80, encoding='rgb8', step=240, data=(row[:240]) * 80)
            i.header.frame_id = 'uav1/camera_optical'; i.header.stamp = rospy.Time(1000 + n)
            q.publish(i); time.sleep(0.1)
    """)
    whole = "__import__('zlib').crc32(m.data[4:]) == int.from_bytes(m.data[:4], 'little')"
    captures = Ear(net, "control", "/uav1/capture", "std_msgs/UInt8MultiArray", whole)
    images = Ear(net, "control", "/uav1/image", "sensor_msgs/Image",
                 "[m.header.stamp.secs, m.header.frame_id, m.encoding, m.width, len(m.data)]")  # fmt: skip
    captures.wait(timeout_s=30.0)
    images.wait(timeout_s=10.0)
    for _ in range(3):
        time.sleep(1.3)  # a capture takes 0.4 s of this link: one is under way now and then
        net.radio.cut()
        time.sleep(4.0)
        net.radio.mend()
    mended_s = time.time()
    captures.wait(mended_s)
    images.wait(mended_s)
    assert all(ok for _, ok in captures.heard())
    stamps = [v[0] for _, v in images.heard()]
    assert stamps == sorted(set(stamps)) and {tuple(v[1:]) for _, v in images.heard()} == {
        ("uav1/camera_optical", "rgb8", 80, 19200)
    }


def test_full_send_buffers_hold_up_neither_state_nor_commands(make):
    """Sixteen times as many pictures as the link carries: a megabit a second, with a tenth of a second of queue."""
    net = make(conditions={"rate_bit_s": 1e6, "delay_s": 0.005})
    net.machines["uav1"].python(TALK.format(extra=" + ' %f' % time.time()"))
    net.machines["uav1"].python("""
        from std_msgs.msg import String, UInt8MultiArray
        import os
        p = rospy.Publisher('/uav1/capture', UInt8MultiArray, queue_size=10)
        q = rospy.Publisher('/uav1/command_ack', String, queue_size=50)
        while not rospy.is_shutdown():
            p.publish(UInt8MultiArray(data=os.urandom(200000)))
            q.publish('0 %f' % time.time()); time.sleep(0.1)
    """)
    age = "time.time() - float(m.data.split()[1])"
    states = Ear(net, "control", "/uav1/text", "std_msgs/String", age)
    acks = Ear(net, "control", "/uav1/command_ack", "std_msgs/String", age)
    captures = Ear(net, "control", "/uav1/capture", "std_msgs/UInt8MultiArray", "len(m.data)")
    captures.wait(timeout_s=40.0)
    full_s = time.time()
    time.sleep(12.0)
    ages = [a for _, a in states.heard(full_s)]
    assert len(ages) > 10 * 12 and np.percentile(ages, 99) < 0.5
    assert len(acks.heard(full_s)) > 5 * 12 and np.percentile([a for _, a in acks.heard(full_s)], 99) < 1.0
    assert all(n == 200000 for _, n in captures.heard())


def test_strangers_get_nothing_and_a_twin_is_named(make, tmp_path, bench_link):
    machines, _ = bench_link
    net = make(names=("control", "uav1", "stranger", "twin"), masters=("control", "uav1"))
    for name in ("stranger", "twin"):
        machine = machines.NamespaceMachine(name, tmp_path, net.radio.namespace(name)).start_master()
        net.machines[name] = machine
    machines.make_fleet(tmp_path / "foreign", ["control", "uav1"])
    shutil.rmtree(net.keys / "stranger")
    shutil.copytree(tmp_path / "foreign/uav1", net.keys / "stranger")
    shutil.rmtree(net.keys / "twin")
    shutil.copytree(net.keys / "uav1", net.keys / "twin")
    net.machines["uav1"].python(TALK.format(extra=" + ' true'"))
    ear = Ear(net, "control", "/uav1/text", "std_msgs/String")
    ear.wait(timeout_s=30.0)
    peer = f"control={net.radio.addresses['control']}:7447"
    for name in ("stranger", "twin"):
        net.machines[name].python(TALK.format(extra=f" + ' {name}'"))
        command = ["rosrun", "fcsv_multimaster", "relay", "_machine:=uav1", f"_links:={net.links}",
                   "_listen:=0.0.0.0:7447", f"_peers:={peer}", f"_keys:={net.keys / name}"]  # fmt: skip
        net.relays[name] = net.machines[name].run(command, "relay")
    net.machines["control"].python("""
        from std_msgs.msg import String
        p = rospy.Publisher('/home', String, queue_size=1, latch=True); p.publish('secret'); rospy.spin()
    """)
    outsider = Ear(net, "stranger", "/home", "std_msgs/String")
    insider = Ear(net, "uav1", "/home", "std_msgs/String")
    insider.wait(timeout_s=15.0)
    time.sleep(8.0)
    assert outsider.heard() == []
    assert {v.split()[1] for _, v in ear.heard()} == {"true"}
    assert "another relay calls itself uav1" in log(net, "control")


def test_what_is_wrong_with_messages_costs_one_line(make):
    net = make()
    net.machines["uav1"].python(TALK.format(extra=" + 'x' * 9000"))
    until(lambda: "oversized" in log(net, "uav1"), what="a line that names the oversized message")
    time.sleep(6.0)
    lines = [line for line in log(net, "uav1").splitlines() if "oversized" in line]
    assert 1 <= len(lines) <= 2  # one in five seconds
    ear = Ear(net, "control", "/uav1/text", "std_msgs/Int32")
    changed = net.machines["uav1"].python("""
        from std_msgs.msg import String, Int32
        p = rospy.Publisher('/uav1/text', String, queue_size=1)
        until = time.time() + 4
        while time.time() < until: p.publish('x'); time.sleep(0.05)
        p.unregister(); time.sleep(3)
        p = rospy.Publisher('/uav1/text', Int32, queue_size=1)
        while not rospy.is_shutdown(): p.publish(5); time.sleep(0.05)
    """)
    ear.wait(timeout_s=25.0, until=lambda n: n == 5)
    assert changed.returncode is None and "is std_msgs/Int32 now" in log(net, "control")


def test_tf_is_merged_with_prefixes_and_nothing_comes_back(make):
    net = make()
    send = """
        from tf2_msgs.msg import TFMessage
        from geometry_msgs.msg import TransformStamped
        p = rospy.Publisher('/tf', TFMessage, queue_size=1)
        while not rospy.is_shutdown():
            ts = []
            for parent, child in {pairs}:
                t = TransformStamped(child_frame_id=child); t.header.frame_id = parent
                t.header.stamp = rospy.Time.now(); ts.append(t)
            p.publish(ts); time.sleep(0.02)
    """
    net.machines["uav1"].python(send.format(pairs="[('base_link', 'arm'), ('home', 'uav1/odom')]"))
    net.machines["control"].python(send.format(pairs="[('home', 'mocap')]"))
    pairs = "[[t.header.frame_id, t.child_frame_id] for t in m.transforms]"
    ears = {n: Ear(net, n, "/tf", "tf2_msgs/TFMessage", pairs) for n in ("control", "uav1")}
    ears["control"].wait(timeout_s=30.0, until=lambda v: v == [["uav1/base_link", "uav1/arm"]])
    ears["uav1"].wait(timeout_s=10.0, until=lambda v: v == [["home", "mocap"]])
    time.sleep(4.0)
    since_s = time.time() - 2.0
    came = [v for _, v in ears["control"].heard(since_s) if v == [["uav1/base_link", "uav1/arm"]]]
    assert 10 <= len(came) <= 24  # 10 Hz for two seconds: no echo doubles them
    assert not [v for _, v in ears["uav1"].heard() if ["uav1/base_link", "uav1/arm"] in v]


def test_a_hung_master_stops_nothing_and_ten_thousand_topics_cost_nothing(make):
    net = make()
    uav1 = net.machines["uav1"]
    net.machines["uav1"].python(TALK.format(extra=""))
    ear = Ear(net, "control", "/uav1/text", "std_msgs/String")
    ear.wait(timeout_s=30.0)
    masters = [
        p for p in psutil.Process(uav1.core.pid).children(recursive=True) if "rosmaster" in " ".join(p.cmdline())
    ]
    assert masters
    for p in masters:
        p.send_signal(signal.SIGSTOP)
    try:
        time.sleep(5.0)
        hung_s = time.time()
        assert ear.wait(hung_s) < 0.5
    finally:
        for p in masters:
            p.send_signal(signal.SIGCONT)

    def register():
        master = xmlrpc.client.ServerProxy(uav1.master_uri)
        for n in range(10000):
            master.registerPublisher("/crowd", f"/crowd/t{n}", "std_msgs/String", "http://127.0.0.1:1")

    from radio import in_namespace

    in_namespace(uav1.namespace, register)
    relay = psutil.Process(net.relays["uav1"].pid)
    before = sum(relay.cpu_times()[:2])
    time.sleep(5.0)
    assert sum(relay.cpu_times()[:2]) - before < 0.15 * 5  # 50 messages a second cost about 3 % of a core
    assert ear.wait(time.time()) < 0.5
    fresh = Ear(net, "uav1", "/home", "std_msgs/String")
    net.machines["control"].python("""
        from std_msgs.msg import String
        p = rospy.Publisher('/home', String, queue_size=1, latch=True); p.publish('h'); rospy.spin()
    """)
    fresh.wait(timeout_s=15.0)


def test_odometry_reaches_the_autopilot_with_everything_else_frozen(tmp_path):
    """Frozen, not killed, as roslaunch would start the killed again; the master, too."""
    from fcsv_sim.machines.machines import Machine, free_port

    port = free_port()
    with Machine("uav1", tmp_path) as machine:
        machine.launch("fcsv_bringup", "uav.launch", uav="uav1", sim=True, sim_dir=tmp_path / "sim",
                       record_dir=tmp_path / "session", listen=f"127.0.0.1:{free_port()}/{free_port()}",
                       fcu_url=f"udpin:127.0.0.1:{port}", sim_mavlink_port=port, sim_rc_port=free_port())  # fmt: skip
        out = tmp_path / "heard.jsonl"
        script = tmp_path / "ear.py"
        script.write_text(f"""
import rospy, json, time
from geometry_msgs.msg import PoseStamped
rospy.init_node('ear')
f = open({str(out)!r}, 'a', buffering=1)
for t in ('vision_pose', 'local_position'):
    rospy.Subscriber('/uav1/mavros/' + t + '/pose', PoseStamped,
                     lambda m, t=t: f.write(json.dumps([time.time(), t]) + chr(10)))
rospy.spin()
""")
        ear = machine.run([sys.executable, str(script)], "ear")

        def rates(seconds):
            since_s = time.time()
            time.sleep(seconds)
            names = [json.loads(x) for x in out.read_text().splitlines()] if out.exists() else []
            heard = [t for at_s, t in names if at_s >= since_s]
            return {t: heard.count(t) / seconds for t in ("vision_pose", "local_position")}

        deadline = time.monotonic() + 90
        while min(rates(2.0).values()) < 2.0:
            assert time.monotonic() < deadline, "odometry never reached the autopilot"
        own = f":{machine.port}"
        path = ("sim_vehicle", "t265", "odometry", "flight_link")
        frozen = []
        for p in psutil.process_iter(["environ", "cmdline"]):
            command = " ".join(p.info["cmdline"] or [])
            if not (p.info["environ"] or {}).get("ROS_MASTER_URI", "").endswith(own) or p.pid in (ear.pid, os.getpid()):
                continue
            if not any(f"__name:={n}" in command.split() for n in path):
                frozen.append(p)
        names = " ".join(" ".join(p.info["cmdline"]) for p in frozen)
        assert "__name:=relay" in names and "__name:=agent" in names and "rosmaster" in names
        try:
            for p in frozen:
                p.suspend()
            during = rates(6.0)
        finally:
            for p in frozen:
                p.resume()
        assert during["vision_pose"] > 15.0 and during["local_position"] > 5.0, during  # 30 Hz and 10 Hz nominal


def test_link_status_tells_what_is_measured(make):
    net = make()
    net.machines["uav1"].python(TALK.format(extra=""))
    ear = Ear(net, "control", "/uav1/text", "std_msgs/String")
    ear.wait(timeout_s=30.0)
    time.sleep(3.0)
    machine = net.machines["control"]
    command = ["ip", "netns", "exec", machine.namespace, "rosrun", "fcsv_multimaster", "link_status"]
    shown = subprocess.run(command, env=machine.env, capture_output=True, text=True)
    assert shown.returncode == 0 and "control-uav1" in shown.stdout and "/uav1/text" in shown.stdout
    net.radio.cut()
    time.sleep(4.0)
    shown = subprocess.run(command, env=machine.env, capture_output=True, text=True)
    assert shown.returncode == 1 and "no answer" in shown.stdout

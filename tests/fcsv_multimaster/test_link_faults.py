# SPDX-License-Identifier: Apache-2.0
"""Relays with keys in network namespaces, over a radio that fails in every way it can.

The machines are started once for the module, and share a time that a busy machine slows. Every test begins with a
sound radio, relays that hear each other, and a vehicle that says its number 50 times a second.
"""

import json
import shutil
import signal
import struct
import subprocess
import time
import xmlrpc.client
from pathlib import Path

import numpy as np
import psutil
import pytest

from fcsv_sim.machines.slow_motion import slow_motion

pytestmark = [pytest.mark.ros, pytest.mark.slow, pytest.mark.timeout(900)]

LINKS = """
classes:
  critical: {link: datagram, priority: real_time, reliable: true, max_age_s: 5.0}
  state: {link: datagram, priority: interactive_high, reliable: false, max_age_s: 1.0, rate_hz: 50.0, max_bytes: 8000}
  events: {link: urgent, priority: data_high, reliable: true, latched: true}
  captures: {link: bulk, priority: data, reliable: true, max_age_s: 30.0}
  bulk: {link: bulk, priority: background, reliable: false, max_age_s: 3.0}
to_control:
  - {topic: "/{vehicle}/text", class: state}
  - {topic: "/{vehicle}/stepped", class: state}
  - {topic: "/{vehicle}/large", class: state}
  - {topic: "/{vehicle}/changing", class: state}
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
        n += 1; p.publish('%d %f {who}' % (n, time.time())); time.sleep(0.02)
"""
# number, age (s), who
TEXT = "(lambda w: [int(w[0]), time.time() - float(w[1]), w[2]])(m.data.split())"
AGE_LIMIT_S = 5.0  # of commands, in the list above


class Ear:
    """A subscriber in a process of its own on a machine; what it hears, as (time, what ``expression`` makes of it)."""

    count = 0

    def __init__(self, run, net, machine, topic, kind, expression="m.data"):
        Ear.count += 1
        self._net, self._lines, self._read = net, [], 0
        self._path = net.machines[machine].folder / f"ear-{Ear.count}.jsonl"
        package, name = kind.split("/")
        run(
            machine,
            f"""
            import json
            from {package}.msg import {name}
            f = open({str(self._path)!r}, 'a', buffering=1)
            def hear(m): f.write(json.dumps([time.time(), {expression}]) + '\\n')
            rospy.Subscriber({topic!r}, {name}, hear, queue_size=100, buff_size=1 << 24)
            rospy.spin()
        """,
        )

    def heard(self, since_s=0.0):
        if self._path.exists():
            with open(self._path) as file:
                file.seek(self._read)
                whole = file.read().rpartition("\n")[0]
            self._read += len(whole) + bool(whole)
            self._lines += map(json.loads, whole.splitlines())
        return [h for h in self._lines if h[0] >= since_s]

    def wait(self, since_s=0.0, until=lambda value: True, timeout_s=60.0):
        """Seconds from ``since_s`` to the first that fits; fails when none comes in ``timeout_s`` of the net's time.

        It then tells what the relays said meanwhile.
        """
        deadline = self._net.now_s() + timeout_s
        while self._net.now_s() < deadline:
            for at_s, value in self.heard(since_s):
                if until(value):
                    return at_s - since_s
            time.sleep(0.05)
        raise AssertionError(
            f"nothing that fits in {timeout_s} s; last: {self.heard()[-2:]}\n"
            + self._net.told(deadline - timeout_s)
        )


@pytest.fixture(scope="module")
def shared(tmp_path_factory, bench_link):
    """Two machines with masters and relays in slow motion; namespaces for two more; and what uav1 says of itself."""
    machines, _ = bench_link
    folder = tmp_path_factory.mktemp("radio")
    (folder / "links.yaml").write_text(LINKS)
    names = ("control", "uav1", "stranger", "twin")
    with slow_motion() as page:
        net = machines.Net(
            folder, folder / "links.yaml", names, masters=names[:2], clock=page.now_s
        )
        # the time of day of its processes
        net.now_s = lambda: time.time() - time.monotonic() + page.now_s()
        net.addresses = dict(net.radio.addresses)
        try:
            run = lambda machine, code: net.machines[machine].python(code)  # noqa: E731
            run("uav1", TALK.format(who="true"))
            net.text = Ear(run, net, "control", "/uav1/text", "std_msgs/String", TEXT)
            net.reports = {
                n: Ear(
                    run,
                    net,
                    n,
                    "/relay/links",
                    "diagnostic_msgs/DiagnosticArray",
                    "[s.message for s in m.status]",
                )
                for n in names[:2]
            }
            net.told = lambda since_s: "\n".join(
                f"{n}: {[(round(at_s - since_s, 1), said) for at_s, said in net.reports[n].heard(since_s)]}\n"
                + net.relays[n].log.read_text(errors="replace")[-1500:]
                for n in net.reports
            )
            net.text.wait()
            hear_each_other(net)
            yield net
        finally:
            net.stop()


@pytest.fixture
def net(shared, bench_link):
    """The machines, sound; ``net.run(machine, script)`` and ``net.ear(...)`` last as long as the test."""
    _, radio = bench_link
    net, scripts, relays = shared, [], dict(shared.relays)
    net.began = {n: len(relay.log.read_text(errors="replace")) for n, relay in relays.items()}

    def run(machine, code):
        scripts.append(net.machines[machine].python(code))
        return scripts[-1]

    net.run, net.ear = run, lambda *arguments: Ear(run, net, *arguments)
    yield net
    net.radio.mend()
    net.radio.conditions = radio.Conditions()
    for process in scripts:
        process.signal(signal.SIGINT)
    for process in scripts:
        process.stop(grace_s=5.0)
    changed = [n for n in relays if net.relays[n] is not relays[n]]
    for name in changed:
        net.relays[name].signal(signal.SIGINT)
    for name in changed:
        net.relays[name].stop()
    for name, address in net.addresses.items():
        if net.radio.addresses[name] != address:
            net.radio.move(name, address)
    for name in changed:
        net.start_relay(name)
    for name in [n for n in net.relays if n not in relays]:
        del net.relays[name]
    net.text.wait(net.now_s())
    hear_each_other(net)


def status_of(net, machine):
    """What link_status prints there, and its exit status."""
    machine = net.machines[machine]
    command = [
        "ip",
        "netns",
        "exec",
        machine.namespace,
        "rosrun",
        "fcsv_multimaster",
        "link_status",
    ]
    done = subprocess.run(command, env=machine.env, capture_output=True, text=True)
    return done.stdout, done.returncode


def log(net, machine):
    """What the relay of a machine said in this test (the log is one file for all that were started there)."""
    return net.relays[machine].log.read_text(errors="replace")[net.began.get(machine, 0) :]


def pause(net, seconds):
    """As long as it is for the machines."""
    end_s = net.now_s() + seconds
    while net.now_s() < end_s:
        time.sleep(0.02)


def until(net, condition, what, timeout_s=60.0):
    """Wait for ``condition``, at most so long for the machines."""
    deadline = net.now_s() + timeout_s
    while not condition():
        assert net.now_s() < deadline, f"did not come: {what}"
        time.sleep(0.05)


def hear_each_other(net):
    """Wait until either relay says that the other answers: a cut is a new one then."""
    since_s = net.now_s()
    for report in net.reports.values():
        report.wait(since_s, until=lambda said: said and "no answer" not in said)


def cut_until_noticed(net, *pairs, deaf=("control", "uav1")):
    """Cut, until every relay that is ``deaf`` has said so."""
    before = {n: log(net, n).count("is gone") for n in deaf}
    net.radio.cut(*pairs)
    until(
        net,
        lambda: all(log(net, n).count("is gone") > before[n] for n in deaf),
        what=f"{deaf} notice a cut",
    )


def test_cuts_one_way_links_and_new_addresses_are_got_over(net):
    for cut, deaf, longer_s in (
        ([], ("control", "uav1"), 3.5),
        ([("control", "uav1")], ("uav1",), 0.0),
        ([("uav1", "control")], ("control",), 0.0),
    ):
        cut_until_noticed(net, *cut, deaf=deaf)
        pause(net, longer_s)
        net.radio.mend()
        assert net.text.wait(net.now_s()) <= 2.0  # docs/lab/multimaster.md, recovery
        hear_each_other(net)
    # it finds the control PC from there; nobody tells the control PC
    net.radio.move("uav1", "10.77.0.77")
    net.text.wait(net.now_s(), timeout_s=15.0)
    assert "is gone" in log(net, "control")


def test_lost_doubled_and_reordered_packets_leave_order_and_commands_whole(net, tmp_path):
    net.radio.set(loss=0.05, delay_s=0.005, jitter_s=0.03, duplicate=0.2)
    begun_s, go = net.now_s(), tmp_path / "go"
    net.run(
        "uav1",
        f"""
        import os
        from std_msgs.msg import String
        p = rospy.Publisher('/uav1/command_ack', String, queue_size=50)
        while not os.path.exists({str(go)!r}):
            p.publish('-1'); time.sleep(0.1)  # until the other machine's subscriber has found the new topic
        for n in range(200):
            p.publish(str(n)); time.sleep(0.02)
        rospy.spin()
    """,
    )
    acks = net.ear("control", "/uav1/command_ack", "std_msgs/String", "int(m.data)")
    acks.wait(until=lambda n: n == -1)
    go.touch()
    acks.wait(until=lambda n: n == 199)
    # whatever was doubled or repeated has come: it is under way for 0.04 s, repeated after 0.12 s
    pause(net, 0.5)
    numbers = [n for _, (n, _, _) in net.text.heard(begun_s)]
    # newest wins: none twice, none backwards
    assert len(numbers) > 100 and numbers == sorted(set(numbers))
    got = [n for _, n in acks.heard() if n >= 0]
    assert len(got) == len(set(got)) and set(range(200)) <= set(got)  # every one, once


def test_commands_that_fell_into_a_cut_come_after_it_in_order_and_once(net):
    net.radio.set(loss=0.05, delay_s=0.01)
    commands = net.ear("uav1", "/uav1/command", "std_msgs/String", "int(m.data)")
    net.run(
        "control",
        """
        from std_msgs.msg import String
        p = rospy.Publisher('/uav1/command', String, queue_size=50)
        while not p.get_num_connections(): time.sleep(0.02)
        n = 0
        while not rospy.is_shutdown():
            p.publish(str(n)); n += 1; time.sleep(0.1)
    """,
    )
    commands.wait()
    pause(net, 1.5)  # the contact is over a second old: what comes now is not early any more
    net.radio.cut()
    pause(net, 3.0)
    begin_s, begin = commands.heard()[-1]
    net.radio.mend()
    commands.wait(until=lambda n: n > begin + 60)
    got = [n for _, n in commands.heard()]
    since = got[got.index(begin) :]
    after_s, after = next((at_s, n) for at_s, n in commands.heard() if n > begin)
    # all that came in time, once
    assert len(got) == len(set(got)) and set(since) >= set(range(after, begin + 60))
    # 3 s of cut were 30 commands
    assert since[1:21] == list(range(after, after + 20)), [
        (round(at_s - begin_s, 2), n) for at_s, n in commands.heard() if n > begin
    ]
    # a busy machine finds its peers late: what is too old by then is not executed
    dropped = after - begin - 1
    assert dropped <= max(0.0, after_s - begin_s - AGE_LIMIT_S) * 10 + 1


def test_pictures_cut_in_the_middle_come_whole_and_codecs_keep_the_type(net, tmp_path):
    net.radio.set(rate_bit_s=4e6)
    begun = tmp_path / "begun"
    net.run(
        "uav1",
        f"""
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
                with open({str(begun)!r}, 'a') as f: f.write('+')
            i = Image(height=80, width=80, encoding='rgb8', step=240, data=(row[:240]) * 80)
            i.header.frame_id = 'uav1/camera_optical'; i.header.stamp = rospy.Time(1000 + n)
            q.publish(i); time.sleep(0.1)
    """,
    )
    whole = "__import__('zlib').crc32(m.data[4:]) == int.from_bytes(m.data[:4], 'little')"
    captures = net.ear("control", "/uav1/capture", "std_msgs/UInt8MultiArray", whole)
    images = net.ear(
        "control",
        "/uav1/image",
        "sensor_msgs/Image",
        "[m.header.stamp.secs, m.header.frame_id, m.encoding, m.width, len(m.data)]",
    )
    captures.wait()
    images.wait()
    for _ in range(3):
        count = begun.stat().st_size
        until(net, lambda c=count: begun.stat().st_size > c, what="the next capture")
        pause(net, 0.15)  # a capture takes 0.4 s of this link: it is under way now
        cut_until_noticed(net)
        pause(net, 3.0)
        net.radio.mend()
        images.wait(net.now_s())
        hear_each_other(net)
    captures.wait(net.now_s())
    assert all(ok for _, ok in captures.heard())
    stamps = [v[0] for _, v in images.heard()]
    assert stamps == sorted(set(stamps)) and {tuple(v[1:]) for _, v in images.heard()} == {
        ("uav1/camera_optical", "rgb8", 80, 19200)
    }


def test_full_send_buffers_hold_up_neither_state_nor_commands(net):
    """Sixteen times as many pictures as the link carries: a megabit a second, with a tenth of a second of queue."""
    net.radio.set(rate_bit_s=1e6, delay_s=0.005)
    net.run(
        "uav1",
        """
        from std_msgs.msg import String, UInt8MultiArray
        import os
        p = rospy.Publisher('/uav1/capture', UInt8MultiArray, queue_size=10)
        q = rospy.Publisher('/uav1/command_ack', String, queue_size=50)
        while not rospy.is_shutdown():
            p.publish(UInt8MultiArray(data=os.urandom(200000)))
            q.publish('0 %f' % time.time()); time.sleep(0.1)
    """,
    )
    acks = net.ear(
        "control", "/uav1/command_ack", "std_msgs/String", "time.time() - float(m.data.split()[1])"
    )
    captures = net.ear("control", "/uav1/capture", "std_msgs/UInt8MultiArray", "len(m.data)")
    own = 200000  # those of the test before are larger: some may still be under way
    captures.wait(until=lambda n: n == own)
    full_s = net.now_s()
    pause(net, 10.0)
    ages = [age_s for _, (_, age_s, _) in net.text.heard(full_s)]
    assert len(ages) > 10 * 10 and np.percentile(ages, 99) < 0.5
    assert (
        len(acks.heard(full_s)) > 5 * 10
        and np.percentile([a for _, a in acks.heard(full_s)], 99) < 1.0
    )
    sizes = [n for _, n in captures.heard(full_s)]
    assert sizes and set(sizes) == {own}


def test_strangers_get_nothing_and_a_twin_is_named(net, bench_link):
    machines, _ = bench_link
    machines.make_fleet(net.folder / "foreign", ["control", "uav1"])
    others = {}
    try:
        for name, keys in (("stranger", net.folder / "foreign/uav1"), ("twin", net.keys / "uav1")):
            others[name] = net.machines[name] = machines.NamespaceMachine(
                name, net.folder, net.radio.namespace(name)
            )
            others[name].start_master()
            others[name].python(TALK.format(who=name))
            command = [
                "rosrun",
                "fcsv_multimaster",
                "relay",
                "_machine:=uav1",
                f"_links:={net.links}",
                "_listen:=0.0.0.0:7447",
                f"_peers:={net.peers('uav1')}",
                f"_keys:={keys}",
            ]
            net.relays[name] = others[name].run(command, "relay")
        net.run(
            "control",
            """
            from std_msgs.msg import String
            p = rospy.Publisher('/home', String, queue_size=1, latch=True); p.publish('secret'); rospy.spin()
        """,
        )
        outsider = net.ear("stranger", "/home", "std_msgs/String")
        insider = net.ear("uav1", "/home", "std_msgs/String")
        insider.wait()
        until(
            net,
            lambda: "another relay calls itself uav1" in log(net, "control"),
            what="the twin's name",
        )
        until(
            net,
            lambda: "uav1 to" in log(net, "stranger"),
            what="the stranger's relay, which knocks by now",
        )
        pause(net, 4.0)  # a relay of the fleet is there within two
        assert outsider.heard() == []
        assert {who for _, (_, _, who) in net.text.heard()} == {"true"}
    finally:
        for name, machine in others.items():
            machine.stop()
            del net.machines[name]


def test_what_is_wrong_with_messages_costs_one_line(net, tmp_path):
    begun_s, go = net.now_s(), tmp_path / "go"
    net.run(
        "uav1",
        """
        from std_msgs.msg import String
        p = rospy.Publisher('/uav1/large', String, queue_size=1)
        while not rospy.is_shutdown(): p.publish('x' * 9000); time.sleep(0.02)
    """,
    )
    texts = net.ear("control", "/uav1/changing", "std_msgs/String")
    numbers = net.ear("control", "/uav1/changing", "std_msgs/Int32")
    changed = net.run(
        "uav1",
        f"""
        import os
        from std_msgs.msg import String, Int32
        p = rospy.Publisher('/uav1/changing', String, queue_size=1)
        while not os.path.exists({str(go)!r}): p.publish('x'); time.sleep(0.05)
        p.unregister(); time.sleep(3)
        p = rospy.Publisher('/uav1/changing', Int32, queue_size=1)
        while not rospy.is_shutdown(): p.publish(5); time.sleep(0.05)
    """,
    )
    texts.wait()
    go.touch()
    numbers.wait(until=lambda n: n == 5)
    assert changed.returncode is None and "is std_msgs/Int32 now" in log(net, "control")
    until(
        net, lambda: "oversized" in log(net, "uav1"), what="a line that names the oversized message"
    )
    lines = [line for line in log(net, "uav1").splitlines() if "oversized" in line]
    # one in five seconds: see test_drops
    assert 1 <= len(lines) <= 2 + (net.now_s() - begun_s) / 5.0


def test_tf_is_merged_with_prefixes_and_nothing_comes_back(net):
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
    net.run("uav1", send.format(pairs="[('base_link', 'arm'), ('home', 'uav1/odom')]"))
    net.run("control", send.format(pairs="[('home', 'mocap')]"))
    pairs = "[[t.header.frame_id, t.child_frame_id, t.header.stamp.to_sec()] for t in m.transforms]"
    ears = {n: net.ear(n, "/tf", "tf2_msgs/TFMessage", pairs) for n in ("control", "uav1")}

    def came(name, only):
        """Stamps of the messages with this transform and no other."""
        return [v[0][2] for _, v in ears[name].heard() if [t[:2] for t in v] == [only]]

    arm, mocap = ["uav1/base_link", "uav1/arm"], ["home", "mocap"]
    until(
        net,
        lambda: len(came("control", arm)) > 20 and len(came("uav1", mocap)) > 20,
        what="what is listed",
    )
    stamps_s = came("control", arm)
    assert stamps_s == sorted(set(stamps_s))  # no echo doubles them
    assert 20 / 24 <= np.mean(np.diff(stamps_s)) / 0.1 <= 2.0  # 10 Hz of 50
    assert not [v for _, v in ears["uav1"].heard() if arm in [t[:2] for t in v]]


def test_link_status_tells_what_is_measured(net):
    def shows(*words, status):
        shown, returned = status_of(net, "control")
        return returned == status and all(w in shown for w in words)

    until(
        net,
        lambda: shows("control-uav1", "/uav1/text", status=0),
        what="a link that is well, and what comes by it",
    )
    cut_until_noticed(net, deaf=("control",))
    until(net, lambda: shows("no answer", status=1), what="a link that is not")


def test_peers_without_addresses_are_found_and_found_again(net):
    for relay in net.relays.values():
        relay.stop()
    begun_s = net.now_s()
    for name, peer in (("control", "uav1"), ("uav1", "control")):
        net.start_relay(name, peers=peer, discovery=True)
    net.text.wait(begun_s)
    hear_each_other(net)
    cut_until_noticed(net)
    net.radio.mend()
    net.text.wait(net.now_s(), timeout_s=15.0)
    net.relays["uav1"].stop()
    net.radio.move("uav1", "10.77.0.77")  # a machine that comes back elsewhere
    net.start_relay("uav1", peers="control", discovery=True)
    net.text.wait(net.now_s())
    # one that gets another while it runs
    for name, address in (("uav1", "10.77.0.88"), ("control", "10.77.0.99")):
        net.radio.move(name, address)
        moved_s = net.now_s()
        net.text.wait(moved_s + 1.5)  # what was under way has come by then
        assert "its addresses are others now" in log(net, name)


def test_a_clock_that_steps_neither_drops_nor_delays_and_is_named(net, tmp_path):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip(
            "needs a C compiler (cc) for the library that steps the clock of single processes"
        )
    source, library, clock = (
        Path(__file__).with_name("step_clock.c"),
        tmp_path / "step_clock.so",
        tmp_path / "clock",
    )
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-O1", "-Wall", "-Werror", source, "-o", library, "-ldl"],
        check=True,
    )
    clock.write_bytes(struct.pack("q", 0))
    uav1 = net.machines["uav1"]
    net.relays["uav1"].stop()
    uav1.prefix = [
        "env",
        f"LD_PRELOAD={library}:{uav1.env['LD_PRELOAD']}",
        f"STEP_CLOCK_FILE={clock}",
    ]
    try:
        net.start_relay("uav1")
        step_and_look(net, clock)
    finally:
        uav1.prefix = []


def step_and_look(net, clock):
    talk = """
        from std_msgs.msg import String
        p = rospy.Publisher('{topic}', String, queue_size=10)
        n = 0
        while not rospy.is_shutdown():
            n += 1; p.publish('%d %f %f' % (n, time.monotonic(), time.time())); time.sleep(0.04)
    """
    net.run("uav1", talk.format(topic="/uav1/stepped"))
    net.run("control", talk.format(topic="/uav1/command"))
    age = "[int(m.data.split()[0]), time.monotonic() - float(m.data.split()[1]), float(m.data.split()[2]), time.time()]"
    states = net.ear("control", "/uav1/stepped", "std_msgs/String", age)
    commands = net.ear("uav1", "/uav1/command", "std_msgs/String", age)
    states.wait()
    until(net, commands.heard, what="commands")  # whose time of day will be another
    pause(net, 1.5)  # since the first contact
    came = len(states.heard()), len(commands.heard())

    def named(offset_s):
        return (
            f"the clocks differ by {abs(offset_s)}.0 s" in status_of(net, "control")[0]
        ) == bool(offset_s)

    for offset_s in (3600, -86400, 0):
        before = len(states.heard())
        with open(clock, "r+b") as file:
            file.write(struct.pack("q", offset_s))
        until(net, lambda o=offset_s: named(o), what=f"what link_status says of {offset_s} s")
        until(net, lambda b=before: len(states.heard()) > b + 70, what="more states")
        ahead_s = np.subtract(*states.heard()[-1][1][2:])  # the vehicle's time of day against ours
        assert ahead_s == pytest.approx(offset_s, abs=1.0), "the step did not take place"
    for ear, before in zip((states, commands), came):
        lines = [value for _, value in ear.heard()][before:]
        numbers = [v[0] for v in lines]
        # none dropped
        assert len(numbers) > 200 and numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        # an hour late, had anybody looked at the time of day
        assert np.percentile([v[1] for v in lines], 99) < 0.5
    assert "the clock of uav1 is +3600.0 s off" in log(net, "control")


def test_a_hung_master_stops_nothing_and_ten_thousand_topics_cost_nothing(net):
    """The last here: the master of uav1 is full of topics afterwards."""
    uav1 = net.machines["uav1"]
    masters = [
        p
        for p in psutil.Process(uav1.core.pid).children(recursive=True)
        if "rosmaster" in " ".join(p.cmdline())
    ]
    assert masters
    for p in masters:
        p.send_signal(signal.SIGSTOP)
    try:
        until(
            net,
            lambda: "the ROS master does not answer" in log(net, "uav1"),
            what="its word about its master",
        )
        pause(net, 1.0)
        assert net.text.wait(net.now_s()) < 0.5
    finally:
        for p in masters:
            p.send_signal(signal.SIGCONT)

    def register():
        master = xmlrpc.client.ServerProxy(uav1.master_uri)
        for n in range(10000):
            master.registerPublisher(
                "/crowd", f"/crowd/t{n}", "std_msgs/String", "http://127.0.0.1:1"
            )

    from radio import in_namespace

    in_namespace(uav1.namespace, register)
    relay, since_s = psutil.Process(net.relays["uav1"].pid), net.now_s()
    before_s = sum(relay.cpu_times()[:2])
    until(net, lambda: len(net.text.heard(since_s)) >= 250, what="five seconds of what uav1 says")
    cost_s = (sum(relay.cpu_times()[:2]) - before_s) / len(net.text.heard(since_s))
    assert cost_s < 0.15 / 50  # 50 messages a second cost about 3 % of a core
    assert net.text.wait(net.now_s()) < 0.5
    fresh = net.ear("uav1", "/home", "std_msgs/String")
    net.run(
        "control",
        """
        from std_msgs.msg import String
        p = rospy.Publisher('/home', String, queue_size=1, latch=True); p.publish('h'); rospy.spin()
    """,
    )
    fresh.wait(until=lambda word: word == "h", timeout_s=15.0)

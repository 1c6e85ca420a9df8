# SPDX-License-Identifier: Apache-2.0
"""What all tests share: where things are, real data that may be absent, and a ROS master of their
own."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings
from support import tiers, wrong_inputs

ROOT = Path(__file__).resolve().parents[1]

settings.register_profile("fcsv", deadline=None)  # a busy machine is no failure
settings.load_profile("fcsv")


def pytest_addoption(parser):
    tiers.options(parser)
    parser.addoption(
        "--write-wrong-inputs", action="store_true", help="write docs/reference/wrong_inputs.md"
    )


def pytest_configure(config):
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # a shell began it in the background: what tests start would not be ended by SIGINT
        signal.signal(signal.SIGINT, signal.default_int_handler)
    tiers.register(config)
    if config.getoption("--write-wrong-inputs") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(wrong_inputs.Writer())


def pytest_ignore_collect(collection_path, config):
    return True if tiers.pass_over(collection_path, config) else None


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection_modifyitems(config, items):
    tiers.mark_what_needs_ros(items)  # before pytest looks at -m
    for item in items:
        if wrong_inputs.FIXTURE in getattr(item, "fixturenames", ()):
            item.add_marker(wrong_inputs.MARK)
    tiers.keep_tier(config, items)
    tiers.share_out(config, items)
    yield
    in_slow_motion(items)


def in_slow_motion(items):
    from fcsv_sim.machines.slow_motion import shared_time

    if not shared_time(os.environ):
        items[:] = [
            InSlowMotion.of(item) if item.get_closest_marker("slow_motion") else item
            for item in items
        ]


class InSlowMotion(pytest.Item):
    """A test in a pytest of its own, so that all its clocks and nodes share a time that a busy
    machine slows."""

    @classmethod
    def of(cls, item):
        new = cls.from_parent(item.parent, name=item.name)
        new.own_markers, new.place = item.own_markers, item.reportinfo()
        return new

    def runtest(self):
        from fcsv_sim.machines.slow_motion import slow_motion

        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", self.nodeid]
        with slow_motion():
            done = subprocess.run(command, cwd=self.config.rootpath, capture_output=True, text=True)
        last = done.stdout.rstrip().rsplit("\n", 1)[-1]
        if done.returncode:
            pytest.fail(done.stdout + done.stderr, pytrace=False)
        if "1 passed" not in last:
            pytest.skip(last)

    def reportinfo(self):
        return self.place


@pytest.fixture(autouse=True)
def signals_as_before():
    """Commands that a test runs in this process answer signals in their own way: what is forked
    later would, too, and a process of multiprocessing's Pool could not be ended."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in numbers}
    yield
    for number, handler in before.items():
        if signal.getsignal(number) is not handler:
            signal.signal(number, handler)


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real photographs and recordings beside the checkout; a clone of the repository has none."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("real data is not beside this checkout (../shared/data)")
    return folder


@pytest.fixture
def wrong_input(record_property, request):
    """wrong_input(area, given, outcome, message): a row of docs/reference/wrong_inputs.md that the
    test asserted."""
    return wrong_inputs.Recorder(record_property, request.config.getoption("--write-wrong-inputs"))


@pytest.fixture(scope="session")
def ros_master(tmp_path_factory):
    """A master on a free port; this process is a rospy node on it (once: rospy knows one master a
    process)."""
    from fcsv_sim.machines.machines import Machine

    with Machine("tests", tmp_path_factory.mktemp("ros")) as machine:
        os.environ.update({k: v for k, v in machine.env.items() if k.startswith("ROS_")})
        import rospy

        from fcsv_geometry.ros import node

        node.begin("fcsv_tests", anonymous=True, disable_signals=True, disable_rostime=False)
        yield machine
        rospy.signal_shutdown("tests are over")


@pytest.fixture
def start_node(ros_master):
    """start_node(package, node, name=, ns=, params={}, remaps={}) -> Process; stopped after the
    test."""
    import rospy

    started, places = [], set()

    def start(package, node, name=None, ns="", params=None, remaps=None):
        name = name or node
        places.add("/".join([("/" + ns.strip("/")) if ns else "", name]))
        command = ["rosrun", package, node, f"__name:={name}"] + ([f"__ns:={ns}"] if ns else [])
        for key, value in (params or {}).items():
            rospy.set_param("/".join([("/" + ns.strip("/")) if ns else "", name, key]), value)
        command += [f"{a}:={b}" for a, b in (remaps or {}).items()]
        process = ros_master.run(command, f"{package}-{name}-{len(started)}")
        started.append(process)
        return process

    yield start
    for process in started:  # all at once: each takes its time to say goodbye to the master
        process.signal(signal.SIGINT)
    for process in started:
        process.stop(grace_s=5.0)
        if process.returncode not in (0, None):
            print(f"--- {process.command}: exit {process.returncode}\n{process.tail(20)}")
    # the next test's node of this name has parameters of its own
    for place in filter(rospy.has_param, places):
        rospy.delete_param(place)


@pytest.fixture(scope="session")
def bench_link(root):
    """The modules of tools/bench_link: (machines, radio); skipped where this machine permits no
    namespaces."""
    sys.path.insert(0, str(root / "tools" / "bench_link"))
    import machines
    import radio

    if not radio.can_emulate():
        pytest.skip("needs root, /dev/net/tun and network namespaces")
    return machines, radio


@pytest.fixture
def tello_air(tmp_path):
    """Simulated Tellos and unmodified tellopy that flies them; skipped where network namespaces are
    not permitted."""
    from support.tello_air import Air

    from fcsv_sim.machines import namespaces

    why = namespaces.permitted()
    if why:
        pytest.skip(why)
    air = Air(tmp_path)
    yield air
    air.close()

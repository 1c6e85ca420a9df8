# SPDX-License-Identifier: Apache-2.0
"""How a test run is divided: plain tests side by side on all cores, tests of nodes two at a time,
those whose time passes slowly on a busy machine likewise, flights of whole systems, and what must
have the machine for itself. Marks and fixtures say which a test is. How to run them:
docs/design/testing.md.
"""

import json
import os
import re
from collections import defaultdict
from pathlib import Path

import pytest

TIERS = PLAIN, NODES, SLOWED, FLIGHTS, ALONE = "plain", "nodes", "slowed", "flights", "alone"
# fixtures that start a master, nodes or network namespaces: each test that uses one is marked ros
STARTS_ROS = {"ros_master", "start_node", "bench_link", "tello_air"}
# of these the ones whose tests have the machine for themselves: an emulated radio's rates mean
# nothing on a busy one
MEASURES = {"bench_link"}
SYSTEMS = "tests/system/"  # each test in it is marked system
# what stands in a file that has tests of another tier than plain: a fixture or a mark
_NOT_PLAIN = re.compile(
    rf"\b({'|'.join(sorted(STARTS_ROS))})\b|\bmark\.(ros|alone|system|slow_motion)\b"
)
# fixtures that are shared but cost next to nothing: no reason to keep their tests on one worker
CHEAP = {"root", "shared_data", "pool", "ros_master", "app"}
OUTCOMES = ("passed", "failed", "error", "skipped", "xfailed", "xpassed")


def options(parser):
    group = parser.getgroup("fcsv")
    group.addoption(
        "--tier",
        choices=TIERS,
        help="only tests without ROS, of nodes, in slow motion, flights, or alone",
    )
    group.addoption(
        "--counts",
        type=Path,
        metavar="FILE",
        help="write how many tests passed, failed, ... as JSON",
    )
    group.addoption(
        "--times", action="store_true", help="end with a table of the time that each test file took"
    )


def tier_of(item) -> str:
    if item.get_closest_marker("system"):
        return FLIGHTS  # in slow motion, where the machine is busy
    if item.get_closest_marker("alone"):
        return ALONE
    if item.get_closest_marker("slow_motion"):
        return SLOWED
    return NODES if item.get_closest_marker("ros") else PLAIN


def mark_what_needs_ros(items) -> None:
    """Give each test the mark of what its fixtures start, so that no test can forget it."""
    for item in items:
        if STARTS_ROS & set(getattr(item, "fixturenames", ())):
            item.add_marker("ros")
        if MEASURES & set(getattr(item, "fixturenames", ())):
            item.add_marker("alone")
        if item.nodeid.startswith(SYSTEMS):
            item.add_marker("system")


def only_plain(path: Path) -> bool:
    """Whether a file's text says that all its tests are plain. ``keep_tier`` holds files to it."""
    return SYSTEMS not in path.as_posix() and not _NOT_PLAIN.search(
        path.read_text(errors="replace")
    )


def pass_over(path: Path, config) -> bool:
    """Whether a file need not be imported: imports of all files take longer than many a tier's
    tests."""
    if (
        config.getoption("--tier") in (None, PLAIN)
        or not path.is_file()
        or path.name == "conftest.py"
    ):
        return False
    named = {
        Path(config.invocation_params.dir, arg.split("::")[0]).resolve() for arg in config.args
    }
    return path.resolve() not in named and only_plain(path)


def keep_tier(config, items) -> None:
    """Deselect the other tiers, where ``--tier`` names one. Raises UsageError where only_plain is
    wrong."""
    wanted = config.getoption("--tier")
    if wanted == PLAIN:
        hidden = {item.path for item in items if tier_of(item) != PLAIN}
        for path in sorted(path for path in hidden if only_plain(path)):
            raise pytest.UsageError(
                f"{path} has tests that are not plain, and names none of {_NOT_PLAIN.pattern}"
            )
    if wanted:
        config.hook.pytest_deselected(items=[item for item in items if tier_of(item) != wanted])
        items[:] = [item for item in items if tier_of(item) == wanted]


def group_of(item):
    """The name of the group of tests that share an expensive fixture with this one; None where it
    shares none."""
    definitions = getattr(getattr(item, "_fixtureinfo", None), "name2fixturedefs", {})
    shared = {
        (found[-1].baseid, name)
        for name, found in definitions.items()
        if found[-1].scope != "function"
        and found[-1].baseid.startswith("tests")
        and name not in CHEAP
    }
    own = sorted({base for base, _ in shared if base.endswith(".py")})
    return own[0] if own else "-".join(sorted(name for _, name in shared)) or None


def share_out(config, items) -> None:
    """Under pytest-xdist: the tests of a group on one worker, and the slow ones first, so that none
    begins last."""
    if not hasattr(config, "workerinput"):
        return
    for item in items:
        group = group_of(item)
        if group:
            item.add_marker(pytest.mark.xdist_group(group))
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


def processor_s() -> float:
    """Processor time of this process and of its children that have ended, seconds."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


class Times:
    """Wall and processor time of each test; a worker measures, the controller adds up."""

    def __init__(self):
        self.since_s = processor_s()
        self.by_file = defaultdict(lambda: [0, 0.0, 0.0])  # tests, wall s, processor s

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item, call):
        report = yield
        now_s = processor_s()
        report.processor_s, self.since_s = now_s - self.since_s, now_s
        return report

    def pytest_runtest_logreport(self, report):
        row = self.by_file[report.nodeid.split("::")[0]]
        row[0] += report.when == "call"
        row[1] += report.duration
        row[2] += getattr(report, "processor_s", 0.0)

    def pytest_terminal_summary(self, terminalreporter):
        terminalreporter.section("time of each test file, with its fixtures")
        terminalreporter.line(f"{'tests':>6} {'wall s':>8} {'cpu s':>8}")
        for name, (number, wall_s, cpu_s) in sorted(
            self.by_file.items(), key=lambda row: -row[1][2]
        ):
            terminalreporter.line(f"{number:6} {wall_s:8.1f} {cpu_s:8.1f}  {name}")


class Counts:
    """Leaves the number of each outcome, and the names of what failed, in a file."""

    def __init__(self, path: Path):
        self.path = path

    def pytest_terminal_summary(self, terminalreporter):
        stats = terminalreporter.stats
        said = {name: len(stats.get(name, ())) for name in OUTCOMES}
        bad = [
            (name.upper(), report.nodeid)
            for name in ("failed", "error")
            for report in stats.get(name, ())
        ]
        said["names"] = [f"{outcome} {test}" for outcome, test in bad]
        self.path.write_text(json.dumps(said))


def register(config) -> None:
    if config.getoption("--times"):
        config.pluginmanager.register(Times(), "fcsv-times")
    if config.getoption("--counts") and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Counts(config.getoption("--counts")), "fcsv-counts")

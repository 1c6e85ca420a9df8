# SPDX-License-Identifier: Apache-2.0
"""How a test run is divided: what needs the machine runs alone, and ARGS keep their quotes."""

import ast
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from support import tiers

ROOT = Path(__file__).resolve().parents[2]
# who names one of these starts masters or systems by himself, past the fixtures of
# tests/conftest.py
STARTERS = {"Machine", "NamespaceMachine", "start_demo", "init_node"}
FILES = sorted(path for path in (ROOT / "tests").rglob("test_*.py"))


class Item:
    """What tiers asks of a test."""

    def __init__(self, nodeid="tests/a/test_a.py::test_a", fixtures=(), marks=()):
        self.nodeid, self.fixturenames, self.marks = nodeid, fixtures, list(marks)

    def add_marker(self, mark):
        self.marks.append(mark)

    def get_closest_marker(self, name):
        return name if name in self.marks else None


@pytest.mark.parametrize(
    "item, tier",
    [
        (Item(), "plain"),
        (Item(marks=["slow"]), "plain"),
        (Item(marks=["slow_motion"]), "slowed"),
        (Item(fixtures=["ros_master"], marks=["slow_motion"]), "slowed"),
        (Item("tests/system/test_a.py::test_a", marks=["slow_motion"]), "flights"),
        (Item(fixtures=["ros_master"]), "nodes"),
        (Item(fixtures=["tmp_path", "start_node"]), "nodes"),
        (Item(fixtures=["bench_link"]), "alone"),
        (Item(fixtures=["ros_master"], marks=["alone"]), "alone"),
        (Item("tests/system/test_a.py::test_a"), "flights"),
        (Item("tests/system/test_a.py::test_a", fixtures=["bench_link"]), "flights"),
    ],
)
def test_a_test_with_a_master_is_never_plain(item, tier):
    tiers.mark_what_needs_ros([item])
    assert tiers.tier_of(item) == tier


def marks_itself(tree) -> bool:
    """Whether the module's ``pytestmark`` names ros or system."""
    marks = [
        n
        for n in tree.body
        if isinstance(n, ast.Assign) and getattr(n.targets[0], "id", "") == "pytestmark"
    ]
    return any(
        getattr(n, "attr", "") in ("ros", "system") for mark in marks for n in ast.walk(mark)
    )


def test_whoever_starts_a_master_without_the_fixtures_is_marked():
    found = 0
    for path in FILES:
        tree = ast.parse(path.read_text())
        names = {a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names}
        names |= {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
        if STARTERS & names:
            found += 1
            assert marks_itself(tree), (
                f"{path.relative_to(ROOT)} starts masters: pytestmark must name ros or system"
            )
    assert found


def run_tests(args, timeout_s=200):
    done = subprocess.run(
        ["tools/run", "test"],
        cwd=ROOT,
        env=dict(os.environ, ARGS=args),
        capture_output=True,
        text=True,
        timeout=timeout_s,
    )
    return done.returncode, done.stdout


def test_quotes_in_args_hold_words_together_and_the_last_line_counts_all_tiers():
    """Four tiers are empty: no error, since these arguments ask for so little."""
    status, said = run_tests(
        "-n0 -q -m 'not slow and not system' -k 'never_plain' tests/house/test_tiers.py"
    )
    assert status == 0, said
    assert said.splitlines()[-1].startswith("11 tests: 11 passed, 0 failed, 0 skipped, in "), said


@pytest.fixture
def runner(root, monkeypatch):
    """The script's module, which starts no pytest."""
    monkeypatch.setattr(sys, "path", [str(root / "tools"), *sys.path])
    import run_tests

    monkeypatch.setattr(run_tests, "pytest_status", lambda _: pytest.fail("pytest was started"))
    return run_tests


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["-n0", "tests/absent.py"], "no file 'tests/absent.py'"),
        (
            ["tests/house/test_tier.py"],
            "no file 'tests/house/test_tier.py'; did you mean 'tests/house/test_tiers.py'?",
        ),
        (["test_tiers.py"], "no file 'test_tiers.py'; did you mean 'tests/house/test_tiers.py'?"),
        (
            ["-k", "flies", "tests/house/test_tiers.py::test_the_exit_state"],
            "test_tiers.py has no test 'test_the_exit_state'; "
            "did you mean 'test_the_exit_status_is_that_of_all_tiers'?",
        ),
    ],
)
def test_what_is_mistyped_is_refused_by_name_before_a_tier_begins(runner, capsys, arguments, words):
    assert runner.main(arguments) == 4
    said = capsys.readouterr()
    assert words in said.err and said.err.startswith("test: ") and not said.out


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["-k", "absent"],
        ["-m", "not slow", "tests/house"],
        ["--deselect", "tests/absent.py", "-x"],
        ["tests/house/test_tiers.py::test_the_exit_status_is_that_of_all_tiers[0-0-False-0]"],
    ],
)
def test_what_is_there_is_not_refused(runner, root, arguments):
    assert runner.mistyped(arguments, root) == ""


@pytest.mark.parametrize(
    "plain, nodes, explicit, status",
    [
        (0, 0, False, 0),
        (1, 0, False, 1),
        (0, 1, True, 1),
        (5, 0, False, 5),
        (5, 0, True, 0),
        (5, 5, True, 5),
        (5, 1, False, 1),
        (2, 0, True, 2),
        (0, 3, False, 3),
    ],
)
def test_the_exit_status_is_that_of_all_tiers(root, monkeypatch, plain, nodes, explicit, status):
    monkeypatch.setattr(sys, "path", [str(root / "tools"), *sys.path])
    import run_tests

    assert run_tests.overall({"plain": plain, "nodes": nodes, "alone": nodes}, explicit) == status


class Definition:
    def __init__(self, scope, baseid):
        self.scope, self.baseid = scope, baseid


@pytest.mark.parametrize(
    "fixtures, group",
    [
        ({}, None),
        (
            {"tmp_path": Definition("function", ""), "tmp_path_factory": Definition("session", "")},
            None,
        ),
        ({"root": Definition("session", "tests")}, None),
        (
            {
                "town": Definition("module", "tests/a/test_a.py"),
                "root": Definition("session", "tests"),
            },
            "tests/a/test_a.py",
        ),
        ({"scene": Definition("session", "tests/a")}, "scene"),
    ],
)
def test_who_shares_an_expensive_fixture_shares_a_worker(fixtures, group):
    item = Item()
    item._fixtureinfo = type(
        "Info", (), {"name2fixturedefs": {name: [d] for name, d in fixtures.items()}}
    )
    assert tiers.group_of(item) == group


@pytest.mark.parametrize(
    "text, plain",
    [
        ("def test_a(tmp_path): ...", True),
        ("def test_a(start_node): ...", False),
        ("def test_a(tello_air): ...", False),
        ("pytestmark = [pytest.mark.slow, pytest.mark.ros]", False),
        ("@pytest.mark.slow_motion", False),
        ("@pytest.mark.rosy\n# microstart_nodes", True),
    ],
)
def test_a_files_text_says_whether_it_can_have_tests_that_are_not_plain(tmp_path, text, plain):
    (tmp_path / "test_a.py").write_text(text)
    assert tiers.only_plain(tmp_path / "test_a.py") is plain


def test_files_of_plain_tests_are_not_imported_for_another_tier_unless_they_are_named(tmp_path):
    path = tmp_path / "test_a.py"
    path.write_text("def test_a(): ...")

    def passed_over(tier, *args, at=path):
        config = SimpleNamespace(
            args=args, invocation_params=SimpleNamespace(dir=tmp_path), getoption=lambda _name: tier
        )
        return tiers.pass_over(at, config)

    assert (
        passed_over("alone", ".")
        and passed_over("slowed", ".")
        and passed_over("nodes", str(tmp_path))
    )
    assert not passed_over("plain", ".") and not passed_over(None, ".")
    assert not passed_over("nodes", "test_a.py::test_a") and not passed_over("nodes", str(path))
    assert not passed_over("nodes", ".", at=tmp_path), "a folder"


def test_a_test_that_hides_its_tier_is_told(tmp_path):
    """In the plain tier, which imports all files."""
    item = Item(marks=["ros"])
    item.path = tmp_path / "test_a.py"
    item.path.write_text("from elsewhere import *")
    with pytest.raises(pytest.UsageError, match="test_a.py has tests that are not plain"):
        tiers.keep_tier(SimpleNamespace(getoption=lambda _name: "plain"), [item])

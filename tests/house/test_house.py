# SPDX-License-Identifier: Apache-2.0
"""The house rules that a machine can check: who may import whom, and what may not stand in the tree."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROS_MODULES = {"rospy", "rosbag", "tf2_ros", "cv_bridge", "message_filters", "diagnostic_updater", "fcsv_msgs"}
BELOW = {
    "fcsv_geometry": set(),
    "fcsv_tracking": {"fcsv_geometry"},
    "fcsv_stereo": {"fcsv_geometry"},
    "fcsv_multimaster": {"fcsv_geometry"},
    "fcsv_control": {"fcsv_geometry", "fcsv_tracking", "fcsv_stereo"},
    "fcsv_sim": {"fcsv_geometry", "fcsv_tracking", "fcsv_stereo", "fcsv_control"},
}


def modules(package):
    found = sorted((ROOT / "src" / package / "src" / package).rglob("*.py"))
    assert found, f"{package} has no modules"
    return found


def imports(path):
    """(module, whether it stands at the module's top) of every import."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        names += [node.module] if isinstance(node, ast.ImportFrom) and node.module and not node.level else []
        for name in names:
            yield name.split(".")[0], node in tree.body


@pytest.mark.parametrize("package", BELOW)
def test_imports_run_down_only(package):
    allowed = BELOW[package] | {package, "fcsv_msgs"}
    for path in modules(package):
        above = {m for m, _ in imports(path) if m.startswith("fcsv_")} - allowed
        assert not above, f"{path.relative_to(ROOT)} imports {above}"


@pytest.mark.parametrize("package", BELOW)
def test_algorithms_import_no_ros(package):
    for path in modules(package):
        if "ros" in path.relative_to(ROOT / "src" / package / "src" / package).parts[:-1]:
            continue
        found = {m for m, at_top in imports(path) if (m in ROS_MODULES or m.endswith("_msgs")) and at_top}
        assert not found, f"{path.relative_to(ROOT)} imports {found}; nodes live in ros/"


def tracked():
    names = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    return [ROOT / n for n in names if n and (ROOT / n).is_file() and not (ROOT / n).is_symlink()]


def test_every_source_file_names_its_licence():
    code = [p for p in tracked() if p.suffix == ".py" or "nodes" in p.parts or p.suffix in (".sh", ".launch")]
    assert code and not [str(p.relative_to(ROOT)) for p in code if "SPDX-License-Identifier" not in p.read_text()[:300]]


def test_no_path_of_a_machine_stands_in_the_tree():
    pattern = re.compile(r"(?<![\w.$~/-])/(work|home/\w+|root)/")
    texts = [
        p for p in tracked() if p.suffix in {".py", ".sh", ".md", ".yaml", ".launch", ".rviz", ".toml", ".txt", ""}
    ]
    assert not [str(p.relative_to(ROOT)) for p in texts if pattern.search(p.read_text(errors="ignore"))]


def test_modules_stay_small_enough_to_read():
    """Style asks for less than 250 lines; a few may be longer for a reason, none by much."""
    long = {str(p.relative_to(ROOT)): n for pkg in BELOW for p in modules(pkg)
            if (n := len(p.read_text().splitlines())) > 300}  # fmt: skip
    assert not long


def test_linter():
    result = subprocess.run(
        [ROOT / ".venv/bin/ruff", "check", "src", "tests", "tools"], cwd=ROOT, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stdout[-3000:]


def tests_of_the_tree():
    found = sorted((ROOT / "tests").rglob("*.py"))
    assert len(found) > 50
    return found


def test_tests_import_no_other_tests():
    """What several tests share stands in tests/support; it imports no test either."""
    for path in tests_of_the_tree():
        whole = {m for m, _ in imports(path)}
        others = {m for m in whole if m.startswith("test_") or m == "conftest"} | (whole & {"tests"})
        assert not others, f"{path.relative_to(ROOT)} imports {others}; what tests share stands in tests/support"
    loose = {p.name for p in (ROOT / "tests").glob("*/*.py")} - {p.name for p in (ROOT / "tests/support").glob("*.py")}
    assert not {name for name in loose if not name.startswith("test_") and name not in ("conftest.py", "__init__.py")}

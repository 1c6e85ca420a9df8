# SPDX-License-Identifier: Apache-2.0
"""What tools/setup.sh and make refuse at once."""

import re
import shutil
import subprocess


def test_a_path_with_a_blank_is_refused_with_the_reason(root, tmp_path):
    there = tmp_path / "my work" / "tools"
    there.mkdir(parents=True)
    shutil.copy(root / "tools" / "setup.sh", there)
    done = subprocess.run(
        ["bash", str(there / "setup.sh")], capture_output=True, text=True, timeout=20
    )
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "holds a blank" in done.stderr and "move the folder" in done.stderr
    assert [p.name for p in there.parent.iterdir()] == ["tools"]


def make(root, *words):
    return subprocess.run(
        ["make", "-n", *words], cwd=root, capture_output=True, text=True, timeout=20
    )


def test_a_mistyped_variable_of_make_is_named(root):
    done = make(root, "demo", "MISSON=mine.yaml")
    assert (
        done.returncode == 2 and "no such variable: MISSON; known are SYSTEM MISSION" in done.stderr
    )
    assert make(root, "demo", "MISSION=mine.yaml", "ARGS=--faults 'a b' --n=3").returncode == 0


def test_make_help_names_every_target_that_users_start(root):
    said = make(root, "help").stdout
    rules = (root / "Makefile").read_text().split(".PHONY: help ")[1].splitlines()[0].split()
    assert not [target for target in rules if target not in re.split(r"[\s,:]+", said) + ["build"]]

# SPDX-License-Identifier: Apache-2.0
"""The launch-prefix that says which nodes a busy processor serves first."""

import os
import subprocess
import sys

import pytest

SHOW = "import os, sys; print(os.nice(0), open('/proc/self/autogroup').read().split()[-1], sys.argv[1:]); sys.exit(3)"
NOBODY = 65534


@pytest.fixture
def priority(root):
    return str(root / "src" / "fcsv_bringup" / "scripts" / "priority")


def shown(*command, **options):
    # as roslaunch does: a session is a group of its own
    options.setdefault("start_new_session", True)
    return subprocess.run(
        [*command, sys.executable, "-c", SHOW, "a b", "c"],
        capture_output=True,
        text=True,
        **options,
    )


@pytest.mark.skipif(
    not os.path.exists("/proc/self/autogroup"), reason="no autogroups in this kernel"
)
def test_process_and_session_get_the_share(priority):
    done = shown(priority, "7")
    assert done.stdout == "7 7 ['a b', 'c']\n" and done.returncode == 3 and not done.stderr


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root")
def test_root_may_be_served_first(priority):
    assert shown(priority, "-10").stdout.startswith("-10 ")


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become somebody else")
def test_who_may_not_be_served_first_runs_all_the_same(priority):
    shell = ["/bin/sh", "-c", 'exec /bin/sh "$0" -10 /bin/echo runs']
    done = subprocess.run(
        [*shell, priority],
        preexec_fn=lambda: os.setuid(NOBODY),
        capture_output=True,
        text=True,
        start_new_session=True,
        stdin=subprocess.DEVNULL,
        cwd="/",
    )
    assert done.stdout == "runs\n" and done.returncode == 0 and not done.stderr

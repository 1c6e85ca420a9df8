# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM while the ground is made: one line, and nothing is left of it."""

import signal
import subprocess
import sys

import pytest

from fcsv_guidance.files import command, folder

_DURING_A_KERNEL = """
import signal, sys, time
import numpy as np
from fcsv_guidance.ground import kernels

def handler(*_):
    raise KeyboardInterrupt

def until_interrupted(call):
    call()  # compiled
    signal.signal(signal.SIGALRM, handler)
    for _ in range(3):
        signal.setitimer(signal.ITIMER_REAL, 0.002)
        try:
            ends_s = time.monotonic() + 10.0
            while time.monotonic() < ends_s:
                call()
            sys.exit("no interrupt came")
        except KeyboardInterrupt:
            pass

n = 700
depth = np.full((n, n), 10.0, np.float32)
K = np.array([[n, 0, n / 2], [0, n, n / 2], [0, 0, 1.0]])
R, p, sigma = np.eye(3), np.zeros(3), np.full((n, n), 0.1, np.float32)
until_interrupted(lambda: kernels.rays_through(
    depth, sigma, K, R, p, 0.2, 60.0, 2.0, 1, np.full(3, -10.0), (100, 100, 100)))
print("interrupted")
"""


def test_an_interrupt_during_a_kernel_comes_after_it():
    """numba did not look whether Python code of its own was interrupted: status 139."""
    done = subprocess.run(
        [sys.executable, "-c", _DURING_A_KERNEL], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout.strip()) == (0, "interrupted"), done.stderr[-600:]


@pytest.mark.parametrize("number, status", [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize("is_there", [False, True])
def test_what_is_interrupted_while_it_writes_leaves_nothing(
    scene, write_map, root, tmp_path, capsys, monkeypatch, number, status, is_there
):
    """They left cut files under their final names."""
    write_map(scene().view(size=(320, 240)), tmp_path / "map")
    out = tmp_path / "out"
    if is_there:
        out.mkdir()

    def draw(*_):
        (partial,) = tmp_path.glob(".out.*")
        assert (partial / "height.tif").exists() and not (out / "height.tif").exists()
        signal.raise_signal(number)

    monkeypatch.setattr(folder, "draw", draw)
    robot = str(root / "config/robots/rescue.yaml")
    call = [str(tmp_path / "map"), "--robot", robot, "--cell-m", "0.2", "-o", str(out)]
    assert command.main(call) == status
    assert capsys.readouterr().err.endswith("ground: interrupted; nothing was written\n")
    assert sorted(p.name for p in tmp_path.iterdir()) == (["map", "out"] if is_there else ["map"])
    assert not is_there or not list(out.iterdir())
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    monkeypatch.undo()
    assert command.main(call) == 0 and (out / "ground.png").exists()


def test_a_link_to_an_empty_folder_is_filled(scene, write_map, root, tmp_path):
    write_map(scene().view(size=(320, 240)), tmp_path / "map")
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    robot = str(root / "config/robots/rescue.yaml")
    call = [str(tmp_path / "map"), "--robot", robot, "--cell-m", "0.2"]
    assert command.main([*call, "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out").is_symlink() and (tmp_path / "disk/ground.json").exists()

# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM while the ground is made: one line, and nothing is left of it."""

import subprocess
import sys

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

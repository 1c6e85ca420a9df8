# SPDX-License-Identifier: Apache-2.0
"""The study's nearest useful depth of a baseline, on made-up depths."""

import subprocess
import sys

_CODE = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
from nearest import nearest_by_truth
truth = np.geomspace(1.0, 64.0, 64000).reshape(160, 400)
depth = truth.copy()
depth[truth < 4.0] *= 1.3
print(nearest_by_truth(depth, truth, 64.0), nearest_by_truth(truth, truth, 64.0))
depth[(truth > 20.0) & (truth < 40.0)] = np.nan  # a hole further out: useful from behind it alone
print(nearest_by_truth(depth, truth, 64.0), nearest_by_truth(np.full_like(truth, np.nan), truth, 64.0))
"""


def test_it_is_the_near_end_of_the_bands_that_are_right_without_a_gap(root):
    done = subprocess.run(
        [sys.executable, "-c", _CODE, str(root / "tools/study")],
        capture_output=True,
        text=True,
        cwd=root,
    )
    near, whole, behind, none = map(float, done.stdout.split())
    assert abs(near - 4.0) < 0.1 and whole == 1.0, done.stderr
    assert 38.0 < behind < 48.0 and none != none

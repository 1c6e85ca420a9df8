# SPDX-License-Identifier: Apache-2.0
"""What tools/setup.sh refuses at once."""

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

# SPDX-License-Identifier: Apache-2.0
"""The bench that varies tuned numbers: what it varies, which kernels it compiles anew, what it
says of a change."""

import json
import os
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest

from bench import tuned_numbers as tool


def rows(*shares):
    return {str(n): [*shares, 1.0] for n in tool.SCENES}


@pytest.mark.parametrize("most", [1, 9])
def test_every_number_is_varied_to_other_values_and_back_from_json(most):
    found = list(tool.groups(most))
    assert sorted((g.stage, n) for g in found for n in g.numbers) == sorted(
        (type(s).__name__, f.name) for s in tool.STAGES for f in fields(s) if getattr(s, f.name)
    )
    assert max(len(g.numbers) for g in found) <= most
    for group in found:
        stage = next(s for s in tool.STAGES if type(s).__name__ == group.stage)
        one, other = group.both()
        assert one.key != other.key
        for (name, value), (_, other_value) in zip(one.values, other.values):
            assert json.loads(json.dumps(value)) == value
            now = getattr(stage, name)
            assert sorted([value, other_value]) == sorted(tool.varied(now)) and value != now


def kept(tmp_path, changes):
    """Results by group: its change of the first figure in its two runs."""
    for label, points in (("as it is", 90.0), ("drawn again", 90.1)):
        tool._keep(tool._kept(tmp_path), label, rows(points, 10.0, 95.0))
    for group, points in changes.items():
        for variation, p in zip(group.both(), points):
            tool._keep(tool._kept(tmp_path), variation.key, rows(90.0 + p, 10.0, 95.0))
    return tool._read(tmp_path)


def test_a_group_that_changes_nothing_speaks_for_its_numbers_and_another_is_halved(tmp_path):
    group = next(g for g in tool.groups(4) if len(g.numbers) == 4)
    left, right = group.cut(2)
    assert (*left.numbers, *right.numbers) == group.numbers
    alone = right.cut(2)[0]
    done = kept(tmp_path, {group: (0.0, 2.0), left: (0.0, 0.0), right: (3.0, 1.0), alone: (3.0, 0)})
    verdicts = {number: word for (_, number), (word, _) in tool.measured(done).items()}
    first, second, third, fourth = group.numbers
    assert verdicts == {
        first: "not reached",
        second: "not reached",
        third: "matters",
        fourth: "open",
    }


def test_only_kernels_that_a_stage_reaches_are_compiled_anew(tmp_path):
    reached = tool.reached("Select")
    assert "select" in reached and not {"census", "sgm", "moved", "winner"} & reached
    assert {"select", "reliability"} <= tool.reached("DataCost")
    kernels = [
        tmp_path / "surfaces_1" / f"{m}.k-1.py311.nb{e}" for m in ("select", "sgm") for e in "ic"
    ]
    kernels[0].parent.mkdir()
    for path in kernels:
        path.touch()
    tool._forget(tmp_path, reached)
    assert [p for p in kernels if p.exists()] == kernels[2:]


def test_what_a_change_means():
    base = rows(90.0, 10.0, 95.0)
    same, less, none = (tool.change(base, rows(90.0 - d, 10.0, 95.0)) for d in (0.1, 2.0, 0.0))
    error = np.full(3, 0.2)
    assert tool.verdict([none, none], error) == "not reached"
    assert tool.verdict([none, same], error) == "same"
    assert tool.verdict([less, same], error) == "matters"


def test_a_line_that_a_stop_cut_off_is_measured_again(tmp_path):
    tool._keep(tool._kept(tmp_path), "Select.p1=1.0", {"street 1": [1.0]})
    with tool._kept(tmp_path).open("a") as f:
        f.write('{"key": "Select.p2=')
    assert list(tool._read(tmp_path)) == ["Select.p1=1.0"]
    with pytest.raises(SystemExit):
        tool.main([str(tmp_path / "empty"), "--show"])


def test_the_number_is_changed_before_joint_freezes_it(root):
    program = (
        "from bench.one_variation import _set_before_joint as put\n"
        "put({'stage': 'Sky', 'values': {'bins': 7}})\n"
        "from fcsv_stereo.joint.checks import sky\n"
        "print(sky._BINS)"
    )
    path = os.pathsep.join([str(root / "tools"), os.environ.get("PYTHONPATH", "")])
    ended = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert ended.stdout.strip() == "7", ended.stderr

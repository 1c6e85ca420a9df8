# SPDX-License-Identifier: Apache-2.0
"""Rectified pairs by ``joint``, Pandora and SGBM, in the metrics that the field reports."""

from typing import Dict, List, Sequence

from bench import pandora_intervals
from bench.interval_maps import Answer, interval_table, joint_on, pair_rows, sgbm_on
from bench.rectified import rectified_cases
from bench.scenes import SceneName

_SAYS = """\
Motorcycle is a real pair, measured where it lies beside the checkout. Of the first scene of each
world a pair is drawn rectified, 4 m apart. All poses are exact: `joint` is told 0.01° and 0.1 % of
the baseline, and answers as it does without `--complete`. Its interval of 90 % is depth ± 1.645
sigma. That of Pandora (1.9.0, arranged as CARS does) holds all disparities with a possibility of
0.9 or more. Width: in disparity, and as a share of the depth. "Both": the pixels that `joint` and
Pandora answer. Pandora's seconds include the start of its process."""


def measure_pairs(scenes: Sequence[SceneName]) -> List[str]:
    """The page's lines."""
    why_not, rows = pandora_intervals.missing(), []
    first = {name.world: name for name in reversed(scenes)}
    for case in rectified_cases([name for name in scenes if first[name.world] == name]):
        if not rows:
            joint_on(case)  # kernels are compiled once and cached: that is not its time
        answers: Dict[str, Answer] = {"`joint`": joint_on(case)}
        if why_not is None:
            answers["Pandora"] = pandora_intervals.pandora_on(case)
        rows += pair_rows(case, {**answers, "SGBM": sgbm_on(case)})
        mine = [r for r in rows if r.pair == case.name]
        print("\n".join(f"    {r.pair}, {r.by}: {r.cells()}" for r in mine), flush=True)
    lines = [*interval_table(rows), "", *_SAYS.splitlines()]
    return lines if why_not is None else [*lines, "", f"Pandora is left out: {why_not}."]

# SPDX-License-Identifier: Apache-2.0
"""Leads from a range and an accepted error to a list of configurations in the mission file, by the
core of ``plan``."""

from dataclasses import dataclass
from typing import Optional, Tuple

import yaml

from fcsv_console.model.mission_file import Optics
from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.equations import parse_threshold
from fcsv_stereo.errors import StereoError
from fcsv_stereo.model import AXES
from fcsv_stereo.planning.mission import configuration_lines, mission_document
from fcsv_stereo.planning.plan import Plan, PlanRequest, make_plan


@dataclass(frozen=True)
class Wanted:
    """Holds what is wanted as the operator types it: range (m), error ("10%" or "0.5" m), how many
    baselines, axis ("both" too)."""

    range_m: float = 400.0
    error: str = "10%"
    number: int = 4
    axis: str = AXES[0]
    whole: bool = True


@dataclass(frozen=True)
class Planned:
    """``text``: the whole mission file; ``problem``: why there is none; ``notes``: what to know
    before it is flown."""

    text: str = ""
    problem: str = ""
    notes: Tuple[str, ...] = ()


def planned(wanted: Wanted, text: str, optics: Optics) -> Planned:
    """The mission file ``text`` with another list; all else in it stays as it was. A text without a
    list gets one.

    >>> planned(Wanted(240.0, "10%", 2), "name: a # mine\\nconfigurations: []\\n", Optics()).text.splitlines()[:2]
    ['name: a # mine', 'configurations:']
    >>> planned(Wanted(-3.0), "", Optics()).problem
    '--range-m -3 must be positive'
    """
    axes = tuple(AXES) if wanted.axis == "both" else (wanted.axis,)
    f_u, f_v = (optics.focal_along(axis) for axis in AXES)
    camera = PinholeCamera(
        optics.width, optics.height, f_u, f_v, optics.width / 2.0 - 0.5, optics.height / 2.0 - 0.5
    )
    try:
        request = PlanRequest(
            wanted.range_m,
            parse_threshold(wanted.error),
            camera,
            count=wanted.number,
            whole=wanted.whole,
            disparity_error_px=optics.disparity_error_px,
            axes=axes,
        )
        plan = make_plan(request)
        document = mission_document(plan, "planned")
    except (StereoError, ValueError) as error:
        return Planned(problem=str(error))
    lines = "".join(configuration_lines(document))
    whole = _with_list(text, lines)
    if _mapping(whole) is None:
        return Planned(
            problem="the file cannot take another list: write its keys one a line, without braces"
        )
    return Planned(whole, notes=(*plan.notes, *_farthest(plan), f"for {optics.words}"))


def _farthest(plan: Plan) -> Tuple[str, ...]:
    last = max(plan.baselines, key=lambda b: b.range_m[1])
    return (
        f"{len(plan.baselines)} configurations, to {last.range_m[1]:.0f} m, error there {last.error_m:.1f} m",
    )


def _with_list(text: str, lines: str) -> str:
    span = _span(text)
    if span is None:
        head = text if text.strip() and _mapping(text) is not None else "name: planned\n"
        return f"{head.rstrip()}\n{lines}"
    begin, end = span
    return text[:begin] + lines + text[end:].partition("\n")[2]


def _mapping(text: str) -> Optional[yaml.MappingNode]:
    try:
        node = yaml.compose(text)
    except yaml.YAMLError:
        return None
    return node if isinstance(node, yaml.MappingNode) else None


def _span(text: str) -> Optional[Tuple[int, int]]:
    """Where the list stands, its key with it."""
    node = _mapping(text)
    found = [
        (k.start_mark.index, _end(v))
        for k, v in (node.value if node else ())
        if k.value == "configurations"
    ]
    return found[0] if found else None


def _end(node: yaml.Node) -> int:
    """Gives the end of what is written of it: a block's own end lies behind the comments that
    follow it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return node.end_mark.index

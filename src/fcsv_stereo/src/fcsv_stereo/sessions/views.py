# SPDX-License-Identifier: Apache-2.0
"""The views of a session: from which stations and headings it was recorded."""

from pathlib import Path
from typing import Iterable, List

from fcsv_geometry.bags import reading
from fcsv_geometry.errors import BagError
from fcsv_stereo.errors import InputError
from fcsv_stereo.sessions.broadcasts import CAPTURE, TYPES
from fcsv_stereo.sessions.files import bags_of
from fcsv_stereo.sessions.messages import view_of


def session_views(path: Path) -> List[str]:
    """The views in the order in which they were recorded ("north at 90 deg"); none where the
    mission had no stations. Bags that cannot be read are named when they are mapped. Raises
    InputError where there is no bag."""
    captures = {}
    for bag in bags_of(path, []):
        wanted = lambda topic, kind: topic == CAPTURE and kind == TYPES[CAPTURE]  # noqa: E731
        try:
            for _, message in reading.messages(bag, wanted, lambda *_: None):
                captures[message.index] = message
        except BagError:
            continue
    return _views_of(captures[i] for i in sorted(captures))


def of_view(path: Path, captures: List, view: str) -> List:
    """The recordings of one view; "": all, where they are of one. Raises InputError naming the
    views."""
    views = _views_of(captures)
    known = ", ".join(f"'{v}'" for v in views)
    if not view and len(views) > 1:
        raise InputError(
            f"{path}: was recorded from {len(views)} views, {known}: choose one with --view, or join all with 'survey'"
        )
    if view and view not in views:
        has = f"it has {known}" if views else "its mission had no stations"
        raise InputError(f"--view: {path} has no view '{view}'; {has}")
    return [c for c in captures if not view or view_of(c) == view]


def _views_of(captures: Iterable) -> List[str]:
    return list(dict.fromkeys(v for v in map(view_of, captures) if v))

# SPDX-License-Identifier: Apache-2.0
"""Edges that were computed, kept in OUT/edges with the key of what went into them, so that a killed
survey goes on, and another view costs its own edges alone."""

import json
from collections import OrderedDict
from pathlib import Path
from typing import Optional

import numpy as np

from fcsv_geometry.programs.writing import write_whole
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.edges.edge import Edge, find_edge
from fcsv_stereo.survey.edges.features import Features, features_of
from fcsv_stereo.survey.views.view_file import ViewFile, digest

EDGES = "edges"
_MOST_FEATURES_KEPT = 64  # views, 3 MB each


def edge_path(a: ViewFile, b: ViewFile, out: Path) -> Path:
    """Where the edge of two views is kept."""
    return out.absolute() / EDGES / f"{a.name}--{b.name}.json"


def edge_key(a: ViewFile, b: ViewFile) -> str:
    """Key of what an edge is made of."""
    return digest([a.key, b.key])


def kept_edge(a: ViewFile, b: ViewFile, out: Path) -> Optional[Edge]:
    """The edge of two views as an earlier survey left it; None where it is of something else, or is
    not whole."""
    try:
        document = json.loads(edge_path(a, b, out).read_text())
        return _edge(document["edge"]) if document["key"] == edge_key(a, b) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def make_edge(a: ViewFile, b: ViewFile, out: Path, alike: bool) -> None:
    """A task: finds the edge of two views, as they are sent, and keeps it."""
    edge = find_edge(a, b, _features(a), _features(b), alike)
    document = {"key": edge_key(a, b), "edge": _document(edge)}
    write_whole(edge_path(a, b, out), json.dumps(document))


_FEATURES: "OrderedDict[str, Features]" = OrderedDict()


def _features(of: ViewFile) -> Features:
    """A view's features; a worker keeps those of the views that it met last, by content."""
    if of.key not in _FEATURES:
        _FEATURES[of.key] = features_of(of.load())
        while len(_FEATURES) > _MOST_FEATURES_KEPT:
            _FEATURES.popitem(last=False)
    _FEATURES.move_to_end(of.key)
    return _FEATURES[of.key]


def _document(e: Edge) -> dict:
    S = e.S_a_b
    return {
        "a": e.a,
        "b": e.b,
        **dict(zip(("R", "t", "scale"), (None,) * 3 if S is None else similarity.numbers(S))),
        "covariance": None if e.covariance is None else np.asarray(e.covariance).tolist(),
        "residual_m": e.residual_m,
        "matches": e.matches,
        "reason": e.reason,
    }


def _edge(d: dict) -> Edge:
    S = None if d["R"] is None else similarity.of_numbers(d["R"], d["t"], d["scale"])
    covariance = None if d["covariance"] is None else np.array(d["covariance"])
    return Edge(d["a"], d["b"], S, covariance, d["residual_m"], d["matches"], d["reason"])

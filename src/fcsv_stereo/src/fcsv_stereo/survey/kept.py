# SPDX-License-Identifier: Apache-2.0
"""Edges that were computed, kept in OUT/edges with the key of what went into them, so that a killed
survey goes on, and another view costs its own edges alone."""

import hashlib
import json
from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Optional

import gtsam
import numpy as np

from fcsv_geometry.programs.writing import write_whole
from fcsv_geometry.version import VERSION
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.edges import Edge, find_edge
from fcsv_stereo.survey.features import features_of
from fcsv_stereo.survey.station import Prior
from fcsv_stereo.survey.views import View, read_view

EDGES = "edges"
_MOST_FEATURES_KEPT = 64  # views, 3 MB each


@dataclass(frozen=True)
class ViewFile:
    """A view on the disk, small enough to be sent to a worker; ``key``: of all that it is made
    of."""

    folder: Path
    name: str
    source: str
    prior: Prior
    key: str

    def load(self) -> View:
        """Reads it. Raises SurveyError."""
        return read_view(self.folder, self.name, self.source, lambda *_: self.prior)


def view_file(view: View, folder: Path, content: str) -> ViewFile:
    """The file of a view whose map has the key ``content``."""
    p = view.prior
    numbers = [np.asarray(p.T_site_cam, float).tolist(), p.tilt_rad, p.yaw_rad, p.place_m, p.scale]
    key = _digest([content, numbers])
    return ViewFile(folder.absolute(), view.name, view.source, p, key)


def _digest(document: Any) -> str:
    tuned = {n: v for n, v in vars(tuning).items() if n.isupper()}
    words = json.dumps([VERSION, sorted(tuned.items()), document])
    return hashlib.sha256(words.encode()).hexdigest()


def edge_path(a: ViewFile, b: ViewFile, out: Path) -> Path:
    """Where the edge of two views is kept."""
    return out.absolute() / EDGES / f"{a.name}--{b.name}.json"


def edge_key(a: ViewFile, b: ViewFile) -> str:
    """Key of what an edge is made of."""
    return _digest([a.key, b.key])


def kept_edge(a: ViewFile, b: ViewFile, out: Path) -> Optional[Edge]:
    """The edge of two views as an earlier survey left it; None where it is of something else, or is
    not whole."""
    try:
        document = json.loads(edge_path(a, b, out).read_text())
        return _edge(document["edge"]) if document["key"] == edge_key(a, b) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def make_edge(a: ViewFile, b: ViewFile, out: Path) -> None:
    """A task: finds the edge of two views and keeps it."""
    (view_a, of_a), (view_b, of_b) = _with_features(a), _with_features(b)
    edge = find_edge(view_a, view_b, of_a, of_b)
    document = {"key": edge_key(a, b), "edge": _document(edge)}
    write_whole(edge_path(a, b, out), json.dumps(document))


_FEATURES: "OrderedDict[str, tuple]" = OrderedDict()


def _with_features(of: ViewFile) -> tuple:
    """The view and its features; a worker keeps those of the views that it met last, without their
    pixels. What is kept goes by content, which may have another name in another survey."""
    if of.key not in _FEATURES:
        view = of.load()
        _FEATURES[of.key] = (_light(view), features_of(view))
        while len(_FEATURES) > _MOST_FEATURES_KEPT:
            _FEATURES.popitem(last=False)
    _FEATURES.move_to_end(of.key)
    view, features = _FEATURES[of.key]
    return replace(view, name=of.name), features


@dataclass(frozen=True)
class _LightView:
    """What ``find_edge`` needs of a view."""

    name: str
    prior: Prior
    camera: Any


def _light(view: View) -> _LightView:
    return _LightView(view.name, view.prior, view.camera)


def _document(e: Edge) -> dict:
    S = e.S_a_b
    return {
        "a": e.a,
        "b": e.b,
        "R": None if S is None else S.rotation().matrix().tolist(),
        "t": None if S is None else np.asarray(S.translation()).tolist(),
        "scale": None if S is None else S.scale(),
        "covariance": None if e.covariance is None else np.asarray(e.covariance).tolist(),
        "residual_m": e.residual_m,
        "matches": e.matches,
        "reason": e.reason,
    }


def _edge(d: dict) -> Edge:
    S = None
    if d["R"] is not None:
        S = gtsam.Similarity3(gtsam.Rot3(np.array(d["R"])), np.array(d["t"]), d["scale"])
    covariance = None if d["covariance"] is None else np.array(d["covariance"])
    return Edge(d["a"], d["b"], S, covariance, d["residual_m"], d["matches"], d["reason"])

# SPDX-License-Identifier: Apache-2.0
"""Edges that were computed, kept in OUT/edges with the key of what went into them, so that a killed
survey goes on, and another view costs its own edges alone."""

import hashlib
import json
from collections import OrderedDict
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Optional

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.programs.writing import write_whole
from fcsv_geometry.version import VERSION
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.survey import similarity, tuning
from fcsv_stereo.survey.edges import Edge, find_edge
from fcsv_stereo.survey.features import Features, features_of
from fcsv_stereo.survey.station import Prior
from fcsv_stereo.survey.views import View, read_view

EDGES = "edges"
_OF_FILE = ("folder", "key")
_MOST_FEATURES_KEPT = 64  # views, 3 MB each


@dataclass(frozen=True)
class ViewFile:
    """A view on the disk, small enough to be sent to a worker: what ``View`` says, less its pixels.
    ``key``: of all that it is made of."""

    folder: Path
    key: str
    name: str
    source: str
    camera: PinholeCamera
    T_home_cam: np.ndarray
    prior: Prior
    picture: str
    taken_with: Optional[PinholeCamera]
    gps: Optional[Gps]
    gps_cam_m: np.ndarray
    sampled: np.ndarray
    corners: np.ndarray

    def sent(self) -> "ViewFile":
        """A copy for a task, without what tells overlaps: thousands of pairs wait to be sent."""
        return replace(self, sampled=self.sampled[:0])

    def load(self) -> View:
        """Reads it. Raises SurveyError."""
        view = read_view(self.folder, self.name, self.source, lambda *_: self.prior)
        return replace(view, taken_with=self.taken_with, gps=self.gps)


def view_file(view: View, folder: Path, content: str) -> ViewFile:
    """The file of a view whose map has the key ``content``."""
    p = view.prior
    numbers = [np.asarray(p.T_site_cam, float).tolist(), p.tilt_rad, p.yaw_rad, p.place_m, p.scale]
    same = {f.name: getattr(view, f.name) for f in fields(ViewFile) if f.name not in _OF_FILE}
    return ViewFile(folder.absolute(), digest([content, numbers]), **same)


def digest(document: Any) -> str:
    """Key of what goes into a result: the document, the program's version, its tuned numbers."""
    tuned = {n: v for n, v in vars(tuning).items() if n.isupper()}
    words = json.dumps([VERSION, sorted(tuned.items()), document])
    return hashlib.sha256(words.encode()).hexdigest()


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

# SPDX-License-Identifier: Apache-2.0
"""The maps of a flight's stations and headings, joined in flight as they come."""

from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_stereo.model import Cloud, MapResult
from fcsv_stereo.survey.edges.edge import Edge, find_edge
from fcsv_stereo.survey.edges.features import Features, features_of
from fcsv_stereo.survey.edges.pairs import pair_of
from fcsv_stereo.survey.placing.adjust import adjust
from fcsv_stereo.survey.surface import merge
from fcsv_stereo.survey.views.station import flown_prior
from fcsv_stereo.survey.views.view import View


@dataclass(frozen=True)
class JoinedViews:
    """The cloud (m, home) of so many ``views``; how many pairs of them are joined, of those that
    were compared."""

    cloud: Cloud
    views: int
    joined: int
    compared: int
    remarks: List[str]

    @property
    def words(self) -> str:
        """One line for people."""
        return f"{self.views} views, {self.joined} of {self.compared} pairs joined"


class LiveSite:
    """Keeps the newest whole map of each view, compares each pair once, and joins them as
    ``survey`` does; home stays the frame."""

    def __init__(self):
        self._views: Dict[str, View] = {}
        self._features: Dict[str, Features] = {}
        self._edges: Dict[Tuple[str, str], Optional[Edge]] = {}  # None: they cannot overlap
        self._news = False

    @property
    def due(self) -> bool:
        """Whether a map came since the last ``join``, and there are several."""
        return self._news and len(self._views) > 1

    def learn(self, name: str, result: MapResult) -> None:
        """Takes the whole map of a view in place of one of that ``name`` before; one without any
        sure depth is left out."""
        view = _view(name, result)
        for pair in [p for p in self._edges if name in p]:
            del self._edges[pair]
        self._views.pop(name, None)
        if view.known.any():
            self._views[name] = view
            self._features[name] = features_of(view)
        self._news = True

    def join(self) -> JoinedViews:
        """Compares what was not compared, and joins all. Raises StereoError."""
        self._news = False
        views = list(self._views.values())
        for i, a in enumerate(views):
            for b in views[i + 1 :]:
                if (a.name, b.name) not in self._edges:
                    self._edges[a.name, b.name] = self._compared(a, b)
        adjusted = adjust(views, [e for e in self._edges.values() if e is not None])
        cloud, _ = merge.join(views, adjusted.placed, np.zeros(3))
        joined = sum(e.kept for e in adjusted.edges)
        return JoinedViews(cloud, len(views), joined, len(adjusted.edges), adjusted.remarks)

    def _compared(self, a: View, b: View) -> Optional[Edge]:
        pair = pair_of(a, b)
        if pair is None:
            return None
        return find_edge(a, b, *(self._features[v.name] for v in (a, b)), pair.look_alike)


def _view(name: str, result: MapResult) -> View:
    """The view of a map in flight: its trackers say where it is in home."""
    r = result.reference
    prior = flown_prior(None, True, r.T_home_cam, name)
    arrays = r.image, result.depth, result.sigma, result.kind
    return View(name, "flight", *arrays, r.camera, r.T_home_cam, prior)

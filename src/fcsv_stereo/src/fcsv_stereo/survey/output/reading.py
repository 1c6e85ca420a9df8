# SPDX-License-Identifier: Apache-2.0
"""A survey's folder, read back for programs that go on from its views: each map where the
adjustment put it, loaded when it is asked for."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Tuple

import numpy as np

from fcsv_stereo.errors import InputError, SurveyError
from fcsv_stereo.survey import similarity
from fcsv_stereo.survey.placing.adjust import Placed
from fcsv_stereo.survey.surface.merge import SiteView, site_view
from fcsv_stereo.survey.tasks.maps import VIEWS
from fcsv_stereo.survey.views.inputs import SourceKind, kind_of
from fcsv_stereo.survey.views.station import Prior
from fcsv_stereo.survey.views.view import read_view

DOCUMENTS = ("site.json", "adjustment.json")


@dataclass(frozen=True)
class WrittenView:
    """A view of a finished survey: the folder of its map, where the adjustment put it, and what
    its input said of the map's scale (sigma, share)."""

    name: str
    folder: Path
    placed: Placed
    scale_sigma: float

    def load(self, origin_m: np.ndarray) -> SiteView:
        """The view in the site's metres less ``origin_m`` (3,). Raises SurveyError where its map is
        gone or is none."""

        def prior(T_home_cam: np.ndarray, name: str) -> Prior:
            return Prior(T_home_cam, 0.0, 0.0, 0.0, self.scale_sigma)

        view = read_view(self.folder, self.name, str(self.folder), prior)
        return site_view(view, self.placed, origin_m)


@dataclass(frozen=True)
class WrittenSite:
    """What a survey left in ``folder``; coordinates less ``origin_m`` (3,) fit into float32.
    ``crs`` is empty where the site has a frame of its own."""

    folder: Path
    views: Tuple[WrittenView, ...]
    origin_m: np.ndarray
    crs: str


def is_site(folder: Path) -> bool:
    """Whether a survey wrote the folder."""
    return all((Path(folder) / name).is_file() for name in DOCUMENTS)


def read_site(folder: Path) -> WrittenSite:
    """Raises SurveyError naming folder and what to do where it is no whole survey's."""
    folder = Path(folder)
    try:
        site, adjustment = (json.loads((folder / name).read_text()) for name in DOCUMENTS)
        views = tuple(_view(folder, v, adjustment["views"][v["name"]]) for v in site["views"])
        origin_m = np.array(site["origin"], float).reshape(3)
        return WrittenSite(folder, views, origin_m, site["crs"] or "")
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise SurveyError(
            f"{folder}: is not a whole survey of this version ({type(error).__name__}: {error}); run survey "
            "again, which costs no map that is there"
        ) from error


def _view(folder: Path, told: dict, adjusted: dict) -> WrittenView:
    S_site_cam = similarity.of_matrix(np.array(adjusted["S_site_cam"], float))
    covariances = (np.array(adjusted[f"covariance{of}"], float) for of in ("", "_to_datum"))
    placed = Placed(
        told["name"], S_site_cam, *covariances, bool(adjusted["alone"]), adjusted["datum"]
    )
    return WrittenView(told["name"], _map_of(folder, told), placed, float(adjusted["scale_sigma"]))


def _map_of(folder: Path, told: dict) -> Path:
    """The folder of a view's map: its input where that is one, else the survey's own."""
    given = Path(told["input"])
    try:
        if kind_of(given) is SourceKind.MAP:
            return given
    except InputError:
        pass  # the input was moved; the survey's own map is there still
    return folder / VIEWS / str(told["name"])

# SPDX-License-Identifier: Apache-2.0
"""A view on the disk, and keys of what results are made of."""

import hashlib
import json
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Optional

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.version import VERSION
from fcsv_stereo.photos.gps import Gps
from fcsv_stereo.survey import tuning
from fcsv_stereo.survey.views.station import Prior
from fcsv_stereo.survey.views.view import View, read_view

_OF_FILE = ("folder", "key")


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

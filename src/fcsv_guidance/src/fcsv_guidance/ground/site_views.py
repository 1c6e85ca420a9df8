# SPDX-License-Identifier: Apache-2.0
"""The views of folders as the ground model takes them; those of a survey in the site's metres less
its origin, and loaded when they are asked for."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Callable, Optional, Sequence, Tuple

import numpy as np

from fcsv_guidance.errors import GroundError
from fcsv_guidance.ground.views import DepthView, read_map, require_different
from fcsv_stereo.errors import SurveyError
from fcsv_stereo.survey.output.reading import is_site, read_site
from fcsv_stereo.survey.surface.merge import SiteView

_KEPT_VIEWS = 4


@dataclass(frozen=True)
class SitePlace:
    """What a site's coordinates in a grid lack: ``origin_m`` (3,), which the grid leaves out, and
    the reference system ``crs``, empty for a frame of its own."""

    crs: str
    origin_m: np.ndarray


class SiteDepthViews(Sequence[DepthView]):
    """Depth views of a site's ``names``; ``load(number)`` gives one, and the last few are kept.

    Depth is in the site's metres, and sigma holds what the adjustment leaves of scale, turn and
    place: what is unknown in a map stays unknown.
    """

    def __init__(self, names: Sequence[str], load: Callable[[int], SiteView]):
        self.names = tuple(names)
        self._loaded = lru_cache(_KEPT_VIEWS)(lambda number: depth_view_of(load(number)))

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, number):
        if isinstance(number, slice):
            raise TypeError("views of a site are loaded one by one")
        if not 0 <= number < len(self):
            raise IndexError(number)
        return self._loaded(number)


def depth_view_of(seen: SiteView) -> DepthView:
    """A view of a survey where the adjustment put it."""
    kind, T_site_cam = seen.view.kind, seen.T_site_cam
    return DepthView(seen.name, seen.depth, seen.sigma, kind, seen.camera.K, T_site_cam)


def read_views(folders: Sequence[str]) -> Tuple[Sequence[DepthView], Optional[SitePlace]]:
    """The views of folders that ``map`` wrote, or those of one that ``survey`` wrote with their
    place. Raises GroundError."""
    sites = [folder for folder in folders if is_site(Path(folder))]
    if sites and len(folders) > 1:
        raise GroundError(
            f"{sites[0]}: is a survey's, which stands alone; give its maps to survey, too"
        )
    if sites:
        return read_site_views(Path(sites[0]))
    views = [read_map(folder) for folder in folders]
    require_different(views)
    return views, None


def read_site_views(folder: Path) -> Tuple[SiteDepthViews, SitePlace]:
    """The views of the folder that ``survey`` wrote. Raises GroundError naming it."""
    try:
        site = read_site(folder)
    except SurveyError as error:
        raise GroundError(str(error)) from error
    names = [v.name for v in site.views]
    views = SiteDepthViews(names, lambda number: site.views[number].load(site.origin_m))
    return views, SitePlace(site.crs, site.origin_m)

# SPDX-License-Identifier: Apache-2.0
"""Products of a site that are asked for by name: MCAP, a mesh, the ground of a robot."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Dict, List, Optional, Tuple

import numpy as np

from fcsv_geometry.errors import FcsvError
from fcsv_stereo.errors import SurveyError
from fcsv_stereo.products.ground import check_robot, write_site_ground
from fcsv_stereo.survey.document import Missing, Site
from fcsv_stereo.survey.output import recording
from fcsv_stereo.survey.surface import mesh
from fcsv_stereo.survey.surface.merge import SiteView, site_view
from fcsv_stereo.survey.surface.rasters import read_rasters

#: product: its file or folder in OUT/
EXTRAS = {"mcap": "site.mcap", "mesh": "site.glb", "ground": "ground"}
#: what "all" stands for: ground is of one robot, and is named
ALL = ("mcap", "mesh")


@dataclass(frozen=True)
class ExtraOptions:
    """Products of ``EXTRAS`` by name; ``robot``: the file of the robot that ground is for;
    ``mesh_sigma_m``: sigma below which a depth is in the mesh, None for the median of the cloud's.

    Raises InputError, SurveyError, or ConfigError naming file and field on what cannot be made.
    """

    names: Tuple[str, ...] = ()
    robot: Optional[Path] = None
    mesh_sigma_m: Optional[float] = None

    def __post_init__(self):
        check_robot(self.names, self.robot)
        bound_m = self.mesh_sigma_m
        if bound_m is not None and "mesh" not in self.names:
            raise SurveyError("--mesh-sigma-m is of the product mesh; add --products mesh")
        if bound_m is not None and not 0.0 < bound_m < np.inf:
            raise SurveyError(f"--mesh-sigma-m: must be above 0 m, got {bound_m}")
        if "mesh" in self.names:
            mesh.check_libraries()
        if "mcap" in self.names:
            recording.check_library()


def parse_extras(text: str) -> Tuple[str, ...]:
    """Names out of "mcap,mesh" or "all"; none out of "". Raises SurveyError on one that is none.

    >>> parse_extras("mesh, mcap"), parse_extras("all"), parse_extras("")
    (('mcap', 'mesh'), ('mcap', 'mesh'), ())
    """
    names = [w.strip() for w in text.split(",") if w.strip()]
    if names == ["all"]:
        return ALL
    for name in names:
        if name not in EXTRAS:
            raise SurveyError(f"--products: '{name}' is not one of {', '.join(EXTRAS)}, all")
    return tuple(p for p in EXTRAS if p in names)


def write_extras(site: Site, options: ExtraOptions, folder: Path) -> Site:
    """The products into ``folder``: the site with a line on each, and with those that could not be
    made as missing. Raises OSError."""
    lines: Dict[str, str] = {}
    missing: List[Missing] = []
    for name in options.names:
        try:
            if not site.count:
                raise SurveyError("no view tells a point; see why in what else is missing")
            lines[EXTRAS[name]] = _write(name, site, options, folder / EXTRAS[name])
        except FcsvError as error:
            missing.append(Missing(EXTRAS[name], "", str(error)))
    return replace(site, extras=lines, missing=[*site.missing, *missing])


def _write(name: str, site: Site, options: ExtraOptions, path: Path) -> str:
    placed = site.adjusted.placed
    views = [v for v in site.views if v.name in placed]

    def load(number: int) -> SiteView:
        return site_view(views[number].load(), placed[views[number].name], site.origin_m)

    if name == "mcap":
        recording.write_recording(site, read_rasters(path.parent), path)
        return "points, surface, orthophoto, stations, edges, pictures"
    if name == "mesh":
        bound_m = options.mesh_sigma_m or site.median_sigma_m
        count = mesh.write_mesh(map(load, range(len(views))), path, bound_m)
        return f"{count:,} triangles of what is surer than {bound_m:.2g} m"
    crs, robot = site.crs, options.robot
    names = [v.name for v in views]
    return write_site_ground(names, load, (crs, site.origin_m), robot, path)

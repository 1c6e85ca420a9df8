# SPDX-License-Identifier: Apache-2.0
"""The product ``ground``: where a robot can stand. fcsv_guidance makes it, which stands above this
package and is called by name."""

import base64
import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Optional, Sequence, Tuple

import cv2
import numpy as np

from fcsv_stereo.errors import InputError
from fcsv_stereo.model import MapResult

_MAKER = "fcsv_guidance.files.product"


@dataclass(frozen=True)
class GroundShown:
    """Holds, for the report: one line, and the picture from above (JPEG in base64)."""

    summary: str
    jpeg: str

    def to_dict(self) -> dict:
        """Gives it for report.json."""
        return {"summary": self.summary}


def check_robot(products: Sequence[str], robot: Optional[Path]) -> None:
    """Checks, before anything is mapped: ``ground`` needs a robot's file, and only ground has use
    for one.

    Raises InputError, and ConfigError naming file and field.
    """
    if "ground" in products and robot is None:
        raise InputError(
            "the product ground needs a robot; add --robot FILE (config/robots/NAME.yaml)"
        )
    if robot is not None and "ground" not in products:
        raise InputError("--robot is of the product ground; add --products ground")
    if robot is not None:
        _maker().load_robot(robot)


def write_ground(result: MapResult, robot: Path, folder: Path) -> GroundShown:
    """All files of ``ground`` into ``folder``. Raises FcsvError where the map has no ground;
    OSError."""
    summary, picture = _maker().write(result, robot, folder)
    _, jpeg = cv2.imencode(".jpg", cv2.imread(str(picture)))
    return GroundShown(summary, base64.b64encode(jpeg.tobytes()).decode())


def write_site_ground(
    names: Sequence[str],
    load: Callable[[int], Any],
    place: Tuple[str, np.ndarray],
    robot: Optional[Path],
    folder: Path,
) -> str:
    """All files of ``ground`` of a survey's views into ``folder``: one line on it. ``load`` gives a
    view (survey.surface.SiteView) by its number, ``place`` is the reference system and the origin (3,)
    that views leave out. Raises FcsvError where the site has no ground; OSError."""
    return str(_maker().write_site(names, load, place, robot, folder))


def _maker():
    try:
        return importlib.import_module(_MAKER)
    except ModuleNotFoundError as error:
        raise InputError(
            f"the product ground needs the package fcsv_guidance ({error}); build it, too"
        ) from error

# SPDX-License-Identifier: Apache-2.0
"""``priors.csv`` beside ``images.txt``: how well the pose of each photograph is known.

    name,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg
    0001.jpg,0.02,0.02,0.03,0.1,0.1,0.2

Standard deviations: of the camera's position along the model's axes, and of a small turn about each of them. Errors of
two pictures count as independent.
"""

import csv
from pathlib import Path
from typing import Collection, Dict

import numpy as np

from fcsv_stereo.errors import InputError

FILE = "priors.csv"
_COLUMNS = ("x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg")


def read_priors(path: Path, names: Collection[str]) -> Dict[str, np.ndarray]:
    """(6, 6) covariances in home (``pose_covariance``) by picture; every one of ``names`` must have one.

    Raises InputError naming the line that is wrong.
    """
    found: Dict[str, np.ndarray] = {}
    with open(path, newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file)
        if tuple(reader.fieldnames or ()) != ("name", *_COLUMNS):
            raise InputError(f"{path}, line 1: the columns must be name,{','.join(_COLUMNS)}")
        for row in reader:
            where, name = f"{path}, line {reader.line_num}", row["name"]
            if name not in names:
                raise InputError(f"{where}: '{name}' is not in images.txt")
            if name in found:
                raise InputError(f"{where}: '{name}' stands there twice")
            found[name] = np.diag(np.square(_sigmas(row, where)))
    lacking = sorted(set(names) - set(found))
    if lacking:
        raise InputError(f"{path}: says nothing of {lacking[0]}; give every picture of images.txt a line")
    return found


def _sigmas(row: Dict[str, str], where: str) -> np.ndarray:
    """(6,) m and rad."""
    try:
        values = np.array([float(row[c]) for c in _COLUMNS])
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: not six numbers ({error})") from error
    if not np.isfinite(values).all() or values.min() <= 0.0:
        raise InputError(f"{where}: standard deviations must be above zero")
    return np.concatenate([values[:3], np.radians(values[3:])])

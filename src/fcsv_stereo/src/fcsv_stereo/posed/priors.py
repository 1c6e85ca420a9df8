# SPDX-License-Identifier: Apache-2.0
"""``priors.csv`` beside ``images.txt``: how well the pose of each photograph is known.

    name,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg,scale_sigma
    0001.jpg,0.02,0.02,0.03,0.1,0.1,0.2,0.015

A name with a comma stands in double quotes (RFC 4180). Standard deviations: of the camera's
position along the model's axes, and of a small turn about each of them. Errors of two pictures
count as independent. The last column may be missing: of the scale of the whole model, a share and
the same in every line, because its error is one for all.
"""

import csv
from pathlib import Path
from typing import Collection, Dict, Optional, Sequence, Tuple

import numpy as np

from fcsv_stereo.errors import InputError
from fcsv_stereo.posed.colmap_images import same_name
from fcsv_stereo.posed.text import text_of

FILE = "priors.csv"
COLUMNS, SCALE = ("name", "x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg"), "scale_sigma"


def read_priors(path: Path, names: Collection[str]) -> Tuple[Dict[str, np.ndarray], float]:
    """(6, 6) covariances in home (``pose_covariance``) by picture, and the scale's standard
    deviation (a share, 0 without its column). Every one of ``names`` must have a line.

    Raises InputError naming the line that is wrong.
    """
    found: Dict[str, np.ndarray] = {}
    scale_sigma: Optional[float] = None
    known = {same_name(n): n for n in names}
    reader = csv.reader(text_of(path).splitlines(), skipinitialspace=False)
    columns = tuple(next(reader, ()))
    if columns not in (COLUMNS, (*COLUMNS, SCALE)):
        raise InputError(
            f"{path}, line 1: the columns must be {','.join(COLUMNS)} and may end with {SCALE}"
        )
    for words in reader:
        if not any(words):
            continue
        row, where = _row(words, columns), f"{path}, line {reader.line_num}"
        name = known.get(same_name(row["name"]))
        if name is None:
            raise InputError(f"{where}: '{row['name']}' is not in images.txt")
        if name in found:
            raise InputError(f"{where}: '{name}' stands there twice")
        found[name] = np.diag(np.square(_sigmas(row, where)))
        if SCALE in columns:
            scale_sigma = _scale(row, where, scale_sigma)
    lacking = sorted(set(names) - set(found))
    if lacking:
        raise InputError(
            f"{path}: says nothing of {lacking[0]}; give every picture of images.txt a line"
        )
    return found, scale_sigma or 0.0


def _row(words: Sequence[str], columns: Sequence[str]) -> Dict[str, str]:
    """Reads a row by column; a name may hold commas, in quotes or without.

    >>> _row(["DJI", " 1.JPG", "0.1"], ("name", "x_m"))
    {'name': 'DJI, 1.JPG', 'x_m': '0.1'}
    """
    end = max(1, len(words) - len(columns) + 1)
    return dict(zip(columns, [",".join(words[:end]), *words[end:]]))


def write_priors(path: Path, sigmas: Dict[str, Sequence[float]], scale_sigma: float) -> None:
    """``sigmas``: by picture x_m, y_m, z_m, roll_deg, pitch_deg, yaw_deg. Names may hold commas and
    quotes."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*COLUMNS, SCALE])
        for name, values in sigmas.items():
            writer.writerow([name, *(f"{v:.6g}" for v in values), f"{scale_sigma:.6g}"])


def _scale(row: Dict[str, str], where: str, before: Optional[float]) -> float:
    try:
        value = float(row[SCALE])
    except (KeyError, ValueError) as error:
        raise InputError(f"{where}: {SCALE} is no number ({error})") from error
    if not 0.0 <= value < 1.0:
        raise InputError(f"{where}: {SCALE} is a share of the scale, 0 to below 1")
    if before is not None and value != before:
        raise InputError(f"{where}: {SCALE} must be the same in every line, it is one scale")
    return value


def _sigmas(row: Dict[str, str], where: str) -> np.ndarray:
    """(6,) m and rad."""
    try:
        values = np.array([float(row[c]) for c in COLUMNS[1:]])
    except (KeyError, ValueError) as error:
        raise InputError(f"{where}: not six numbers ({error})") from error
    if not np.isfinite(values).all() or values.min() <= 0.0:
        raise InputError(f"{where}: standard deviations must be above zero")
    return np.concatenate([values[:3], np.radians(values[3:])])

# SPDX-License-Identifier: Apache-2.0
"""Poses of a text file of TUM's format: ``stamp x y z qx qy qz qw`` a line (s, m), ``#`` before a
comment.
"""

from pathlib import Path
from typing import List, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.errors import GeometryError
from fcsv_stereo.errors import InputError
from fcsv_stereo.posed.text import text_of


def read_tum(path: Path) -> List[Tuple[float, np.ndarray]]:
    """Stamp (s) and T_world_body of each line. Raises InputError naming the line that is none."""
    found = []
    for number, line in enumerate(text_of(path).splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        where = f"{path}, line {number}"
        try:
            stamp_s, *values = map(float, words)
        except ValueError as error:
            raise InputError(
                f"{where}: not eight numbers (stamp x y z qx qy qz qw): {error}"
            ) from error
        if len(values) != 7 or not np.isfinite(stamp_s):
            raise InputError(
                f"{where}: {len(words)} numbers where TUM's format has 8 (stamp x y z qx qy qz qw)"
            )
        try:
            found.append((stamp_s, transforms.from_xyz_quaternion(values[:3], values[3:])))
        except GeometryError as error:
            raise InputError(f"{where}: {error}") from error
    if not found:
        raise InputError(f"{path}: holds no pose")
    return found

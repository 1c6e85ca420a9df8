# SPDX-License-Identifier: Apache-2.0
"""Reads what a map's folder says of its reference picture, for programs that go on from maps."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Optional

import numpy as np

from fcsv_stereo.errors import InputError


@dataclass(frozen=True)
class ReadMap:
    """``depth`` and ``sigma`` (H,W) m, NaN where none; ``kind`` (H,W) uint8 of ``model.kinds``;
    ``K`` 3x3 px; ``T_home_cam`` 4x4; ``stamp_s`` NaN where the map does not say it (before version
    0.3); ``reference`` as report.json has it, and ``gps``, where it has it."""

    depth: np.ndarray
    sigma: np.ndarray
    kind: np.ndarray
    K: np.ndarray
    T_home_cam: np.ndarray
    stamp_s: float
    reference: dict
    gps: Optional[dict] = None


def read_map_folder(folder) -> ReadMap:
    """Reads the folder that ``map`` wrote. Raises InputError naming folder and file."""
    folder = Path(folder)
    try:
        document = json.loads((folder / "report.json").read_text())
        reference = document["reference"]
        fx, fy, cx, cy = (float(reference[name]) for name in ("fx", "fy", "cx", "cy"))
        return ReadMap(
            *(np.load(folder / f"{name}.npy") for name in ("depth", "sigma", "kind")),
            K=np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
            T_home_cam=np.array(reference["T_home_cam"], float),
            stamp_s=float(reference.get("stamp_s", np.nan)),
            reference=reference,
            gps=document.get("gps"),
        )
    except FileNotFoundError as error:
        raise InputError(
            f"{folder}: has no {Path(error.filename).name}; give a folder that 'map' wrote with -o"
        ) from error
    except (KeyError, TypeError, ValueError, OSError, EOFError) as error:
        raise InputError(f"{folder}: is not a map of this program ({error})") from error

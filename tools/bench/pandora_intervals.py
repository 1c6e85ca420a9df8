# SPDX-License-Identifier: Apache-2.0
"""Pandora (CNES) on rectified pairs, by its own command in an environment of its own.

Pandora is arranged as CARS does: census cost, semi-global matching, then intervals of possibility
0.9 from the cost volume (Malinowski et al. 2024), regularised where ambiguity is high. All numbers
are Pandora's defaults but the range of disparities, which is that of the truth, a tenth wider.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Dict, Optional, Union

import cv2
import numpy as np
import tifffile

from bench.interval_maps import IntervalMap
from bench.rectified import RectifiedCase

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = ROOT / "build" / "pandora"
REQUIREMENTS = Path(__file__).resolve().parent / "requirements-pandora.txt"
_INSTALL = "make bench ARGS=--install-pandora makes it, by Python 3.10 or newer"
_MARGIN = 0.1
_INVALID = 0b1111000011  # bits of its validity mask that call a pixel invalid; the others inform
_LOW, _HIGH = 1, 2  # bands of its confidence measures; band 0 is ambiguity
_PIPELINE = {
    "matching_cost": {"matching_cost_method": "census"},
    "optimization": {"optimization_method": "sgm"},
    "cost_volume_confidence.ambiguity": {"confidence_method": "ambiguity"},
    "cost_volume_confidence.interval": {
        "confidence_method": "interval_bounds",
        "possibility_threshold": 0.9,
    },
    "disparity": {"disparity_method": "wta", "invalid_disparity": "NaN"},
    "refinement": {"refinement_method": "vfit"},
    "filter": {"filter_method": "median"},
    "filter.interval": {
        "filter_method": "median_for_intervals",
        "interval_indicator": "interval",
        "regularization": True,
        "ambiguity_indicator": "ambiguity",
    },
    "validation": {"validation_method": "cross_checking_accurate"},
}


def missing() -> Optional[str]:
    """Why Pandora cannot be run; None where it can."""
    if not _python().is_file():
        return f"there is no {ENVIRONMENT.relative_to(ROOT)}; {_INSTALL}"
    done = _run("-c", "import pandora, pandora_plugin_libsgm")
    if done.returncode == 0:
        return None
    return f"pandora cannot be imported ({_last_line(done)}); {_INSTALL}"


def install() -> None:
    """Make the environment, or bring it to what is pinned. Raises SystemExit."""
    steps = [[sys.executable, "-m", "venv", str(ENVIRONMENT)]] if not _python().is_file() else []
    pip = ["-m", "pip", "install", "-q", "--disable-pip-version-check", "-r", str(REQUIREMENTS)]
    for step in [*steps, [str(_python()), *pip]]:
        done = subprocess.run(step, capture_output=True, text=True)
        if done.returncode != 0:
            raise SystemExit(f"Pandora's environment cannot be made: {_last_line(done)}")


def pandora_on(case: RectifiedCase) -> Union[IntervalMap, str]:
    """Its depths and intervals, or a text that says why it failed. Seconds are its process's."""
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder)
        for side, picture in (("left", case.left), ("right", case.right)):
            cv2.imwrite(str(at / f"{side}.png"), cv2.cvtColor(picture.image, cv2.COLOR_RGB2GRAY))
        (at / "config.json").write_text(json.dumps(_configuration(case, at)))
        before = _children_seconds()
        done = _run(str(_python().with_name("pandora")), str(at / "config.json"), str(at / "out"))
        if done.returncode != 0:
            return f"Pandora failed: {_last_line(done)}"
        seconds = _children_seconds() - before
        names = ("disparity", "confidence_measure", "validity_mask")
        read: Dict[str, np.ndarray] = {
            n: tifffile.imread(at / "out" / f"left_{n}.tif") for n in names
        }
    disparity, confidence = -read["disparity"], -read["confidence_measure"]
    valid = (read["validity_mask"] & _INVALID) == 0
    low_px, high_px = confidence[..., _HIGH], confidence[..., _LOW]
    disparity = np.where(valid, disparity, np.nan)
    return IntervalMap.of_disparity(case, disparity, low_px, high_px, seconds)


def _configuration(case: RectifiedCase, at: Path) -> dict:
    """Pandora's disparities are columns in the right picture less columns in the left one."""
    disparity = case.disparity(case.true_depth[np.isfinite(case.true_depth)])
    low, high = (float(d) for d in (disparity.min(), disparity.max()))
    low, high = low - _MARGIN * abs(low), high + _MARGIN * abs(high)
    span = [-int(np.ceil(high)), -int(np.floor(low))]
    left, right = ({"img": str(at / f"{side}.png")} for side in ("left", "right"))
    return {"input": {"left": {**left, "disp": span}, "right": right}, "pipeline": _PIPELINE}


def _python() -> Path:
    return ENVIRONMENT / "bin" / "python"


def _run(*arguments: str) -> subprocess.CompletedProcess:
    """Isolated: what PYTHONPATH names is compiled for our numpy."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    command = [str(_python()), "-I", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment)


def _children_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _last_line(done: subprocess.CompletedProcess) -> str:
    return (done.stderr.strip().splitlines() or ["no reason given"])[-1]

# SPDX-License-Identifier: Apache-2.0
"""From an input to OUT/: load, map with a method, evaluate against truth where there is one, write."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Optional, Tuple

import numpy as np

from fcsv_geometry.writing import require_folder
from fcsv_stereo import colmap, instants, output
from fcsv_stereo.cloud_bounds import CloudBounds, bound_cloud
from fcsv_stereo.errors import InputError
from fcsv_stereo.evaluation import evaluate
from fcsv_stereo.joint import Joint
from fcsv_stereo.local_origin import with_local_origin
from fcsv_stereo.model import MapInput, MapResult, Method, Progress
from fcsv_stereo.near import with_near
from fcsv_stereo.picture_list import spare
from fcsv_stereo.poi import FILE as POI_FILE
from fcsv_stereo.poi import load_points, sample
from fcsv_stereo.products import ProductsAsked, write_products
from fcsv_stereo.report import write_report
from fcsv_stereo.report.charts import STEPS
from fcsv_stereo.report.origin import Origin
from fcsv_stereo.sessions import is_session, read_session
from fcsv_stereo.staging import StagedFolder
from fcsv_stereo.thesis import Thesis
from fcsv_stereo.truth import TrueScene, Truth, load_truth

#: by name; another method is another entry
METHODS: Dict[str, Method] = {m.name: m for m in (Joint(), Thesis())}
DEFAULT_METHOD = Joint.name
_NO_PRODUCTS = ProductsAsked()
_LEAST_MIB = 20  # a small map's


def load(path: Path, reference: Optional[str] = None) -> MapInput:
    """A session folder, a bag, or posed photographs, these near a local origin. Raises InputError."""
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    if is_session(path):
        if reference is not None:
            raise InputError("--reference chooses among photographs; a session has its reference vehicle")
        return read_session(path)
    if path.is_dir() and colmap.is_model(path):
        return with_local_origin(colmap.read_photographs(path, reference))
    raise InputError(f"{path}: is neither a session (session.yaml or bags) nor posed photographs (images/, images.txt)")


def run(
    path: Path,
    out: Path,
    method: str,
    options: Any,
    reference: Optional[str],
    progress: Progress,
    poi: Optional[Path] = None,
    products: ProductsAsked = _NO_PRODUCTS,
    instant: Optional[str] = None,
    bounds: Optional[CloudBounds] = None,
    near: bool = True,
    command: str = "",
) -> dict:
    """Map ``path`` into ``out``; the report's document. Raises StereoError, and then nothing is written.

    ``options`` are of the method's ``options`` class. ``poi`` names a file of points of interest; a session may hold
    one (poi.yaml). ``products`` are written besides. ``instant``: only pictures of one, ``last`` or a stamp (s).
    ``bounds`` are those of the cloud (None: its defaults). ``near``: join what depth cameras saw, where a session holds
    it (docs/user/maps.md). ``command``: what the user gave, for the report.
    """
    started = time.perf_counter()
    output.check_out(out)
    products.check()
    require_folder(out.absolute().parent, _LEAST_MIB)
    points = load_points(poi or path / POI_FILE) if poi or (path / POI_FILE).is_file() else []
    given = load(path, reference)
    if instant is not None:
        given = instants.of_one_instant(given, None if instant == "last" else float(instant))
    loaded = time.perf_counter()
    result = replace(METHODS[method].map(given, options, progress), skews_s=instants.skews(given), clocks=given.clocks)
    result = replace(result, spare=spare(given, result), origin_m=given.origin_m)
    result = bound_cloud(result, bounds or CloudBounds())
    result = with_near(result, given) if near else result
    result.timing_s["load"] = loaded - started
    truth, true_depth, on = _truth(given, result)
    with StagedFolder(out, output.check_out) as staged:
        writing = time.perf_counter()
        output.write_arrays(result, staged.folder)
        result.timing_s["write"] = time.perf_counter() - writing
        result.timing_s["total"] = sum(result.timing_s[k] for k in STEPS if k in result.timing_s)
        write_products(products.names, result, given, staged.folder, products.robot)
        evaluation = evaluate(result, truth, true_depth, on=on) if truth else None
        sampled = sample(result, points, true_depth)
        document = output.report_document(result, evaluation)
        if sampled:
            document["points_of_interest"] = [p.to_dict() for p in sampled]
        output.write_report_json(document, staged.folder)
        origin = Origin.of(path, command, time.time())
        write_report(result, staged.folder, evaluation, true_depth, sampled, origin)
    return document


def _truth(given: MapInput, result: MapResult) -> Tuple[Optional[Truth], Optional[np.ndarray], Dict[str, np.ndarray]]:
    """The truth, the true depth of the reference picture, where both are known, and what moves in it.

    A truth/ that is not whole, as an interrupted simulation leaves it, is a warning of the map: it was made without.
    """
    if given.truth_folder is None:
        return None, None, {}
    reference = result.reference
    try:
        truth = load_truth(given.truth_folder)
        true_depth, on = TrueScene(truth).look(reference.vehicle, reference.stamp_s, reference.camera)
        for image in result.images:
            truth.T_world_cam(image.vehicle, image.stamp_s)
    except InputError as error:
        result.warnings.append(f"not compared with truth: {error}")
        return None, None, {}
    return truth, true_depth, on

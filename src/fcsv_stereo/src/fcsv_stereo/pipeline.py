# SPDX-License-Identifier: Apache-2.0
"""Leads from an input to OUT/: load, map with a method, evaluate against truth where there is one,
write."""

import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from fcsv_geometry.programs.writing import require_folder
from fcsv_stereo import instants
from fcsv_stereo.errors import InputError
from fcsv_stereo.evaluating.evaluation import evaluate
from fcsv_stereo.evaluating.poi import FILE as POI_FILE
from fcsv_stereo.evaluating.poi import PointOfInterest, load_points, sample
from fcsv_stereo.evaluating.truth import TrueScene, Truth, load_truth
from fcsv_stereo.joint import Joint
from fcsv_stereo.map_files import output
from fcsv_stereo.map_files.cloud_bounds import CloudBounds, bound_cloud
from fcsv_stereo.map_files.picture_list import spare
from fcsv_stereo.map_files.staging import StagedFolder
from fcsv_stereo.model import MapInput, MapResult, Method, Progress, part, silent
from fcsv_stereo.near import with_near
from fcsv_stereo.posed import colmap
from fcsv_stereo.posed.local_origin import with_local_origin
from fcsv_stereo.products import check_robot, write_products
from fcsv_stereo.report import write_report
from fcsv_stereo.report.charts import STEPS
from fcsv_stereo.report.origin import Origin
from fcsv_stereo.sessions import is_session, read_session
from fcsv_stereo.thesis import Thesis

#: by name; another method is another entry
METHODS: Dict[str, Method] = {m.name: m for m in (Joint(), Thesis())}
DEFAULT_METHOD = Joint.name
_LEAST_MIB = 20  # a small map's
_MAPPED, _WRITTEN = 0.72, 0.77  # of a map's time, for those who wait


def load(path: Path, reference: Optional[str] = None, view: str = "") -> MapInput:
    """A session folder, a bag, or posed photographs, these near a local origin; ``view``: of a
    session with several. Raises InputError."""
    if not path.exists():
        raise InputError(f"{path}: does not exist")
    if is_session(path):
        if reference is not None:
            raise InputError(
                "--reference chooses among photographs; a session has its reference vehicle"
            )
        return read_session(path, view)
    if view:
        raise InputError("--view chooses among a session's views; photographs have --reference")
    if path.is_dir() and colmap.is_model(path):
        return with_local_origin(colmap.read_photographs(path, reference))
    raise InputError(
        f"{path}: is neither a session (session.yaml or bags) nor posed photographs (images/, images.txt)"
    )


@dataclass(frozen=True)
class MapRequest:
    """What is mapped, how, and what is written.

    ``options`` are of the method's ``options`` class (None: its defaults). ``reference`` names the
    reference picture of photographs, ``view`` one of a session's views. ``poi`` is a file of points
    of interest; a session may hold one (poi.yaml). ``products`` are written besides. ``instant``:
    only pictures of one, ``last`` or a stamp (s). ``bounds`` are those of the cloud. ``near``: join
    what depth cameras saw, where a session holds it (docs/user/maps.md). ``command``: what the user
    gave, for the report. ``robot``: a robot's file, for the product ground.
    """

    path: Path
    out: Path
    method: str = DEFAULT_METHOD
    options: Any = None
    reference: Optional[str] = None
    view: str = ""
    poi: Optional[Path] = None
    products: Sequence[str] = ()
    instant: Optional[str] = None
    bounds: CloudBounds = field(default_factory=CloudBounds)
    near: bool = True
    command: str = ""
    robot: Optional[Path] = None

    def points_of_interest(self) -> List[PointOfInterest]:
        """Loads the points from ``poi``, or from the input's own file; none where neither is there.
        Raises InputError."""
        file = self.poi or self.path / POI_FILE
        return load_points(file) if self.poi or file.is_file() else []


def run(request: MapRequest, progress: Progress = silent) -> dict:
    """Map what is requested; the report's document. Raises StereoError, and then nothing is
    written."""
    started, out = time.perf_counter(), request.out
    output.check_out(out)
    check_robot(request.products, request.robot)
    require_folder(out.absolute().parent, _LEAST_MIB)
    points = request.points_of_interest()
    given = load(request.path, request.reference, request.view)
    if request.instant is not None:
        given = instants.of_one_instant(
            given, None if request.instant == "last" else float(request.instant)
        )
    loaded = time.perf_counter()
    result = METHODS[request.method].map(given, request.options, part(progress, 0.0, _MAPPED))
    result = replace(
        result,
        skews_s=instants.skews(given),
        clocks=given.clocks,
        spare=spare(given, result),
        origin_m=given.origin_m,
        gps=given.gps,
        timing_s={"load": loaded - started, **result.timing_s},
    )
    result = bound_cloud(result, request.bounds)
    result = with_near(result, given) if request.near else result
    if given.truth_folder is not None:
        progress("comparing with the truth", _MAPPED)
    comparing = time.perf_counter()
    truth, true_depth, on = _truth(given, result)
    with StagedFolder(out, output.check_out) as staged:
        writing = time.perf_counter()
        if truth:
            result.timing_s["truth"] = writing - comparing
        output.write_arrays(result, staged.folder)
        result.timing_s["write"] = time.perf_counter() - writing
        result.timing_s["total"] = sum(result.timing_s[k] for k in STEPS if k in result.timing_s)
        if request.products:
            progress(f"writing {', '.join(request.products)}", _MAPPED)
        write_products(request.products, result, given, staged.folder, request.robot)
        evaluation = evaluate(result, truth, true_depth, on=on) if truth else None
        sampled = sample(result, points, true_depth)
        origin = Origin.of(request.path, request.command, time.time())
        progress("drawing the report", _WRITTEN)
        drawing = time.perf_counter()
        write_report(result, staged.folder, evaluation, true_depth, sampled, origin)
        result.timing_s["report"] = time.perf_counter() - drawing
        result.timing_s["total"] = time.perf_counter() - started  # what a user waited for
        document = output.report_document(result, evaluation)
        if sampled:
            document["points_of_interest"] = [p.to_dict() for p in sampled]
        output.write_report_json(document, staged.folder)
    return document


def _truth(
    given: MapInput, result: MapResult
) -> Tuple[Optional[Truth], Optional[np.ndarray], Dict[str, np.ndarray]]:
    """The truth, the true depth of the reference picture, where both are known, and what moves in
    it.

    A truth/ that is not whole, as an interrupted simulation leaves it, is a warning of the map: it
    was made without.
    """
    if given.truth_folder is None:
        return None, None, {}
    reference = result.reference
    try:
        truth = load_truth(given.truth_folder)
        true_depth, on = TrueScene(truth).look(
            reference.vehicle, reference.stamp_s, reference.camera
        )
        for image in result.images:
            truth.T_world_cam(image.vehicle, image.stamp_s)
    except InputError as error:
        result.warnings.append(f"not compared with truth: {error}")
        return None, None, {}
    return truth, true_depth, on

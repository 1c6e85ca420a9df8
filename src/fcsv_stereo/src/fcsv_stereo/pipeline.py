# SPDX-License-Identifier: Apache-2.0
"""From an input to OUT/: load, map with a method, evaluate against truth where there is one, write."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Callable, Dict, Optional, Sequence, Union

from fcsv_stereo import colmap, output
from fcsv_stereo.errors import InputError
from fcsv_stereo.evaluation import evaluate
from fcsv_stereo.joint import JointOptions, MatchOptions, map_joint
from fcsv_stereo.joint.checks.axis_conflict import doubt_contradicted
from fcsv_stereo.joint.checks.enough_evidence import require_evidence
from fcsv_stereo.joint.checks.moved import leave_out_moved
from fcsv_stereo.model import MapInput, MapResult, Progress
from fcsv_stereo.poi import FILE as POI_FILE
from fcsv_stereo.poi import load_points, sample
from fcsv_stereo.products import write_products
from fcsv_stereo.refinement import RefineOptions
from fcsv_stereo.report import write_report
from fcsv_stereo.thesis import ThesisOptions, map_thesis
from fcsv_stereo.truth import load_truth

Options = Union[ThesisOptions, JointOptions]


def _joint(given: MapInput, options: JointOptions, progress: Progress) -> MapResult:
    result = doubt_contradicted(given, leave_out_moved(given, map_joint(given, options, progress)))
    return require_evidence(result) if options.refine_poses else result  # else who asks vouches for the poses


#: by name; each takes its own options
METHODS: Dict[str, Callable[[MapInput, Options, Progress], MapResult]] = {"joint": _joint, "thesis": map_thesis}
OPTIONS = {"joint": JointOptions, "thesis": ThesisOptions}
#: for a first look, and for depth again and again, where its rate counts more than its finish
QUICK_OPTIONS = {
    "joint": JointOptions(
        refinement=RefineOptions(features=1500),
        matching=MatchOptions(volume_pixels=20000, iterations=1, stretch=True),
    ),
    "thesis": ThesisOptions(matcher="bm"),
}
#: Again and again of what vehicles see while they hold: at half the size twice as often.
MONITOR_OPTIONS = {**QUICK_OPTIONS, "joint": replace(QUICK_OPTIONS["joint"], scale=0.5)}
DEFAULT_METHOD = "joint"


def load(path: Path, reference: Optional[str] = None) -> MapInput:
    """A session folder, a bag, or posed photographs. Raises InputError."""
    from fcsv_stereo.ros import session_bags  # photographs are mapped where ROS is not

    if not path.exists():
        raise InputError(f"{path}: does not exist")
    if session_bags.is_session(path):
        if reference is not None:
            raise InputError("--reference chooses among photographs; a session has its reference vehicle")
        return session_bags.read_session(path)
    if path.is_dir() and colmap.is_model(path):
        return colmap.read_photographs(path, reference)
    raise InputError(f"{path}: is neither a session (session.yaml or bags) nor posed photographs (images/, images.txt)")


def run(
    path: Path,
    out: Path,
    method: str,
    options: Options,
    reference: Optional[str],
    progress: Progress,
    poi: Optional[Path] = None,
    products: Sequence[str] = (),
) -> dict:
    """Map ``path`` into ``out``; the report's document. Raises StereoError, and then nothing is written.

    ``poi`` names a file of points of interest; a session may hold one (poi.yaml). ``products`` are written besides.
    """
    started = time.perf_counter()
    output.check_out(out)
    points = load_points(poi or path / POI_FILE) if poi or (path / POI_FILE).is_file() else []
    given = load(path, reference)
    loaded = time.perf_counter()
    result = METHODS[method](given, options, progress)
    result.timing_s["load"] = loaded - started
    truth = load_truth(given.truth_folder) if given.truth_folder else None
    with output.StagedOutput(out) as staged:
        writing = time.perf_counter()
        output.write_arrays(result, staged.folder)
        result.timing_s["write"] = time.perf_counter() - writing
        result.timing_s["total"] = sum(result.timing_s[k] for k in ("load", "refine", "match", "fuse", "write"))
        write_products(products, result, given, staged.folder)
        true_depth = truth.depth(result.reference) if truth else None
        evaluation = evaluate(result, truth, true_depth) if truth else None
        sampled = sample(result, points, true_depth)
        document = output.report_document(result, evaluation)
        if sampled:
            document["points_of_interest"] = [p.to_dict() for p in sampled]
        output.write_report_json(document, staged.folder)
        write_report(result, staged.folder, evaluation, true_depth, sampled)
    return document

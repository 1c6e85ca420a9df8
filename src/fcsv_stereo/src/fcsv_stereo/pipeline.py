# SPDX-License-Identifier: Apache-2.0
"""From an input to OUT/: load, map with a method, evaluate against truth where there is one, write."""

import time
from pathlib import Path
from typing import Callable, Dict, Optional

from fcsv_stereo import colmap, output
from fcsv_stereo.errors import InputError
from fcsv_stereo.evaluation import evaluate
from fcsv_stereo.inputs import MapInput
from fcsv_stereo.report import write_report
from fcsv_stereo.result import MapResult
from fcsv_stereo.thesis import Progress, ThesisOptions, map_thesis
from fcsv_stereo.truth import load_truth

#: name: (the method, its options)
METHODS: Dict[str, Callable[[MapInput, ThesisOptions, Progress], MapResult]] = {"thesis": map_thesis}


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
    path: Path, out: Path, method: str, options: ThesisOptions, reference: Optional[str], progress: Progress
) -> dict:
    """Map ``path`` into ``out``; the report's document. Raises StereoError, and then nothing is written."""
    started = time.perf_counter()
    output.check_out(out)
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
        true_depth = truth.depth(result.reference) if truth else None
        evaluation = evaluate(result, truth, true_depth) if truth else None
        document = output.report_document(result, evaluation)
        output.write_report_json(document, staged.folder)
        write_report(result, staged.folder, evaluation, true_depth)
    return document

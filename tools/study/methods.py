# SPDX-License-Identifier: Apache-2.0
"""Every registered method on the same input, each with what the study needs of it."""

import time
from typing import Dict, List

from fcsv_stereo.equations import ErrorThreshold
from fcsv_stereo.model import MapInput, MapResult
from fcsv_stereo.pipeline import METHODS
from fcsv_stereo.thesis import ThesisOptions

#: No effective range ends inside the scene: what a baseline answers before anything is trimmed.
UNTRIMMED = ErrorThreshold(1e6, False)


def names() -> List[str]:
    """`thesis` first, then what else is registered."""
    return sorted(METHODS, key=lambda n: (n != "thesis", n))


def run(name: str, given: MapInput, thesis: ThesisOptions) -> MapResult:
    """A method's map; ``thesis`` holds that method's options, another answers every pixel.

    timing_s gets "cpu": seconds of processor, of all threads, which other load does not touch.
    """
    method = METHODS[name]
    started = time.process_time()
    result = method.map(given, thesis if isinstance(thesis, method.options) else method.complete)
    result.timing_s["cpu"] = time.process_time() - started
    return result


def run_all(given: MapInput, thesis: ThesisOptions) -> Dict[str, MapResult]:
    """By name, in the order of names()."""
    return {n: run(n, given, thesis) for n in names()}

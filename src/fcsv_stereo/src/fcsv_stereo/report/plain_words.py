# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a map, said so that one who flies drones understands it and knows what to
do."""

from typing import List, Optional, Sequence

import numpy as np

from fcsv_stereo.evaluating.evaluation import Evaluation
from fcsv_stereo.model import MapResult
from fcsv_stereo.report.evidence import PairEvidence, Seam, correction
from fcsv_stereo.report.naming import are_photographs

LEAST_COVERAGE, LEAST_MATCHED, LEAST_OVERLAP, LEAST_FOUND = 0.25, 0.3, 0.5, 0.1
MOST_EPIPOLAR_PX, MOST_CORRECTION_DEG, MOST_SEAM, MOST_APART_S = 1.0, 1.0, 0.05, 0.2
WIDE_SIGMA, MOST_WIDE = 0.1, 0.25
# against truth; 68 % and 95 % would be right
MOST_WRONG, LEAST_WITHIN_2, MOST_WITHIN_1 = 0.1, 0.8, 0.9
_LEAST_OFF = 0.01  # of the map's scale, that trackers are taken for


def warnings(
    result: MapResult,
    pairs: Sequence[PairEvidence],
    seams: Sequence[Seam],
    evaluation: Optional[Evaluation],
) -> List[str]:
    """Sentences, the method's own first; what is alike is said once."""
    found = list(result.warnings)
    if result.coverage < LEAST_COVERAGE:
        found.append(
            f"Only {result.coverage:.0%} of the picture has a depth. Sky counts as none; if there is little sky, the "
            "pictures have little texture or the poses are poor."
        )
    found += _of_pairs(result, pairs)
    found += _of_poses(result)
    steps = [
        f"{s.step:+.0%} at {s.at_m:.0f} m ({s.shorter} to {s.longer})"
        for s in seams
        if abs(s.step) > MOST_SEAM
    ]
    if steps:
        found.append(
            f"Depths jump where one baseline takes over from another: {', '.join(steps)}. The poses of these baselines "
            "do not agree."
        )
    return found + _of_sigma(result, evaluation)


def _of_pairs(result: MapResult, evidence: Sequence[PairEvidence]) -> List[str]:
    stamps = {i.name: i.stamp_s for i in result.images}
    narrow, poor, lost, off, apart = [], [], [], [], []
    for p, e in zip(result.pairs, evidence):
        name = p.configuration.name
        apart_s = abs(stamps.get(p.other_name, 0.0) - stamps.get(p.reference_name, 0.0))
        narrow += [f"{name} ({e.overlap:.0%})"] if e.overlap < LEAST_OVERLAP else []
        poor += [f"{name} ({p.match_rate:.0%})"] if p.match_rate < LEAST_MATCHED else []
        lost += [f"{name} ({e.found:.0%})"] if e.found is not None and e.found < LEAST_FOUND else []
        rms = e.epipolar_rms_px
        off += [f"{name} ({rms:.1f} px)"] if rms is not None and rms > MOST_EPIPOLAR_PX else []
        apart += (
            [f"{name} ({apart_s:.1f} s)"]
            if apart_s > MOST_APART_S and p.other_name not in result.watched
            else []
        )
    said = (
        (narrow, f"The other camera sees too little of the reference picture; {_nearer(result)}"),
        (poor, "Few pixels matched, so these baselines add little"),
        (
            lost,
            "Hardly a corner is where its depth says, so these depths are chance: the other picture shows another "
            "place, or its pose is far off",
        ),
        (
            off,
            "Corresponding points lie off their epipolar line (1 px would be good): poses are not good enough, and "
            "far depths of these baselines are not to be trusted",
        ),
        (apart, "Pictures were not taken at one time; what moved in between is wrong in the map"),
    )
    return [f"{text}: {', '.join(names)}." for names, text in said if names]


def _nearer(result: MapResult) -> str:
    """What to do for more overlap: photographs are taken already, each by a camera of its own
    (``colmap``)."""
    return (
        "map with photographs that show more of the same"
        if are_photographs(result)
        else "tilt it inwards"
    )


def _of_poses(result: MapResult) -> List[str]:
    turned, kept = [], []
    any_refined = any(i.refined for i in result.images)
    for i in result.images:
        degrees, metres = correction(i)
        turned += (
            [f"{i.name} ({degrees:.1f}°, {metres:.2f} m)"] if degrees > MOST_CORRECTION_DEG else []
        )
        kept += (
            [i.name] if any_refined and not i.refined and i.name != result.reference.name else []
        )
    found = []
    if turned:
        check = (
            "the camera and the poses of the model"
            if are_photographs(result)
            else ("calibration and odometry of these vehicles")
        )
        found.append(f"Refinement moved pictures a lot: {', '.join(turned)}. Check {check}.")
    if kept:
        found.append(
            f"The poses of these pictures could not be refined and are as recorded: {', '.join(kept)}."
        )
    return found


def _longer(result: MapResult) -> str:
    photographs = "take photographs from farther apart for what is far"
    return photographs if are_photographs(result) else "fly a longer baseline for what is far"


def _of_sigma(result: MapResult, evaluation: Optional[Evaluation]) -> List[str]:
    found = []
    known = np.isfinite(result.depth) & np.isfinite(result.sigma)
    wide = (
        float((result.sigma[known] > WIDE_SIGMA * result.depth[known]).mean())
        if known.any()
        else 0.0
    )
    if wide > MOST_WIDE:
        found.append(
            f"{wide:.0%} of the depths have a standard deviation above {WIDE_SIGMA:.0%} of the distance; "
            f"{_longer(result)}."
        )
    return found + (_of_truth(evaluation) if evaluation is not None else [])


def _of_truth(e: Evaluation) -> List[str]:
    found = []
    if e.overall.wrong_of_answered > MOST_WRONG:
        found.append(
            f"Against truth {e.overall.wrong_of_answered:.0%} of the depths are wrong by more than 10 %: do not rely "
            "on this map."
        )
    off = e.scale - 1.0
    alike = abs(off) > _LEAST_OFF and (e.within_2_sigma_scaled or 0.0) >= LEAST_WITHIN_2
    if e.within_2_sigma < LEAST_WITHIN_2 and alike:
        found.append(
            f"Against truth the whole map is {abs(off):.1%} too {'far' if off > 0 else 'near'}, more than sigma says "
            f"of the trackers' scale; but for that {e.within_2_sigma_scaled:.0%} of the errors lie within two "
            "standard deviations, where 95 % would be right."
        )
    elif e.within_2_sigma < LEAST_WITHIN_2:
        found.append(
            f"Against truth only {e.within_2_sigma:.0%} of the errors lie within two standard deviations, "
            "where 95 % would be right: sigma is too small, most likely because poses are worse than it assumes."
        )
    elif e.within_1_sigma > MOST_WITHIN_1:
        found.append(
            f"Against truth {e.within_1_sigma:.0%} of the errors lie within one standard deviation, where 68 % would "
            "be right: sigma is too large, and clouds leave out more than they must."
        )
    return found

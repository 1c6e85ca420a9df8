# SPDX-License-Identifier: Apache-2.0
"""How well the pictures' poses were known before any refinement, where the truth is there to say
it."""

from typing import List, Tuple

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.evaluating.truth import Truth


def tracked_errors(document: dict, truth: Truth) -> List[Tuple[float, float]]:
    """(m, deg) of each picture's prior pose relative to the reference picture's; ``document`` is a
    report.json."""
    reference = document["reference"]
    T_cam_home = transforms.invert(np.array(reference["T_home_cam"]))
    T_cam_world = transforms.invert(true_pose(truth, reference["image"]))
    errors = []
    for image in document["images"]:
        if image["name"] == reference["image"]:
            continue
        found = T_cam_home @ np.array(image["prior_T_home_cam"])
        true = T_cam_world @ true_pose(truth, image["name"])
        away_m = float(np.linalg.norm(found[:3, 3] - true[:3, 3]))
        errors.append((away_m, float(np.degrees(transforms.rotation_angle(found, true)))))
    return errors


def errors_in_words(errors: List[Tuple[float, float]]) -> str:
    """One line for the end of a demo.

    >>> errors_in_words([(0.01, 0.2), (0.02, 0.1), (0.06, 0.4)])
    'poses before refinement, against truth: median 2.0 cm, 0.20 deg, worst 6.0 cm, 0.40 deg (3
    pictures)'
    """
    if not errors:
        return "poses before refinement: none to compare with the reference's"
    median, worst = np.median(errors, axis=0), np.max(errors, axis=0)
    return (
        f"poses before refinement, against truth: median {median[0] * 100:.1f} cm, {median[1]:.2f} deg, "
        f"worst {worst[0] * 100:.1f} cm, {worst[1]:.2f} deg ({len(errors)} pictures)"
    )


def true_pose(truth: Truth, name: str) -> np.ndarray:
    """T_world_cam of a session's picture, "VEHICLE/STAMP"."""
    vehicle, _, stamp_s = name.partition("/")
    return truth.T_world_cam(vehicle, float(stamp_s))

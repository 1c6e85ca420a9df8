# SPDX-License-Identifier: Apache-2.0
"""What a depth's evidence is judged by: ``python tools/train_evidence.py`` finds means, scales and
weights."""

from dataclasses import dataclass
from typing import Tuple

from fcsv_stereo.joint.tuning.recorded import LIT, Tuned, tuned


@dataclass(frozen=True)
class Evidence(Tuned):
    """``checks.evidence``. Three weights for each of its features: itself, its square, its product
    with the first."""

    scale: float = tuned(
        0.5, "of the full size", "at which other depths are tried: time against small things"
    )
    probes_px: Tuple[float, ...] = tuned(
        (2.5, 5.0, 12.0), "px of that scale, either way", "other depths that are tried"
    )
    stands_out: float = tuned(1.2, "times worse at other depths", "from it on a match stands out")
    plain_grey: float = tuned(
        2.5, "grey levels, mean difference from what is about it", "below it there is no texture"
    )
    nothing: float = tuned(
        0.3, "times worse", "added to how far a match stands out, so that none has a logarithm"
    )
    most_scales: float = tuned(
        4.0, "standard deviations", "beyond which the square of a feature grows no more"
    )
    sure_doubt: float = tuned(
        0.06, "probability of an error above a tenth", "up to it pairs are said to agree"
    )
    sure_share: float = tuned(
        0.0125, "share, by the doubts", "of what is said to agree may be wrong", LIT
    )
    most_doubt: float = tuned(
        0.15, "probability of an error above a tenth", "from it on nothing is answered"
    )
    constant: float = tuned(-2.260, "logit", "of the mean pixel")
    means: Tuple[float, ...] = tuned(
        (
            -3.701,
            0.299,
            0.539,
            0.542,
            0.768,
            0.608,
            0.607,
            0.539,
            0.769,
            0.769,
            -3.252,
            -1.873,
            2.201,
            0.842,
        ),
        "of each feature",
        "its mean",
    )
    scales: Tuple[float, ...] = tuned(
        (
            1.578,
            1.069,
            0.293,
            0.427,
            0.422,
            0.415,
            0.357,
            0.259,
            0.344,
            0.317,
            1.286,
            1.240,
            0.761,
            0.318,
        ),
        "of each feature",
        "its standard deviation",
    )
    weights: Tuple[float, ...] = tuned(
        (
            1.201,
            0.061,
            0.061,
            0.156,
            0.023,
            0.022,
            -0.442,
            -0.108,
            0.045,
            0.208,
            -0.272,
            0.215,
            -0.917,
            -1.096,
            -0.128,
            -0.014,
            -0.074,
            -0.355,
            -0.167,
            -0.004,
            0.335,
            0.427,
            0.323,
            0.203,
            -0.188,
            -0.195,
            -0.042,
            -0.441,
            0.351,
            0.273,
            0.163,
            -0.007,
            0.033,
            0.476,
            -0.105,
            0.113,
            -0.037,
            0.181,
            -0.089,
            0.068,
            0.149,
            0.007,
        ),
        "logit",
        "three of each feature",
    )


EVIDENCE = Evidence()

# SPDX-License-Identifier: Apache-2.0
"""How a tuned number is written down, and the sets of scenes that numbers were chosen on."""

from dataclasses import dataclass, field, fields
from typing import Any, Iterator

#: Focal length and size (px) of the bench's pictures: 640x480, 56 degrees wide, noise of the simulated
#: cameras.
REFERENCE_FOCAL_PX = 602.0
REFERENCE_SIZE_PX = 640, 480

#: Sets of scenes: kind of world and seed; H are baselines of 2, 4, 6 and 8 m, V of 5, 7 and 10 m.
SEED_3_AND_PLAIN_1 = "seed 3 of each world, plain 1 (H)"
FIVE = "street, village, plain 3, plain 4, plain 5 (H)"
SIX = "seed 3 of each world, street 4, plain 4 (H, and with V)"
EIGHT_THIN = "plain 3 to 6, street 3 and 6, village 3, field 3 (H, and with V)"
FOUR_DENIED = "street, field, plain 3, village 5 (H)"
FOURTEEN = "seeds 3, 5 and 6 of each world, street 4, plain 4 (H, and with V)"
SEED_3 = "seed 3 of each world (H)"
LIT = (
    "seeds 21 and 22 of each world (H), those of seed 22 also overcast, in fog or against the light"
)
BENCH = "the bench's eight scenes: seeds 1 and 2 of each world (H, and with V)"
CAR = "not recorded; measured on the town with a car that drives along the baselines (docs/design/decisions/0008)"
TILTED = "not recorded; measured on the study's tilted pairs"
RIG = "the tilting rig's demo, seed 1 (docs/lab/tilting.md)"
NOT_RECORDED, NOT_VARIED = "not recorded", "not varied"


@dataclass(frozen=True)
class Tuned:
    """Base of the stages' numbers."""


def tuned(
    value: Any, unit: str, trades: str, chosen: str = NOT_RECORDED, same: str = NOT_VARIED
) -> Any:
    """A field: its unit, what more and less of it costs, the scenes that it was chosen on, and the
    range in which the result does not change."""
    return field(
        default=value, metadata={"unit": unit, "trades": trades, "chosen": chosen, "same": same}
    )


def beyond_reference(focal_px: float) -> float:
    """Says by what angles given in px grow where pictures are finer than those that they were
    chosen on: 1 up to there.

    Not below 1: a smaller picture has no more to tell. In whole hundredths, so that a lens's spread
    changes nothing.

    >>> beyond_reference(361.1), beyond_reference(601.8), beyond_reference(1203.7)
    (1.0, 1.0, 2.0)
    """
    return max(1.0, round(focal_px / REFERENCE_FOCAL_PX, 2))


def table(stage: Tuned) -> Iterator[str]:
    """Lines of Markdown, one a number."""
    yield f"\n## {type(stage).__name__}\n\n| number | value | unit | trades | chosen on | same result |"
    yield "|---|---|---|---|---|---|"
    for f in fields(stage):
        m = f.metadata
        yield f"| {f.name} | {getattr(stage, f.name)} | {m['unit']} | {m['trades']} | {m['chosen']} | {m['same']} |"

# SPDX-License-Identifier: Apache-2.0
"""Numbers of the whole match: its geometry, its sizes, what it says of a pair."""

from dataclasses import dataclass

from fcsv_stereo.joint.tuning.recorded import FOURTEEN, SIX, Tuned, beyond_reference, tuned


@dataclass(frozen=True)
class ViewTuning(Tuned):
    """``views``: which inverse depths are tried."""

    least_fall: float = tuned(
        0.01,
        "of a ray, per metre of depth",
        "one that falls less does not meet the ground: less of it reaches "
        "nearer to the horizon, where a level plane's depth changes most from row to row",
    )
    least_seen: float = tuned(
        0.3,
        "share of the reference picture",
        "a pair that sees less at an inverse depth does not count there: more "
        "of it loses near depths, less of it tries ones that few pixels are seen at",
    )
    fast_share: float = tuned(
        0.9, "share of grid points", "how many may move by more than a level: time against depth"
    )


@dataclass(frozen=True)
class Match(Tuned):
    """``match`` and ``pictures``: sizes, steps, and which pictures are matched at all."""

    largest_volume: float = tuned(
        0.6,
        "share of the full size",
        "fine things against time and memory",
        FOURTEEN,
        "0.7: within 10 % the same, 2 sigma half a point higher; 0.5: 0.2 to 0.3 points less",
    )
    rough_step_px: float = tuned(
        1.5, "px of this scale, fastest pair", "time of the rough match against its precision"
    )
    least_choices: int = tuned(
        2,
        "sizes after the volume's",
        "edges against time",
        SIX,
        "1: 0.6 points fewer within 10 %; 3, or twice at full size: 0.1 more at most",
    )
    pose_steps: int = tuned(4, "Gauss-Newton steps", "time against digits of the poses")


@dataclass(frozen=True)
class Pairs(Tuned):
    """``pairs`` and ``method``: what the report says of a pair; a map does not depend on it."""

    bins_per_doubling: int = tuned(
        4, "bands per doubling of depth", "precision of the nearest depth against noise"
    )
    least_share: float = tuned(
        0.6, "share of a pair's usual agreement", "below it the pair stops being useful"
    )
    usual_percentile: float = tuned(
        75.0, "percentile of the bands' agreement", "what is usual of a pair"
    )
    most_pose_px: float = tuned(
        1.5,
        "px of the full picture at the bench's focal length",
        "a picture whose pose is known worse is left out where others serve",
    )

    def most_pose_off_px(self, focal_px: float) -> float:
        """``most_pose_px`` in a picture of that focal length: the first match is made at a size
        that is bounded, so that the same angle is as harmful in a larger picture."""
        return beyond_reference(focal_px) * self.most_pose_px


VIEWS, MATCH, PAIRS = ViewTuning(), Match(), Pairs()

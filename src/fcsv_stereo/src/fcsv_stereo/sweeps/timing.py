# SPDX-License-Identifier: Apache-2.0
"""Poses of a sweep's pictures at the time that the tracker counts."""

from collections import defaultdict
from dataclasses import replace
from typing import Callable, Dict, List, Mapping, Sequence, Tuple

import numpy as np

from fcsv_geometry.errors import PoseUnavailable
from fcsv_geometry.trajectory import Trajectory
from fcsv_stereo.model import ConfigurationInput, Picture
from fcsv_stereo.sweeps.choice import moves
from fcsv_stereo.sweeps.clock import StampOffset, clock_offset

_OFF_TIME_S = 0.001  # what cameras and trackers with drivers are known to; less is not worth a word

Posed = Callable[[str, float], np.ndarray]


def on_time(
    configurations: Sequence[ConfigurationInput],
    tracks: Mapping[str, Trajectory],
    R_body_cam: Mapping[str, np.ndarray],
    posed: Posed,
) -> Tuple[List[ConfigurationInput], Dict[str, StampOffset], List[str]]:
    """The configurations with the time offset of each vehicle that takes part in a sweep taken out,
    the offsets, words.

    ``tracks`` are of T_odom_body; ``posed`` gives T_home_cam of a vehicle's camera at a stamp of
    its tracker, or raises PoseUnavailable.
    """
    clocks = _clocks(configurations, tracks, R_body_cam)
    known = {v: clock.offset_s for v, clock in clocks.items() if clock.known}

    def again(p: Picture) -> Picture:
        try:
            return (
                replace(p, T_home_cam=posed(p.vehicle, p.stamp_s + known[p.vehicle]))
                if p.vehicle in known
                else p
            )
        except PoseUnavailable:  # its tracker does not reach so far
            return p

    better = (
        [
            replace(c, references=list(map(again, c.references)), others=list(map(again, c.others)))
            for c in configurations
        ]
        if known
        else list(configurations)
    )
    return better, clocks, _words(clocks)


def _clocks(configurations, tracks, R_body_cam) -> Dict[str, StampOffset]:
    """Finds the clocks by vehicle of a sweep; those of which nothing is seen are not told."""
    pictures: Dict[str, Dict[float, Picture]] = defaultdict(dict)
    for c in filter(moves, configurations):
        for p in (*c.references, *c.others):
            pictures[p.vehicle][p.stamp_s] = p
    found = {
        v: clock_offset([of[s] for s in sorted(of)], tracks[v], R_body_cam[v])
        for v, of in pictures.items()
    }
    return {v: clock for v, clock in found.items() if clock is not None}


def _words(clocks: Dict[str, StampOffset]) -> List[str]:
    """Whose stamps are wrong by more than can be chance."""
    wrong = {
        v: c
        for v, c in clocks.items()
        if c.known and abs(c.offset_s) > max(_OFF_TIME_S, 3.0 * c.sigma_s)
    }
    return [
        f"{v}: its camera's stamps and its tracker's differ by {c.words}: taken out of its poses"
        for v, c in wrong.items()
    ]

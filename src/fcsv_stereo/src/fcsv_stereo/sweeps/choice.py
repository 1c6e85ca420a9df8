# SPDX-License-Identifier: Apache-2.0
"""Pictures of a sweep for a map: geometric steps of the baseline, enough overlap with the
reference, little blur.

The error of a depth falls with the baseline and the nearest depth that a baseline serves grows with
it, both in proportion: baselines in equal ratios serve equal ratios of distance.
"""

from dataclasses import dataclass, replace
from typing import Dict, List, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_stereo.depth import shown_share
from fcsv_stereo.model import Configuration, ConfigurationInput, Picture

# of the baseline, the first that leaves few enough pictures: 0.42 is sqrt(2)
_STEPS = (0.42, 0.6, 0.85, 1.2, 2.0, 4.0)
_MOST = 8  # pictures of all sweeps together; ``joint`` takes 16, and its time grows with them
_SLACK = 0.25  # of a step: within it the sharpest picture is taken
MOVES_M = 1.0  # a vehicle that holds strays by 0.15 m
_REFERENCES = 3  # nearest in time to each chosen picture
_NEAR_M = 20.0  # distance at which overlap and blur are judged
_LEAST_OVERLAP = 0.25  # of the reference picture
_MOST_BLUR_PX = 2.0
_EXPOSURE_S = 0.008  # assumed: pictures do not say it
_GRID = 9


@dataclass(frozen=True)
class Candidate:
    """A picture of a moving camera: baseline (3,) m in home, share of the reference picture that it
    sees at 20 m, and how far (px) the picture moves while it is exposed."""

    picture: Picture
    baseline_m: np.ndarray
    overlap: float
    blur_px: float

    @property
    def length_m(self) -> float:
        """Gives the length of the baseline."""
        return float(np.linalg.norm(self.baseline_m))


def moves(configuration: ConfigurationInput) -> bool:
    """Whether the other camera moved through its recording."""
    places = np.array([p.T_home_cam[:3, 3] for p in configuration.others])
    return len(places) > 1 and float(np.linalg.norm(places - places[0], axis=1).max()) > MOVES_M


def spread(
    configurations: Sequence[ConfigurationInput], most: int = _MOST
) -> List[ConfigurationInput]:
    """Each sweep as one configuration per chosen picture, with its own baseline; those to stand at
    as they are."""
    if not any(moves(c) for c in configurations):
        return list(configurations)
    found = {i: candidates(c) for i, c in enumerate(configurations) if moves(c)}
    for step in _STEPS:
        chosen = _distinct({i: choose(of, step) for i, of in found.items()}, step)
        if sum(map(len, chosen.values())) <= most:
            break
    listed: List[ConfigurationInput] = []
    for i, c in enumerate(configurations):
        listed += [_single(c, k.picture) for k in chosen[i]] if i in chosen else [c]
    return listed


def candidates(configuration: ConfigurationInput) -> List[Candidate]:
    """The other camera's pictures, measured against the reference picture of their time."""
    others = sorted(configuration.others, key=lambda p: p.stamp_s)
    found = []
    for k, picture in enumerate(others):
        reference = min(configuration.references, key=lambda r: abs(r.stamp_s - picture.stamp_s))
        baseline_m = picture.T_home_cam[:3, 3] - reference.T_home_cam[:3, 3]
        blur_px = _blur_px(others[max(k - 1, 0)], others[min(k + 1, len(others) - 1)])
        found.append(Candidate(picture, baseline_m, overlap(reference, picture), blur_px))
    return found


def choose(found: Sequence[Candidate], step: float) -> List[Candidate]:
    """Chooses pairs from the shortest to the longest baseline, each so much of its baseline away
    from the one before.

    Of those about a step away the sharpest. What is blurred or hardly overlaps serves only where
    nothing else is left.

    >>> from types import SimpleNamespace
    >>> at = lambda x: Candidate(SimpleNamespace(stamp_s=x), np.array([x, 0.0, 0.0]), 1.0, 0.1)
    >>> [k.length_m for k in choose([at(x) for x in np.arange(2.0, 8.25, 0.25)], 0.42)]
    [2.0, 2.75, 4.0, 5.75, 8.0]
    """
    fit = [k for k in found if k.overlap >= _LEAST_OVERLAP and k.blur_px <= _MOST_BLUR_PX]
    left = sorted(fit or found, key=lambda k: k.length_m)
    chosen = left[:1]
    while left:
        last, wanted_m = chosen[-1], step * max(chosen[-1].length_m, MOVES_M)
        away = [(k, float(np.linalg.norm(k.baseline_m - last.baseline_m))) for k in left]
        ahead = [
            (k, m) for k, m in away if k.length_m >= last.length_m and m > (1.0 - _SLACK) * wanted_m
        ]
        near = [(k, m) for k, m in ahead if m < (1.0 + _SLACK) * wanted_m] or ahead[:1]
        if not near:
            break
        chosen.append(
            min(near, key=lambda entry: (round(entry[0].blur_px, 1), abs(entry[1] - wanted_m)))[0]
        )
        left = [k for k in left if k.length_m > chosen[-1].length_m]
    return _with_longest(chosen, sorted(fit or found, key=lambda k: k.length_m)[-1], step)


def overlap(reference: Picture, other: Picture) -> float:
    """Share of the reference picture that the other sees of what is 20 m away."""
    camera = reference.camera
    edges = (np.linspace(0.0, n - 1.0, _GRID) for n in (camera.width, camera.height))
    xy = camera.normalize(np.stack(np.meshgrid(*edges), -1).reshape(-1, 2))
    points_cam = np.hstack([xy, np.ones((len(xy), 1))]) * _NEAR_M
    return shown_share(
        other.camera, other.T_home_cam, transforms.apply(reference.T_home_cam, points_cam)
    )


def _blur_px(before: Picture, after: Picture) -> float:
    """How far the picture moves in the exposure, by the poses of its neighbours in time."""
    gap_s = after.stamp_s - before.stamp_s
    if gap_s <= 0.0:
        return 0.0
    R = before.T_home_cam[:3, :3].T @ after.T_home_cam[:3, :3]
    turn_rad = float(np.arccos(np.clip((np.trace(R) - 1.0) / 2.0, -1.0, 1.0)))
    shift_m = float(np.linalg.norm(after.T_home_cam[:3, 3] - before.T_home_cam[:3, 3]))
    return before.camera.fx * (turn_rad + shift_m / _NEAR_M) * _EXPOSURE_S / gap_s


def _with_longest(chosen: List[Candidate], longest: Candidate, step: float) -> List[Candidate]:
    """The last one is that of the longest baseline: it tells the far end."""
    away_m = float(np.linalg.norm(longest.baseline_m - chosen[-1].baseline_m))
    if away_m > 0.5 * step * longest.length_m:
        return [*chosen, longest]
    return [*chosen[:-1], longest] if len(chosen) > 1 else chosen


def _distinct(chosen: Dict[int, List[Candidate]], step: float) -> Dict[int, List[Candidate]]:
    """Gives the candidates without those that stand where one of another sweep stands."""
    kept: Dict[int, List[Candidate]] = {}
    for i, of in chosen.items():
        before = [k for others in kept.values() for k in others]
        kept[i] = [k for k in of if all(_apart(k, b, step) for b in before)]
    return kept


def _apart(a: Candidate, b: Candidate, step: float) -> bool:
    return float(np.linalg.norm(a.baseline_m - b.baseline_m)) > 0.5 * step * a.length_m


def _single(c: ConfigurationInput, other: Picture) -> ConfigurationInput:
    nearest = sorted(c.references, key=lambda r: abs(r.stamp_s - other.stamp_s))[:_REFERENCES]
    between = Configuration.between(nearest[0].T_home_cam, other.T_home_cam)
    name = f"{c.configuration.name}: {between.baseline_m:.1f} m"
    configuration = replace(between, tilt_rad=c.configuration.tilt_rad, name=name)
    return ConfigurationInput(configuration, sorted(nearest, key=lambda r: r.stamp_s), [other])

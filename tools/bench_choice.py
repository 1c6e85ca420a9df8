# SPDX-License-Identifier: Apache-2.0
"""What a better choice among surfaces could gain in ``joint``: how often the right candidate is there and not chosen.

    python tools/bench_choice.py --scenes street:51 village:51      H 2, 4, 6, 8 m; half a minute a scene

Maps each scene as it is, with the candidate nearest to truth at the last choice wherever the chosen one is wrong, and
so at both choices. Right is a depth within 10 % of truth; pixels with truth to 400 m. Every wrong pixel counts in the
first row that it belongs to.
"""

import argparse
from typing import Callable, Dict, List, Tuple

import cv2
import numpy as np
from numba import njit

from bench.scenes import HORIZONTAL, NOISES, SceneName, shoot
from fcsv_stereo.joint import match
from fcsv_stereo.joint.match import JointDepth, MatchOptions, match_jointly
from fcsv_stereo.joint.method import choose_pictures
from fcsv_stereo.joint.surfaces import select
from fcsv_stereo.joint.surfaces.data_cost import fronts
from fcsv_stereo.joint.views import Views
from fcsv_stereo.model import MapInput
from fcsv_stereo.refinement import RefineOptions, refine

_RIGHT, _MOST_M, _FAR_M = 0.1, 400.0, 100.0
_STEP_PX, _THIN_PX, _LEAST_W = 7, 9, 1e-5  # within 3 px of a step; narrower than 9 px; as good as infinite, 1/m
_HIDES, _HIDES_1_M = 1.08, 1e-4  # of ``DataCost``: what is nearer than this hides the place


def main() -> None:
    """Two tables in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["street:51", "village:51", "plain:51"], metavar="WORLD:SEED")
    scenes = [SceneName(world, int(seed)) for world, seed in (s.split(":") for s in parser.parse_args().scenes)]
    print("| scene | choice possible | right one there | chosen | map: within 10 % | best at the last | at both |")
    print("|---|---|---|---|---|---|---|")
    parts: Dict[str, List[str]] = {}
    for name in scenes:
        scene = shoot(name, HORIZONTAL)
        row, where = measured(scene.given(HORIZONTAL, NOISES[0]), scene.true_depth)
        print(f"| {name} | {' | '.join(f'{share:.1%}' for share in row)} |", flush=True)
        for words, shares in where.items():
            parts.setdefault(words, []).append(" | ".join(f"{share:.2%}" for share in shares))
    columns = (f"{name}: pixels | wrong | of these the right one there" for name in scenes)
    print(f"\n| wrong pixels | {' | '.join(columns)} |\n|---|{'---|' * 3 * len(scenes)}")
    for words, cells in parts.items():
        print(f"| {words} | {' | '.join(cells)} |")


def measured(given: MapInput, true: np.ndarray) -> Tuple[List[float], Dict[str, Tuple[float, float, float]]]:
    """The scene's row, and by place: shares of the judged pixels that lie there, are wrong, could have been right."""
    judged = np.isfinite(true) & (true <= _MOST_M)
    true_w = np.where(judged, 1.0 / np.where(judged, true, 1.0), 0.0).astype(np.float32)
    choices: List[_Choice] = []
    right = _right(_mapped(given, true_w, choices, []), true)
    last = choices[-1]
    there, possible = last.best_is_right(true_w)[judged], last.count[judged] > 1
    row = [possible.mean(), there.mean(), near(last.chosen, true_w)[judged].mean(), right[judged].mean()]
    for corrected in ([true.shape], [choices[0].chosen.shape, true.shape]):
        row.append(_right(_mapped(given, true_w, [], corrected), true)[judged].mean())
    where, left = {}, judged.copy()
    could = ~right & last.best_is_right(true_w)
    for words, mask in places(last.found, true_w).items():
        here, left = left & mask, left & ~mask
        where[words] = tuple(m.sum() / judged.sum() for m in (here, here & ~right, here & could))
    return row, where


class _Choice:
    """What one choice had to choose from, and what it chose."""

    def __init__(self, found: Views, start, count, values, chosen):
        self.found, self.start, self.count, self.values, self.chosen = found, start, count, values, chosen

    def nearest(self, true_w: np.ndarray) -> np.ndarray:
        """HxW, 1/m: the candidate nearest to truth."""
        best = np.empty(self.count.shape, np.float32)
        _nearest(self.start, self.count, self.values, np.maximum(true_w, np.float32(_LEAST_W)), best)
        return best

    def best_is_right(self, true_w: np.ndarray) -> np.ndarray:
        return near(self.nearest(true_w), true_w)


def _mapped(given: MapInput, true_w: np.ndarray, choices: List[_Choice], corrected: List[Tuple]) -> JointDepth:
    """The match, its choices into ``choices``; those of a shape in ``corrected`` take what is nearest to truth."""
    pick, choose, offered = select._pick, match.choose_surfaces, []

    def recording(start, count, values, total, best):
        offered.append((start, count, values))
        pick(start, count, values, total, best)

    def chosen(found, *rest):
        w = choose(found, *rest)
        choices.append(_Choice(found, *offered[-1], w))
        there = cv2.resize(true_w, w.shape[::-1], interpolation=cv2.INTER_NEAREST)
        if w.shape not in corrected:
            return w
        return np.where(near(w, there) | (there == 0.0), w, choices[-1].nearest(there))

    reference, others = choose_pictures(given.configurations)
    refined = refine(reference, others, RefineOptions(prior=given.prior))
    pictures, covariances = [r.picture for r in refined.others], [r.told for r in refined.others]
    select._pick, match.choose_surfaces = recording, chosen
    try:
        return match_jointly(refined.reference, pictures, MatchOptions(adjust_poses=True), covariances)
    finally:
        select._pick, match.choose_surfaces = pick, choose


def places(found: Views, true_w: np.ndarray) -> Dict[str, np.ndarray]:
    """HxW bool masks, by what makes the choice hard there."""
    in_view, seen = _seen(found, true_w)
    step = cv2.dilate(true_w, np.ones((_STEP_PX,) * 2)) > (1.0 + _RIGHT) * _floor(cv2.erode, true_w, _STEP_PX)
    thin = true_w > (1.0 + _RIGHT) * _floor(_opened, true_w, _THIN_PX)
    return {
        "outside of every other picture": in_view == 0,
        "hidden from every pair": seen == 0,
        f"narrower than {_THIN_PX} px": thin,
        "within 3 px of a step": step,
        "seen by one pair": seen == 1,
        f"beyond {_FAR_M:.0f} m": true_w < 1.0 / _FAR_M,
        "elsewhere": np.ones(true_w.shape, bool),
    }


def _floor(made: Callable, w: np.ndarray, size_px: int) -> np.ndarray:
    return np.maximum(made(w, np.ones((size_px, size_px), np.uint8)), np.float32(_LEAST_W))


def _opened(w: np.ndarray, window: np.ndarray) -> np.ndarray:
    return cv2.morphologyEx(w, cv2.MORPH_OPEN, window)


def _seen(found: Views, true_w: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """HxW counts of the pairs whose picture holds the true place, and of those from which nothing hides it."""
    in_front = fronts(found, true_w, np.ones((len(found), *true_w.shape), bool))
    v, u = np.indices(true_w.shape)
    pixels, w = np.stack([u.ravel(), v.ravel(), np.ones(u.size)]), true_w.ravel()
    in_view, seen = np.zeros(w.size, int), np.zeros(w.size, int)
    for p, (height, width), front in zip(found.projections, found.sizes, in_front):
        x, y, z = p[:9].reshape(3, 3) @ pixels + w * p[9:, None]
        x, y = x / z, y / z
        inside = (z > 0) & (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
        r, c = (np.clip(np.round(a), 0, n - 1).astype(int) for a, n in zip((y, x), front.shape))
        in_view += inside
        seen += inside & (front[r, c] <= _HIDES * w + _HIDES_1_M)
    return in_view.reshape(true_w.shape), seen.reshape(true_w.shape)


def near(w: np.ndarray, true_w: np.ndarray) -> np.ndarray:
    """Whether the depth of inverse depth ``w`` is right."""
    return np.abs(true_w / np.maximum(w, 1e-9) - 1.0) <= _RIGHT


def _right(found: JointDepth, true: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.abs(found.depth / true - 1.0) <= _RIGHT


@njit
def _nearest(start, count, values, true_w, best):
    for y in range(best.shape[0]):
        for x in range(best.shape[1]):
            least = np.inf
            for k in range(start[y, x], start[y, x] + count[y, x]):
                off = abs(np.log(max(values[k], 1e-6) / true_w[y, x]))
                if off < least:
                    least, best[y, x] = off, values[k]


if __name__ == "__main__":
    main()

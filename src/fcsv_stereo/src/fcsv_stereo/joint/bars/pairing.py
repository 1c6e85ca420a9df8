# SPDX-License-Identifier: Apache-2.0
"""Bars: two matched edges beside each other at one depth."""

from dataclasses import dataclass, replace
from typing import List, Optional, Tuple

import numpy as np

from fcsv_stereo.joint.bars.match import MatchedEdges
from fcsv_stereo.joint.tuning import Bars


@dataclass(frozen=True)
class Bar:
    """``lines`` (2,3) of both edges, ``ends`` (2,2) of the part that is a bar (px, on its middle),
    ``inverse`` (2,) depths of its axis there and their ``sigma`` (1/m). It is taken to be round:
    ``half_angle`` (rad) is its radius by its distance."""

    lines: np.ndarray
    ends: np.ndarray
    inverse: np.ndarray
    sigma: float
    half_angle: float = 0.0

    def pixels(self, shape: Tuple[int, int]) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows, columns and inverse depths (K,) of its pixels in a picture of ``shape``."""
        length, half = self.length_px, self.width_px + 1.0
        way = (self.ends[1] - self.ends[0]) / length
        low = np.maximum(np.floor(self.ends.min(axis=0) - half), 0).astype(int)
        high = np.minimum(
            np.ceil(self.ends.max(axis=0) + half), [shape[1] - 1, shape[0] - 1]
        ).astype(int)
        columns, rows = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
        at = np.stack([columns, rows], axis=-1)
        t = (at - self.ends[0]) @ way / length
        first, second = (at @ line[:2] + line[2] for line in self.lines)
        inside = (first >= -0.5) & (second <= 0.5) & (t >= 0.0) & (t <= 1.0)
        axis = self.inverse[0] + (self.inverse[1] - self.inverse[0]) * t[inside]
        aside = np.clip((first + second)[inside] / max(self.width_px, 1e-6), -1.0, 1.0)
        w = axis / (1.0 - self.half_angle * np.sqrt(1.0 - np.square(aside)))  # its near side
        return rows[inside], columns[inside], w.astype(np.float32)

    @property
    def length_px(self) -> float:
        """Measures the bar from end to end."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    @property
    def width_px(self) -> float:
        """Measures the bar in its middle."""
        middle = self.ends.mean(axis=0)
        return float(abs((self.lines[0] - self.lines[1]) @ [*middle, 1.0]))


def bars_of(found: MatchedEdges, focal_px: float, rules: Bars) -> List[Bar]:
    """Edges at one depth beside each other, the long and narrow first: between two conductors is a
    wide gap, no bar.

    Of two edges whose colour within is the same, one depth is enough. An edge of its shade within a
    bar makes two; they grow together where the colour goes on.
    """
    n, candidates = len(found.edges), []
    for i in range(n):
        for k in range(n):
            merit, bar = _bar(found, i, k, rules) if i != k else (0.0, None)
            if bar is not None:
                candidates.append((merit, i, k, bar))
    free, bars = np.ones(n, bool), []
    for _, i, k, bar in sorted(candidates, key=lambda c: -c[0]):
        if free[i] and free[k]:
            free[i] = free[k] = False
            bars.append((i, k, bar))
    grown = [_grown(found, i, k, bar, free, rules) for i, k, bar in bars]
    return [replace(bar, half_angle=0.5 * bar.width_px / focal_px) for bar in grown]


def _bar(found: MatchedEdges, i: int, k: int, rules: Bars) -> Tuple[float, Optional[Bar]]:
    """How good a bar two edges make (px of length), the one with less of the way that matches move
    along first.

    It goes as far as the longer one of known depth, as wide as both are apart. (0, None) where they
    make none.
    """
    nothing, edges = (0.0, None), found.edges
    if not found.known[[i, k]].any() or _turned(edges.lines[[i, k]], rules):
        return nothing
    long, short = sorted((i, k), key=lambda m: (found.known[m], edges.lengths[m]), reverse=True)
    e = edges.ends[long]
    way = (e[1] - e[0]) / edges.lengths[long]
    seen = found.shared[long] * edges.lengths[long]
    run = (edges.ends[short] - e[0]) @ way
    both = min(seen[1], run[1]) - max(seen[0], run[0])
    # of the long one beside the short
    apart = np.array([edges.lines[short] @ [*(e[0] + t * way), 1.0] for t in run])
    width = float(abs(apart.mean()))
    beyond = apart if long == k else -apart  # the second edge lies further on
    fits = (
        both > 0.5 * min(seen[1] - seen[0], run[1] - run[0])
        and rules.least_width_px < beyond.min() <= beyond.max() < rules.most_width_px
    )
    if not fits or seen[1] - seen[0] < rules.least_aspect * width:
        return nothing
    merit = both - rules.narrow * width
    middle = e[0] + 0.5 * (max(seen[0], run[0]) + min(seen[1], run[1])) * way
    agree = (
        found.known[short]
        and abs(_at(found, long, middle) - _at(found, short, middle)) * found.speed[long]
    )
    if not found.known[short] or agree > rules.edges_differ_px:
        if np.abs(edges.colours[i, 1] - edges.colours[k, 0]).mean() > rules.inner_differ:
            return nothing
        merit *= rules.one_depth
    line = edges.lines[long]
    towards = 1.0 if long == i else -1.0  # to the other edge
    other = line - [0.0, 0.0, towards * width]
    ends = e[0] + seen[:, None] * way + 0.5 * towards * width * line[:2]
    inverse = np.array([_at(found, long, e[0] + t * way) for t in seen])
    lines = np.stack([line, other] if long == i else [other, line])
    return merit, Bar(lines, ends, inverse, rules.sigma_px / float(found.speed[long]))


def _turned(lines: np.ndarray, rules: Bars) -> bool:
    return bool(lines[0, :2] @ lines[1, :2] < np.cos(np.radians(rules.turned_deg)))


def _at(found: MatchedEdges, m: int, pixel: np.ndarray) -> float:
    """Inverse depth (1/m) of an edge beside a pixel."""
    begin, end = found.edges.ends[m]
    t = (pixel - begin) @ (end - begin) / ((end - begin) @ (end - begin))
    return float(found.inverse[m] @ [1.0 - t, t])


def _grown(found: MatchedEdges, i: int, k: int, bar: Bar, free: np.ndarray, rules: Bars) -> Bar:
    """Gives the bar with the edges beside it that no bar has, where its colour goes on up to
    them."""
    inside = 0.5 * (found.edges.colours[i, 1] + found.edges.colours[k, 0])
    while True:
        more = []
        for m in np.nonzero(free)[0]:
            for a, b, own in ((m, k, 1), (i, m, 0)):
                _, wider = _bar(found, a, b, rules)
                alike = np.abs(found.edges.colours[m, own] - inside).mean() < rules.inner_differ
                if (
                    wider is not None
                    and alike
                    and bar.width_px < wider.width_px < 3.0 * bar.width_px + 1.0
                ):
                    more.append((wider.width_px, a, b, m, wider))
        if not more:
            return bar
        _, i, k, m, bar = min(more, key=lambda c: c[0])
        free[m] = False

# SPDX-License-Identifier: Apache-2.0
"""Long straight edges in a picture, whatever is brighter: a thing before sky and wood changes from
dark to bright."""

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np

from fcsv_stereo.joint.tuning import Bars
from fcsv_stereo.model import as_grey, as_rgb

_SAMPLES = 24  # along an edge


@dataclass(frozen=True)
class Edges:
    """``ends`` (N,2,2; x, y in px); all run one way, ``along`` turned by 90 degrees. ``colours``
    (N,2,3) beside them, on the side of less of ``along`` first."""

    ends: np.ndarray
    colours: np.ndarray

    def __len__(self) -> int:
        return len(self.ends)

    def __getitem__(self, which) -> "Edges":
        return replace(self, **{f.name: getattr(self, f.name)[which] for f in fields(self)})

    @property
    def lengths(self) -> np.ndarray:
        """(N,) px."""
        return _lengths(self.ends)

    @property
    def ways(self) -> np.ndarray:
        """(N,2) unit vectors from the first end to the last."""
        return _ways(self.ends)

    @property
    def lines(self) -> np.ndarray:
        """(N,3): the product with a pixel (x, y, 1) is by how many px it lies beside the edge,
        towards ``along``."""
        normal = _normals(self.ways)
        return np.concatenate(
            [normal, -(normal * self.ends[:, 0]).sum(axis=1, keepdims=True)], axis=1
        )

    def parallel(self, most_deg: float) -> np.ndarray:
        """(N,N) bool: which are turned by less than that against each other."""
        ways = self.ways
        return ways @ ways.T > np.cos(np.radians(most_deg))


def find_edges(image: np.ndarray, along: np.ndarray, rules: Bars) -> Edges:
    """The long straight edges of a picture (HxWx3 or HxW uint8) that cross ``along`` ((2,), the way
    of matches)."""
    along = np.asarray(along, float) / np.linalg.norm(along)
    across = np.array([-along[1], along[0]])
    pieces = _pieces(as_grey(image), rules)
    way = pieces[:, 1] - pieces[:, 0]
    size = np.linalg.norm(way, axis=1)
    crosses = np.abs(way @ across) > np.sin(np.radians(rules.least_crossing_deg)) * size
    pieces, way = (
        pieces[crosses & (size > rules.least_piece_px)],
        way[crosses & (size > rules.least_piece_px)],
    )
    pieces = np.where((way @ across > 0.0)[:, None, None], pieces, pieces[:, ::-1])
    ends = _joined(pieces, rules)
    length = _lengths(ends)
    ends = ends[np.argsort(-length)][
        : min(rules.most_edges, int((length > rules.least_length_px).sum()))
    ]
    return Edges(ends, _beside(image, ends, rules.side_px))


def _lengths(ends: np.ndarray) -> np.ndarray:
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def _ways(ends: np.ndarray) -> np.ndarray:
    return (ends[:, 1] - ends[:, 0]) / np.maximum(_lengths(ends), 1e-9)[:, None]


def _normals(ways: np.ndarray) -> np.ndarray:
    return np.stack([ways[:, 1], -ways[:, 0]], axis=1)


def _pieces(grey: np.ndarray, rules: Bars) -> np.ndarray:
    """(N,2,2) from end to end (von Gioi et al. 2010, by OpenCV)."""
    k = rules.enlarged
    large = cv2.resize(grey, None, fx=k, fy=k, interpolation=cv2.INTER_CUBIC)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(large)[0]
    if found is None:
        return np.zeros((0, 2, 2))
    return (found.reshape(-1, 2, 2).astype(float) + 0.5) / k - 0.5


def _joined(pieces: np.ndarray, rules: Bars) -> np.ndarray:
    """Pieces of one straight edge as one (N,2,2), the longest first; each grows at both ends as
    long as one fits."""
    pieces = pieces[np.argsort(-_lengths(pieces))]
    size, ways = _lengths(pieces), _ways(pieces)
    free, joined = np.ones(len(pieces), bool), []
    for k in range(len(pieces)):
        if not free[k]:
            continue
        free[k], members, edge = False, [k], pieces[k]
        while True:
            way = edge[1] - edge[0]
            length = np.linalg.norm(way)
            way = way / length
            run, off = (pieces - edge[0]) @ way, np.abs((pieces - edge[0]) @ [-way[1], way[0]])
            gap = np.maximum(run[:, 0] - length, -run[:, 1])
            fits = (
                free
                & (off.max(axis=1) < rules.beside_px)
                & (ways @ way > np.cos(np.radians(rules.turned_deg)))
            )
            fits &= gap < np.minimum(rules.gap_px, length)
            if not fits.any():
                break
            n = int(np.argmin(np.where(fits, gap, np.inf)))
            free[n] = False
            members.append(n)
            edge = _fitted(pieces[members], size[members])
        joined.append(edge)
    return np.array(joined).reshape(-1, 2, 2)


def _fitted(pieces: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(2,2) the line of pieces (N,2,2), by their ends with their lengths as weights, from the first
    end to the last."""
    points, weights = pieces.reshape(-1, 2), np.repeat(size, 2)
    middle = np.average(points, axis=0, weights=weights)
    way = np.linalg.svd((points - middle) * np.sqrt(weights)[:, None], full_matrices=False)[2][0]
    way = way if way @ (pieces[0, 1] - pieces[0, 0]) > 0.0 else -way
    run = (points - middle) @ way
    return middle + np.array([[run.min()], [run.max()]]) * way


def _beside(image: np.ndarray, ends: np.ndarray, px: float) -> np.ndarray:
    """(N,2,3) medians of the colours on both sides."""
    if not len(ends):
        return np.zeros((0, 2, 3))
    rgb = as_rgb(image)
    t = np.linspace(0.03, 0.97, _SAMPLES)
    at = ends[:, :1] * (1.0 - t)[None, :, None] + ends[:, 1:] * t[None, :, None]
    normal = _normals(_ways(ends))[:, None]
    both = []
    for side in (-px, px):
        x, y = np.moveaxis((at + side * normal).astype(np.float32), -1, 0)
        seen = cv2.remap(
            rgb,
            np.ascontiguousarray(x),
            np.ascontiguousarray(y),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        both.append(np.median(seen.astype(float), axis=1))
    return np.stack(both, axis=1)

# SPDX-License-Identifier: Apache-2.0
"""Depth images of live monitoring against the truth: how many, how old, of one instant, and right
about what moves."""

import csv
import math
import zipfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import List, Mapping, Sequence, Tuple

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_stereo.errors import InputError
from fcsv_stereo.evaluating.evaluation import LEAST_SHARE, Band, Moving, band, moving
from fcsv_stereo.evaluating.truth import TrueScene, Truth

MOST_ERROR = 0.05  # of its distance, of the median answered pixel of what moves
_MOST_M = 400.0
_SEEN = 0.1  # of its pixels: what another camera sees less of has no second picture


@dataclass(frozen=True)
class Frame:
    """Is a depth image as it was published: depth (H,W f32, m, NaN: none) of the reference's
    picture, and what was said of it."""

    reference: str
    stamp_s: float
    depth: np.ndarray
    camera: PinholeCamera
    pairs: str
    skew_s: float
    rate_hz: float
    processing_s: float
    latency_s: float


@dataclass(frozen=True)
class Unjudged:
    """Something that moves and of which a frame shows too little: ``pixels`` of the ``whole`` that
    it would take if nothing stood before it. ``alone``: no other camera of the frame sees it, and
    it has no depth."""

    name: str
    pixels: int
    whole: int
    least: int
    alone: bool = False

    @property
    def why(self) -> str:
        """Says why in words.

        >>> [Unjudged("walker", *pixels, 16).why for pixels in ((3, 150), (0, 0), (9, 9))]
        ['hidden', 'outside the picture', 'too small']
        """
        if self.alone:
            return "seen by no other vehicle"
        if self.whole >= self.least:
            return "hidden"
        return "too small" if self.whole else "outside the picture"


@dataclass(frozen=True)
class MonitoringScore:
    """A frame against the truth; ``whole``: pixels that each thing that moves would take if nothing
    stood before it."""

    frame: Frame
    overall: Band
    moving: Tuple[Moving, ...]
    unjudged: Tuple[Unjudged, ...] = ()
    whole: Mapping[str, int] = field(default_factory=dict)


def save(folder: Path, frame: Frame) -> Path:
    """FOLDER/STAMP.npz."""
    c, path = frame.camera, folder / f"{frame.stamp_s:.3f}.npz"
    told = {
        k: getattr(frame, k)
        for k in ("reference", "stamp_s", "pairs", "skew_s", "rate_hz", "processing_s", "latency_s")
    }
    pinhole = [c.width, c.height, c.fx, c.fy, c.cx, c.cy]
    np.savez_compressed(path, depth=frame.depth.astype(np.float32), pinhole=pinhole, **told)
    return path


def load(folder: Path) -> List[Frame]:
    """All of a folder, in order of time. Raises InputError naming a file that is none."""
    frames = []
    for path in folder.glob("*.npz"):
        try:
            with np.load(path) as f:
                width, height, *rest = f["pinhole"].tolist()
                camera = PinholeCamera(int(width), int(height), *rest)
                words = {k: str(f[k]) for k in ("reference", "pairs")}
                numbers = {
                    k: float(f[k])
                    for k in ("stamp_s", "skew_s", "rate_hz", "processing_s", "latency_s")
                }
                frames.append(Frame(depth=f["depth"], camera=camera, **words, **numbers))
        except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: not a monitored depth image ({error})") from error
    return sorted(frames, key=lambda f: f.stamp_s)


def evaluate(frames: Sequence[Frame], truth: Truth) -> List[MonitoringScore]:
    """Raises InputError where the truth lacks one of them."""
    scene, judged = TrueScene(truth), []
    for f in frames:
        true_depth, on = scene.look(f.reference, f.stamp_s, f.camera)
        unhidden = scene.unhidden(f.reference, f.stamp_s, f.camera)
        whole, least = (
            {name: int(mask.sum()) for name, mask in unhidden.items()},
            math.ceil(LEAST_SHARE * f.depth.size),
        )
        shown = moving(f.depth, true_depth, on)
        alone = {
            m.name
            for m in shown
            if m.answered == 0.0 and _alone(f, truth, scene, true_depth, on[m.name])
        }
        seen = tuple(m for m in shown if m.name not in alone)
        rest = sorted(set(on) - {m.name for m in seen})
        unjudged = tuple(
            Unjudged(name, int(on[name].sum()), whole[name], least, name in alone) for name in rest
        )
        judged.append(
            MonitoringScore(f, band(f.depth, true_depth, (0.0, _MOST_M)), seen, unjudged, whole)
        )
    return judged


def _alone(
    f: Frame, truth: Truth, scene: TrueScene, true_depth: np.ndarray, on: np.ndarray
) -> bool:
    """Whether it is known that no other camera of the frame sees what is ``on`` (H,W bool) its
    picture."""
    others = sorted({vehicle for vehicle, _ in truth.cameras} - {f.reference})
    shares = [
        scene.seen_by(o, f.reference, f.stamp_s, f.camera, true_depth, on)
        for o in others
        if f"{o}," in f.pairs
    ]
    return bool(shares) and all(s is not None and s < _SEEN for s in shares)


def write_table(judged: Sequence[MonitoringScore], path: Path) -> None:
    """One row for each frame, and for each thing that moves in it, with what becomes of it
    (``verdict``)."""
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            [
                "stamp_s",
                "pairs",
                "skew_ms",
                "rate_hz",
                "processing_s",
                "age_s",
                "within_10_percent",
                "what",
                "verdict",
                "distance_m",
                "pixels",
                "unhidden_pixels",
                "answered",
                "median_error",
            ]
        )
        for j in judged:
            f = j.frame
            row = [
                f"{f.stamp_s:.3f}",
                f.pairs,
                f"{1e3 * f.skew_s:.1f}",
                f"{f.rate_hz:.2f}",
                f"{f.processing_s:.3f}",
                f"{f.latency_s:.3f}",
                f"{j.overall.within_10_percent:.3f}",
            ]
            writer.writerow([*row, "all", "", "", "", "", "", ""])
            for m in j.moving:
                error = "" if m.median_relative_error is None else f"{m.median_relative_error:.4f}"
                writer.writerow(
                    [
                        *row,
                        m.name,
                        verdict(m),
                        f"{m.distance_m:.2f}",
                        m.pixels,
                        j.whole[m.name],
                        f"{m.answered:.3f}",
                        error,
                    ]
                )
            for u in j.unjudged:
                writer.writerow([*row, u.name, u.why, "", u.pixels, u.whole, "", ""])


def verdict(m: Moving) -> str:
    """Gives the verdict of what is seen of something that moves: "right" is within 5 % of its
    distance."""
    if m.median_relative_error is None:
        return "not answered"
    return "right" if m.median_relative_error <= MOST_ERROR else "off"


def in_words(judged: Sequence[MonitoringScore]) -> List[str]:
    """Lines for the end of a demo; of what moves every image is counted, and why where it is not
    judged."""
    if not judged:
        return ["monitoring: no depth image came"]
    frames = [j.frame for j in judged]
    rates = [f.rate_hz for f in frames if f.rate_hz > 0.0]
    rate = f"median rate {np.median(rates):.1f} Hz" if rates else "no rate"
    lines = [
        f"monitoring: {len(frames)} depth images, {rate}, "
        f"skew at most {1e3 * max(f.skew_s for f in frames):.0f} ms, "
        f"median age {np.median([f.latency_s for f in frames]):.2f} s, "
        f"pixels to {_MOST_M:.0f} m within 10 %: {np.median([j.overall.within_10_percent for j in judged]):.0%}"
    ]
    names = sorted({m.name for j in judged for m in (*j.moving, *j.unjudged)})
    return lines + [_of_mover_in_words(name, judged) for name in names]


def _of_mover_in_words(name: str, judged: Sequence[MonitoringScore]) -> str:
    of = [m for j in judged for m in j.moving if m.name == name]
    errors = [m.median_relative_error for m in of if m.median_relative_error is not None]
    said = Counter(map(verdict, of))
    worst = f" (worst {max(errors):.1%})" if errors else ""
    parts = "".join(f", {said[word]} {word}" for word in ("off", "not answered") if said[word])
    why = Counter(u.why for j in judged for u in j.unjudged if u.name == name)
    left = (
        f"; not judged in {sum(why.values())}: " + ", ".join(f"{n} {w}" for w, n in why.items())
        if why
        else ""
    )
    return (
        f"  {name}, which moves: within {MOST_ERROR:.0%} of its distance in {said['right']} of the {len(of)} "
        f"images that show it{worst}{parts}{left}"
    )

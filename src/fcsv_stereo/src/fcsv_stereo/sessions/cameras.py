# SPDX-License-Identifier: Apache-2.0
"""Which intrinsics belong to a picture, from all camera_info of its topic.

Single messages that differ from those before and after them are left out. Where the camera really
changes (zoom, resolution), each picture has those of its own time, and a warning says so.
"""

import bisect
from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

from fcsv_geometry.camera import PinholeCamera
from fcsv_geometry.intrinsics import doubts
from fcsv_geometry.streams.stamps import in_order, stuck
from fcsv_stereo.sessions.left_out import LeftOut
from fcsv_stereo.sessions.stamped import Stamped

_ALIKE = (
    0.005  # of focal length and width: what a driver that estimates its camera anew makes of it
)
_ALIKE_D = 0.02
_ODD = (1, 2)  # messages in a row that are single wrong ones: of fewer than 8 messages, of more
_MANY = 8

Infos = List[Tuple[float, PinholeCamera]]


@dataclass(frozen=True)
class CameraTimeline:
    """Cameras by stamp (s), in order; one entry where it never changes."""

    stamps_s: Tuple[float, ...]
    cameras: Tuple[PinholeCamera, ...]

    def at(self, stamp_s: float) -> PinholeCamera:
        """That of the camera_info nearest in time."""
        i = bisect.bisect_left(self.stamps_s, stamp_s)
        near = [k for k in (i - 1, i) if 0 <= k < len(self.stamps_s)]
        return self.cameras[min(near, key=lambda k: abs(self.stamps_s[k] - stamp_s))]


def timeline(infos: Stamped, left_out: LeftOut, warnings: List[str]) -> List[CameraTimeline]:
    """One, or none where no camera_info can be believed: then ``left_out`` has all of them."""
    recorded = infos.recorded(lambda a, b: a == b, warnings)
    runs = _runs(recorded)
    long = [run for run in runs if len(runs) == 1 or len(run) > _ODD[len(recorded) >= _MANY]]
    kept = [run for run in runs if any(_alike(run[0][1], k[0][1]) for k in long)]
    odd = [run for run in runs if not any(run is k for k in kept)]
    for entry in (e for run in odd for e in run):
        left_out.add(infos.topic, entry[0], _odd(entry[1], kept[0][0][1] if kept else None))
    if not kept:
        return []
    believed = [entry for run in kept for entry in run]
    changes = _changes(kept)
    warnings += [f"topic {infos.topic}: {text}" for text in (*changes, *doubts(believed[0][1]))]
    if not changes and all(c == believed[0][1] for _, c in believed):
        _note_stamps(infos.topic, believed, left_out)
        return [CameraTimeline(believed[0][:1], believed[0][1:])]
    return _by_stamp(infos.topic, believed, left_out)


def _note_stamps(topic: str, believed: Infos, left_out: LeftOut) -> None:
    """Wrong stamps change nothing about a camera that stays the same, and are said."""
    stamps = [s for s, _ in believed]
    if not stuck(stamps):
        for i, why in in_order(stamps).left_out.items():
            if stamps[i] != stamps[i - 1]:
                left_out.add(topic, stamps[i], f"its stamp {why}")


def _by_stamp(topic: str, believed: Infos, left_out: LeftOut) -> List[CameraTimeline]:
    stamped = Stamped(topic, [(topic, s, c) for s, c in believed])
    found = stamped.in_order(lambda a, b: a == b, left_out, [], None)
    return [CameraTimeline(tuple(s for s, _ in found), tuple(c for _, c in found))] if found else []


def _runs(recorded: Infos) -> List[Infos]:
    """Neighbours that are alike, together."""
    runs: List[Infos] = []
    for entry in recorded:
        if runs and _alike(runs[-1][-1][1], entry[1]):
            runs[-1].append(entry)
        else:
            runs.append([entry])
    return runs


def _alike(a: PinholeCamera, b: PinholeCamera) -> bool:
    if (a.width, a.height, len(a.distortion)) != (b.width, b.height, len(b.distortion)):
        return False
    focal = np.allclose((a.fx, a.fy), (b.fx, b.fy), rtol=_ALIKE, atol=0.0)
    middle = np.allclose((a.cx, a.cy), (b.cx, b.cy), rtol=0.0, atol=_ALIKE * a.width)
    return bool(
        focal and middle and np.allclose(a.distortion, b.distortion, rtol=0.0, atol=_ALIKE_D)
    )


def _words(camera: PinholeCamera) -> str:
    focal = f"focal length {camera.fx:.6g}, {camera.fy:.6g} px"
    middle = f"principal point {camera.cx:.6g}, {camera.cy:.6g}"
    return f"{camera.width}x{camera.height}, {focal}, {middle}"


def _odd(camera: PinholeCamera, other) -> str:
    """Why a message is left out."""
    if other is None:
        said = f"intrinsics differ from message to message ({_words(camera)})"
        return f"{said}: do two nodes publish them?"
    same = _words(camera) == _words(other)
    of = (
        f"distortion {list(camera.distortion)} where it is {list(other.distortion)}"
        if same
        else (f"{_words(camera)} where the others have {_words(other)}")
    )
    return f"intrinsics of this message alone are {of}"


def _changes(kept: List[Infos]) -> List[str]:
    """Says, in words, where a camera changed for good."""
    return [
        _changed(a[-1][1], *b[0]) for a, b in zip(kept, kept[1:]) if not _alike(a[-1][1], b[0][1])
    ]


def _changed(before: PinholeCamera, stamp_s: float, after: PinholeCamera) -> str:
    return (
        f"the camera changes at stamp {stamp_s:.3f} from {_words(before)} to {_words(after)}: "
        "each picture is mapped with the intrinsics of its own time"
    )

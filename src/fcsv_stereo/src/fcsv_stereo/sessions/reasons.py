# SPDX-License-Identifier: Apache-2.0
"""Why a vehicle has no picture in any recording window: one sentence per cause."""

from typing import Collection, Sequence, Tuple

from fcsv_geometry.streams.stamps import stuck
from fcsv_stereo.in_flight.live import RecordingWindow
from fcsv_stereo.sessions.left_out import LeftOut
from fcsv_stereo.sessions.pictures import PicturesSeen

_APART_S = 1.0


def why_no_pictures(
    vehicle: str,
    topic: str,
    seen: PicturesSeen,
    windows: Sequence[RecordingWindow],
    span_s: Tuple[float, float],
    topics: Collection[str],
    left_out: LeftOut,
) -> str:
    """``topic``: where pictures are wanted; ``topics``: all of the bags; ``span_s``: of
    odometry."""
    if not seen.topic:
        return _none(vehicle, topic, topics)
    where, why = f"topic {seen.topic}", stuck(seen.stamps_s)
    if why and len(seen.stamps_s) > 1:
        return f"{where}: all stamps {why}"
    first_s, last_s = min(seen.stamps_s), max(seen.stamps_s)
    if not seen.inside:
        return _outside(where, first_s, last_s, windows)
    if seen.unposed:
        return (
            f"{where}: {seen.unposed} pictures have no odometry at their stamp: they are from "
            f"{first_s:.3f} to {last_s:.3f}, odometry is from {span_s[0]:.3f} to {span_s[1]:.3f}; "
            "do camera and tracker share a clock?"
        )
    return f"{where}: {left_out.only_reason(seen.topic) or 'no picture in a window can be used'}"


def _none(vehicle: str, topic: str, topics: Collection[str]) -> str:
    others = sorted(t for t in topics if t.startswith(topic + "/"))
    if not others:
        missing = f"topics {topic} and {topic}/compressed are missing"
        return f"no picture of {vehicle} was recorded: {missing}"
    said = f"of {vehicle} only {', '.join(others)} was recorded, which is not read"
    return f"{said}: record {topic} or {topic}/compressed"


def _outside(where: str, first_s: float, last_s: float, windows: Sequence[RecordingWindow]) -> str:
    start_s, stop_s = min(w.start_s for w in windows), max(w.stop_s for w in windows)
    said = (
        f"{where}: {first_s:.3f} to {last_s:.3f} do not overlap in time with the recording windows, "
        f"{start_s:.3f} to {stop_s:.3f} (/mission/capture)"
    )
    ahead_s = (
        first_s - stop_s if first_s > stop_s else last_s - start_s if last_s < start_s else 0.0
    )
    if abs(ahead_s) < _APART_S:
        return said
    return f"{said}: is its clock {abs(ahead_s):.0f} s {'ahead' if ahead_s > 0 else 'behind'}?"

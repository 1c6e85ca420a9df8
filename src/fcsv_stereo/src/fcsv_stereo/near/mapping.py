# SPDX-License-Identifier: Apache-2.0
"""Leads from a session's depth frames to a map that holds the near field."""

import time
from dataclasses import replace
from typing import Dict, List

from fcsv_stereo.errors import InputError
from fcsv_stereo.model import MapInput, MapResult, Picture
from fcsv_stereo.near.join import join
from fcsv_stereo.near.volume import NearVolume


def with_near(result: MapResult, given: MapInput) -> MapResult:
    """The map joined with what ``given.near`` saw along the whole flight.

    Without a frame of use, and without open3d, it is unchanged but for a warning. Raises InputError
    where a frame is none.
    """
    if given.near is None:
        return result
    started = time.perf_counter()
    try:
        volume = NearVolume()
    except InputError as error:
        result.warnings.append(f"no near field: {error}")
        return result
    counted: Dict[str, int] = {}
    for frame in given.near.frames():
        volume.integrate(frame)
        counted[frame.vehicle] = counted.get(frame.vehicle, 0) + 1
    result.warnings += given.near.warnings
    if not volume.frames:
        result.warnings.append(
            "the session's depth frames show nothing that can be used: no near field"
        )
        return result
    joined = join(result, volume.surface(), counted, _pictures(result, given))
    joined.timing_s["near"] = time.perf_counter() - started
    return joined


def _pictures(result: MapResult, given: MapInput) -> List[Picture]:
    """Pictures of the map with the poses that they got, the reference first."""
    known = {p.name: p for c in given.configurations for p in (*c.references, *c.others)}
    used = [
        replace(known[i.name], T_home_cam=i.T_home_cam) for i in result.images if i.name in known
    ]
    return sorted(used, key=lambda p: p.name != result.reference.name)

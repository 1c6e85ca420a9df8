# SPDX-License-Identifier: Apache-2.0
"""Depth of thin things from near to far, with and without tilt, against truth and equation 2.12."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, Iterator, Optional, Sequence, Tuple

import numpy as np

from fcsv_sim.tilting.place import RenderedView, TiltingPlace
from fcsv_sim.tilting.rig import SimulatedRig
from fcsv_sim.tilting.shots import photographed, posed_by
from fcsv_stereo import pipeline
from fcsv_stereo.errors import StereoError
from fcsv_stereo.joint.bars import with_bars
from fcsv_stereo.planning.toed_in import depth_error
from fcsv_tracking.tilting.aim import PARALLEL, AimRules, crossing
from fcsv_tracking.tilting.rig import TiltAngles, TiltingRig

DISTANCES_M = (0.3, 0.4, 0.6, 1.0, 2.0, 4.0, 6.0, 10.0)
_LEAST_RADIUS_M, _RADIUS_SHARE = 0.15, 0.15
_RIGHT_SHARE = 0.1  # of the depth: what is farther off is wrong


@dataclass(frozen=True)
class PairOutcome:
    """One pair of pictures. The thing is its part within 0.15 m of its middle, and 15 % of the
    distance.

    Shares are of its pixels as a picture twice as wide would show them: ``shown`` in the left
    picture, ``covered`` with a depth, ``right`` within 10 %, ``bounded`` within equation 2.12 for
    one pixel. ``error_m`` is the median of those with a depth, ``bound_m`` the median bound of them
    (NaN where there are none). ``refused``: why poses were not refined. ``drawn``: ``right`` with
    poses by the rig's drawing instead of its calibration; NaN where not tried. Straight thin things
    are matched as wholes besides (``map --bars``); ``unbarred`` is ``right`` without that.
    """

    thing: str
    distance_m: float
    tilt: bool
    angles: TiltAngles
    pixels: int
    shown: float
    covered: float
    right: float
    bounded: float
    error_m: float
    bound_m: float
    refused: str
    drawn: float
    unbarred: float
    view: RenderedView
    depth: np.ndarray


def outcomes(
    simulated: SimulatedRig,
    drawing: TiltingRig,
    things: Sequence[str],
    distances_m: Sequence[float] = DISTANCES_M,
    seed: int = 1,
    folder: Optional[Path] = None,
    rules: Optional[AimRules] = None,
    say: Callable[[str], None] = lambda _line: None,
) -> Iterator[PairOutcome]:
    """Gives outcomes of every thing from every distance, parallel and tilted; the folders that
    ``map`` reads stay in ``folder``.

    Poses are those of what the rig is told to be, its calibration; of tilted pairs also those of
    its ``drawing``.
    """
    rig, place, rules = simulated.told, TiltingPlace(seed), rules or AimRules()
    with tempfile.TemporaryDirectory() as scratch:
        for thing in things:
            for distance_m in distances_m:
                tilted = (
                    crossing(rig, distance_m) if distance_m < rules.parallel_beyond_m else PARALLEL
                )
                name = f"{thing}_{distance_m:g}m"
                simulated.turn(PARALLEL)
                found = _one(
                    place,
                    simulated,
                    thing,
                    distance_m,
                    None,
                    (folder or Path(scratch)) / f"{name}_parallel",
                )
                say(in_words(found))
                yield found
                if tilted != PARALLEL:
                    simulated.turn(tilted)
                    found = _one(
                        place,
                        simulated,
                        thing,
                        distance_m,
                        drawing,
                        (folder or Path(scratch)) / f"{name}_tilted",
                    )
                    say(in_words(found))
                yield replace(found, tilt=True)  # beyond it stands as it did: the same pictures


def _one(
    place: TiltingPlace,
    rig: SimulatedRig,
    thing: str,
    distance_m: float,
    drawing: Optional[TiltingRig],
    folder: Path,
) -> PairOutcome:
    """Tilted where there is a drawing to compare with."""
    left, _ = photographed(place, rig, thing, distance_m, folder)
    plain, depth, refused = map_depth(folder, left.depth.shape)
    camera, T_rig_left = rig.true.left.camera, rig.T_rig_cams()[0]
    T_world_cam = place.T_world_rig(thing, distance_m) @ T_rig_left
    radius_m = radius_of(distance_m)
    shown, pixels = place.shown(thing, T_world_cam, camera, radius_m)
    part = left.thing & place.near(thing, left.depth, T_world_cam, camera, radius_m)
    answered = part & np.isfinite(depth)
    error = np.abs(depth[answered] - left.depth[answered])
    xy = camera.rays()[answered][:, :2]
    bound = depth_error(
        left.depth[answered], xy, rig.true.T_left_right(rig.angles), rig.true.right.camera
    )
    pixels = max(pixels, 1)
    nan = float("nan")
    drawn = nan
    if drawing is not None:
        _, by_drawing, _ = map_depth(
            posed_by(drawing, rig.read(), folder, Path(f"{folder}_drawn")), left.depth.shape
        )
        drawn = right_pixels(by_drawing, left.depth, part) / pixels
    return PairOutcome(
        thing,
        distance_m,
        drawing is not None,
        rig.read(),
        pixels,
        shown / pixels,
        error.size / pixels,
        right_pixels(depth, left.depth, part) / pixels,
        float((error <= bound).sum()) / pixels,
        float(np.median(error)) if error.size else nan,
        float(np.median(bound)) if error.size else nan,
        refused,
        drawn,
        right_pixels(plain, left.depth, part) / pixels,
        left,
        depth,
    )


def right_pixels(depth: np.ndarray, truth: np.ndarray, part: np.ndarray) -> int:
    """How many pixels of a ``part`` (HxW bool) have a ``depth`` within 10 % of the truth (HxW, m,
    NaN where none)."""
    with np.errstate(invalid="ignore"):
        return int((part & (np.abs(depth - truth) <= _RIGHT_SHARE * truth)).sum())


def radius_of(distance_m: float) -> float:
    """Within this of its middle (m) a thing's part counts."""
    return max(_LEAST_RADIUS_M, _RADIUS_SHARE * distance_m)


def map_depth(folder: Path, shape: Tuple[int, int]) -> Tuple[np.ndarray, np.ndarray, str]:
    """Depth (H,W float32, m, NaN) as the commands ``map`` and ``map --bars`` make it, and what is
    said against it.

    Where refinement is refused, since pictures from so far apart share no features, the rig's own
    poses count, as with ``map --no-refine``.
    """
    method, given = pipeline.METHODS[pipeline.DEFAULT_METHOD], pipeline.load(folder)
    refused = ""
    for options in (method.options(), method.trusting_poses(method.options())):
        try:
            found = method.map(given, options)
            return found.depth, with_bars(found, [p.pictures for p in found.pairs]).depth, refused
        except StereoError as error:
            refused = str(error)
    nothing = np.full(shape, np.nan, np.float32)
    return nothing, nothing, refused


def in_words(o: PairOutcome) -> str:
    """One line for a person."""
    turned = f"{np.degrees(np.mean(o.angles)):4.1f} deg" if o.tilt else "parallel"
    ends = (
        f"error {1e3 * o.error_m:.1f} mm, 2.12 {1e3 * o.bound_m:.1f} mm"
        if np.isfinite(o.error_m)
        else ""
    )
    shares = f"shown {o.shown:4.0%}, covered {o.covered:4.0%}, right {o.right:4.0%} (without bars {o.unbarred:4.0%})"
    kept = ", poses as read" if o.refused else ""
    kept += f", by the drawing right {o.drawn:4.0%}" if np.isfinite(o.drawn) else ""
    return f"{o.thing:6} {o.distance_m:4g} m  {turned}  {shares}  {ends}{kept}"

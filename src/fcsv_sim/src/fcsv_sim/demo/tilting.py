# SPDX-License-Identifier: Apache-2.0
"""``make demo SYSTEM=tilting``: the tilting stereo camera before thin things. Nothing flies, no ROS
is needed."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Callable, Optional, Sequence

import numpy as np

from fcsv_geometry import transforms
from fcsv_geometry.programs.workspace import bringup
from fcsv_geometry.programs.writing import require_folder
from fcsv_sim.errors import SimulationError
from fcsv_sim.tilting.calibrated import calibrate_simulated
from fcsv_sim.tilting.live import live_depths, write_live
from fcsv_sim.tilting.report import table, write_curves, write_pictures
from fcsv_sim.tilting.rig import SimulatedRig, as_made
from fcsv_sim.tilting.things import THINGS
from fcsv_sim.tilting.trial import DISTANCES_M, PairOutcome, outcomes
from fcsv_stereo import pipeline
from fcsv_stereo.errors import StereoError
from fcsv_tracking.tilting.aim import nearest_m
from fcsv_tracking.tilting.rig import TiltAngles, TiltingRig, load_rig
from fcsv_tracking.tilting.rig_file import write_rig

_FOLDERS = ("pairs", "map")
_FILES = ("curves.png", "pictures.png", "pictures_far.png", "table.md", "live.png")
_SHOWN_M = (0.4, 4.0)
_LIVE_M = 2.0
_RIG = "rig.yaml"
_LEAST_MIB = 100
_SIZE_M = 0.1  # of the thing whose nearest distance is told


def run(
    out: Path,
    say: Callable[[str], None],
    seed: int = 1,
    overwrite: bool = False,
    things: Sequence[str] = tuple(THINGS),
    distances_m: Sequence[float] = DISTANCES_M,
    rig_file: str = "",
) -> int:
    """The whole story: a rig, pictures of thin things from near to far, depth as ``map`` makes it,
    table and pictures.

    Raises SimulationError where ``out`` holds an earlier demo and ``overwrite`` is not said.
    """
    out = out.resolve()
    _empty(out, overwrite)
    path = Path(rig_file) if rig_file else bringup() / "config" / "tilting" / "rig.yaml"
    drawing = load_rig(path)
    simulated = SimulatedRig(drawing, seed, built=as_made)
    say(f"rig: {path}, its drawing; as made it is off by {_off(drawing, simulated)}")
    rig = _calibrated(simulated, out, seed, say)
    parallel_m, tilted_m = (nearest_m(rig, _SIZE_M, tilt) for tilt in (False, True))
    say(
        f"baseline {rig.baseline_m:.2f} m, cameras turn inward by up to {rig.limits_deg[1]:.0f} deg"
    )
    say(
        f"both cameras see a thing of {_SIZE_M:g} m whole from {parallel_m:.2f} m on, tilted from {tilted_m:.2f} m"
    )
    say(
        f"building farmland with {', '.join(things)}; pictures and their depth follow (seed {seed})"
    )
    found = list(outcomes(simulated, drawing, things, distances_m, seed, out / "pairs", say=say))
    (out / "table.md").write_text("\n".join(table(found)) + "\n")
    write_curves(found, out / "curves.png")
    near_m, far_m = (min(distances_m, key=lambda d: abs(d - shown_m)) for shown_m in _SHOWN_M)
    write_pictures(found, near_m, out / "pictures.png")
    write_pictures(found, far_m, out / "pictures_far.png")
    _live(
        out, min((o for o in found if not o.tilt), key=lambda o: abs(o.distance_m - _LIVE_M)), say
    )
    half_right = [o for o in found if o.tilt and not o.refused and o.right >= 0.5]
    _report(out, min(half_right, key=lambda o: o.distance_m, default=None), say)
    words = (f"pictures and depth at {shown_m:g} m" for shown_m in (near_m, far_m))
    for name, what in zip(
        _FILES, ("coverage and error over distance", *words, "table", "live depth")
    ):
        print(f"{what}: {out / name}")
    return 0


def _calibrated(
    simulated: SimulatedRig, out: Path, seed: int, say: Callable[[str], None]
) -> TiltingRig:
    """The rig's file after calibration with a board of tags, which the rig is told from now on."""
    found = calibrate_simulated(simulated, seed)
    simulated.told = write_rig(out / _RIG, found.rig, f"make demo SYSTEM=tilting, seed {seed}")
    known = found.rig.known
    say(
        f"calibrated with a board of tags: {out / _RIG}, off by {_off(found.rig, simulated)}; "
        f"said to be known to {known.rotation_deg:.3f} deg and {1e3 * known.position_m:.2f} mm per axis"
    )
    return simulated.told


def _off(rig: TiltingRig, simulated: SimulatedRig) -> str:
    """The right camera against the left one, worst of angles."""
    turn_deg, away_m = 0.0, 0.0
    for angle in np.radians((0.0, 15.0, 30.0)):
        told, true = (r.T_left_right(TiltAngles(angle, angle)) for r in (rig, simulated.true))
        turn_deg = max(turn_deg, float(np.degrees(transforms.rotation_angle(told, true))))
        away_m = max(away_m, float(np.linalg.norm(told[:3, 3] - true[:3, 3])))
    return f"{turn_deg:.3f} deg and {1e3 * away_m:.2f} mm"


def _live(out: Path, shown: PairOutcome, say: Callable[[str], None]) -> None:
    """Depth as the live map makes it, without bars and with them."""
    depths = live_depths(out / "pairs" / f"{shown.thing}_{shown.distance_m:g}m_parallel", shown)
    write_live(shown, depths, out / _FILES[-1])
    without, barred = (
        f"{d.right:.0%} of its pixels within 10 % in {d.took_s:.2f} s of a core" for d in depths
    )
    say(f"live depth of {shown.thing} at {shown.distance_m:g} m: {without}; with bars {barred}")


def _report(out: Path, chosen: Optional[PairOutcome], say: Callable[[str], None]) -> None:
    """The map command's own report, of the nearest pair that came out well."""
    if chosen is None:
        say("no pair was refined and half right: no report of a map")
        return
    name = f"{chosen.thing}_{chosen.distance_m:g}m"
    pair = next(
        p
        for p in (out / "pairs" / f"{name}_tilted", out / "pairs" / f"{name}_parallel")
        if p.is_dir()
    )
    say(f"mapping {pair.name} with its report")
    method = pipeline.METHODS[pipeline.DEFAULT_METHOD]
    try:
        pipeline.run(
            pipeline.MapRequest(
                pair, out / "map", method.name, replace(method.options(), bars=True)
            )
        )
    except StereoError as error:
        raise SimulationError(f"{pair}: no map ({error})") from error
    print(f"report: {out / 'map' / 'report.html'}")


def _empty(out: Path, overwrite: bool) -> None:
    """Remove what an earlier demo left, and nothing else."""
    if any(p.exists() and not p.is_dir() for p in (out, *out.parents)):
        raise SimulationError(f"{out}: a file stands there, not a folder; choose another with OUT=")
    if (out / "session").exists():
        raise SimulationError(f"{out} holds a recorded flight: choose another folder with OUT=")
    if (out / "pairs").exists() and not overwrite:
        raise SimulationError(
            f"{out} holds an earlier demo: OVERWRITE=1 replaces it, OUT=FOLDER makes another"
        )
    require_folder(out, _LEAST_MIB)
    for name in _FOLDERS:
        if (out / name).exists():
            shutil.rmtree(out / name)
    for name in (*_FILES, _RIG):
        (out / name).unlink(missing_ok=True)
    out.mkdir(parents=True, exist_ok=True)

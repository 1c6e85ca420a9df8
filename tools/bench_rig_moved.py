# SPDX-License-Identifier: Apache-2.0
"""Power lines by one pair of the parallel tilting rig, and by two: the rig moved, so that baselines of two directions
tell conductors as far apart as the cameras from their neighbours. The figures are in docs/lab/tilting.md.

.venv/bin/python tools/bench_rig_moved.py

The rig is calibrated as in ``make demo SYSTEM=tilting``. Then it stands 0.13 m aside, 0.1 m higher and rolled by 12
degrees, known to 5 mm and 0.1 degrees. Told is the share of the middle line's pixels within 10 %.
"""

import argparse

import numpy as np

from fcsv_geometry import transforms
from fcsv_sim.bringup import bringup
from fcsv_sim.tilting.calibrated import calibrate_simulated
from fcsv_sim.tilting.place import Place
from fcsv_sim.tilting.rig import SimulatedRig, as_made
from fcsv_sim.tilting.trial import radius_of, right_pixels
from fcsv_stereo.errors import StereoError
from fcsv_stereo.joint import Joint, JointOptions
from fcsv_stereo.model import Axis, Configuration, ConfigurationInput, MapInput, Picture, PosePrior
from fcsv_tracking.tilting.aim import PARALLEL
from fcsv_tracking.tilting.rig import SIDES, load_rig

_MOVED = transforms.from_xyz_rpy([0.0, 0.13, 0.10], np.radians([12.0, 0.0, 0.0]))
_KNOWN_M, _KNOWN_RAD = 0.005, float(np.radians(0.1))


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    place = Place(1)
    rig = SimulatedRig(load_rig(bringup() / "config" / "tilting" / "rig.yaml"), 1, built=as_made)
    rig.told = calibrate_simulated(rig, 1).rig
    rig.turn(PARALLEL)
    for distance_m in (1.0, 2.0, 4.0):
        pictures, view, T_world_left = taken(place, rig, distance_m)
        camera = rig.true.left.camera
        part = view.thing & place.near("lines", view.depth, T_world_left, camera, radius_of(distance_m))
        shares = []
        for others in (pictures[1:2], pictures[1:]):
            for bars in (False, True):
                right = right_pixels(mapped(pictures[0], others, bars), view.depth, part)
                shares.append(f"{right / part.sum():.0%}")
        pair, pair_bars, moved, moved_bars = shares
        print(f"{distance_m:g} m: one pair {pair}, with bars {pair_bars}; rig moved {moved}, with bars {moved_bars}")


def taken(place: Place, rig: SimulatedRig, distance_m: float):
    """Left and right, and both again where the rig stands then; the first's truth, and T_world_cam of it."""
    random, pictures, views = np.random.default_rng(4), [], []
    T_world_rig = place.T_world_rig("lines", distance_m)
    for k, T in enumerate((np.eye(4), _MOVED)):
        off = transforms.from_xyz_rpy(random.normal(0.0, _KNOWN_M, 3), random.normal(0.0, _KNOWN_RAD, 3))
        told = T @ off if k else T
        for n, (side, T_rig_cam) in enumerate(zip(SIDES, rig.T_rig_cams())):
            true, said = (getattr(r, side).camera for r in (rig.true, rig.told))
            views.append(place.photograph("lines", T_world_rig @ T @ T_rig_cam, true, 10 * k + n))
            pose = told @ rig.told.T_rig_cam(side, rig.read())
            pictures.append(Picture(f"{side}_{k}", "rig", 0.0, views[-1].image, said, pose))
    return pictures, views[0], T_world_rig @ rig.T_rig_cams()[0]


def mapped(reference: Picture, others, bars: bool) -> np.ndarray:
    """Depth (H,W) m; NaN everywhere where there is no map."""
    given = [ConfigurationInput(Configuration(Axis.HORIZONTAL, 0.3, 0.0, o.name), [reference], [o]) for o in others]
    prior = PosePrior(_KNOWN_RAD, _KNOWN_M, 0.001)
    try:
        return Joint().map(MapInput("photographs", given, prior=prior), JointOptions(bars=bars)).depth
    except StereoError as error:
        print(error)
        return np.full(reference.image.shape[:2], np.nan)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Pictures of the rig as the folder that ``map`` reads: posed by the angles as they were read, with
their priors."""

import shutil
from pathlib import Path
from typing import Tuple

import cv2
import numpy as np

from fcsv_sim.tilting.place import RenderedView, TiltingPlace
from fcsv_sim.tilting.rig import SimulatedRig
from fcsv_stereo.photos.models import write_model
from fcsv_stereo.posed.colmap_images import PosedImage
from fcsv_stereo.posed.priors import FILE as PRIORS
from fcsv_tracking.tilting.rig import SIDES, TiltAngles, TiltingRig


def photographed(
    place: TiltingPlace, rig: SimulatedRig, thing: str, distance_m: float, folder: Path
) -> Tuple[RenderedView, RenderedView]:
    """Both pictures as they stand in ``folder`` (images/, cameras.txt, images.txt, priors.csv),
    left first.

    ``home`` is the rig's frame, poses are those of ``rig.told``. The folder must be new.
    """
    (folder / "images").mkdir(parents=True)
    T_world_rig = place.T_world_rig(thing, distance_m)
    views = []
    for number, (side, T_rig_cam) in enumerate(zip(SIDES, rig.T_rig_cams())):
        camera = getattr(rig.true, side).camera
        view = place.photograph(thing, T_world_rig @ T_rig_cam, camera, number)
        cv2.imwrite(str(folder / "images" / f"{side}.png"), view.image[..., ::-1])
        views.append(view)
    _pose(folder, rig.told, rig.read())
    return views[0], views[1]


def posed_by(rig: TiltingRig, read: TiltAngles, taken: Path, folder: Path) -> Path:
    """The pictures of ``taken`` in a folder of their own, posed by what another file says of the
    rig."""
    shutil.copytree(taken / "images", folder / "images")
    _pose(folder, rig, read)
    return folder


def _pose(folder: Path, rig: TiltingRig, read: TiltAngles) -> None:
    posed, lines = [], ["name,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg"]
    for number, side in enumerate(SIDES):
        posed.append(PosedImage(f"{side}.png", number, rig.T_rig_cam(side, read)))
        sigma = np.sqrt(np.diag(rig.covariance(side, read)))
        lines.append(
            ",".join([f"{side}.png", *(f"{v:.9g}" for v in (*sigma[:3], *np.degrees(sigma[3:])))])
        )
    write_model(folder, {0: rig.left.camera, 1: rig.right.camera}, posed)
    (folder / PRIORS).write_text("\n".join(lines) + "\n")

# SPDX-License-Identifier: Apache-2.0
"""Pictures of the rig as the folder that ``map`` reads: posed by the angles as they were read, with their priors."""

from pathlib import Path
from typing import Tuple

import cv2
import numpy as np

from fcsv_sim.tilting.place import Place, View
from fcsv_sim.tilting.rig import SimulatedRig
from fcsv_stereo.colmap import PosedImage
from fcsv_stereo.photos.models import write_model
from fcsv_stereo.priors import FILE as PRIORS
from fcsv_tracking.tilting.rig import SIDES


def take(place: Place, rig: SimulatedRig, thing: str, distance_m: float, folder: Path) -> Tuple[View, View]:
    """Both pictures as they stand in ``folder`` (images/, cameras.txt, images.txt, priors.csv), left first.

    ``home`` is the rig's frame. The folder must be new.
    """
    (folder / "images").mkdir(parents=True)
    T_world_rig = place.T_world_rig(thing, distance_m)
    read, views, posed = rig.read(), [], []
    lines = ["name,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg"]
    for number, (side, T_rig_cam) in enumerate(zip(SIDES, rig.T_rig_cams())):
        camera = getattr(rig.true, side).camera
        view = place.photograph(thing, T_world_rig @ T_rig_cam, camera, number)
        name = f"{side}.png"
        cv2.imwrite(str(folder / "images" / name), view.image[..., ::-1])
        posed.append(PosedImage(name, number, rig.told.T_rig_cam(side, read)))
        sigma = np.sqrt(np.diag(rig.told.covariance(side, read)))
        lines.append(",".join([name, *(f"{v:.9g}" for v in (*sigma[:3], *np.degrees(sigma[3:])))]))
        views.append(view)
    write_model(folder, {0: rig.told.left.camera, 1: rig.told.right.camera}, posed)
    (folder / PRIORS).write_text("\n".join(lines) + "\n")
    return views[0], views[1]

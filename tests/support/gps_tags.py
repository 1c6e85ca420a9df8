# SPDX-License-Identifier: Apache-2.0
"""Photographs with GPS tags as cameras write them: pixels of a file or of a scene, tags written
here."""

import numpy as np
from PIL import Image, TiffImagePlugin
from scipy.spatial.transform import Rotation

from fcsv_geometry import transforms
from fcsv_geometry.earth import east_north_up_m
from fcsv_stereo.photos.models import write_model
from fcsv_stereo.photos.tags import Gps
from fcsv_stereo.posed import colmap
from support.scenes import CAMERA, camera_pose, photograph

ORIGIN = Gps(48.1371, 11.5754, 520.0)
FOCAL_35_MM = 33  # of CAMERA, in whole millimetres, as cameras write it
# in home
PLACES_M = np.array([[0.0, 0, 0], [0, -3, 0.5], [0.5, 3, 1.5], [1, -6, 1.5], [-0.5, 6, 0]])


def flown_photographs(folder):
    """``folder`` with photographs of the drawn walls in photos/, GPS good to 5 cm (home's x is
    north-east), and COLMAP's model of them in model/, as text."""
    rng = np.random.default_rng(2)
    (folder / "photos").mkdir(parents=True)
    (folder / "model").mkdir()
    R_enu_home = Rotation.from_euler("z", 45, degrees=True).as_matrix()
    T_model_home = transforms.from_xyz_rpy([3.0, -1.0, 2.0], [0.4, -0.8, 2.0])
    posed = []
    for i, p in enumerate(PLACES_M):
        T_home_cam = camera_pose(p, (0.0, 0.0, -2.0 * p[1]))
        gps = gps_at(R_enu_home @ p + rng.normal(0, 0.05, 3))
        write_tagged(
            folder / "photos" / f"{i}.jpg",
            photograph(T_home_cam),
            gps,
            1,
            FOCAL_35_MM,
            error_m=0.05,
        )
        T_model_cam = T_model_home @ T_home_cam
        T_model_cam[:3, 3] *= 0.37
        posed.append(colmap.PosedImage(f"{i}.jpg", 1, T_model_cam))
    write_model(folder / "model", {1: CAMERA}, posed)
    return folder


def gps_at(enu_m, origin=ORIGIN):
    """The place that lies at ``enu_m`` of the origin, to a tenth of a millimetre, by Newton's
    method."""
    at = np.array([origin.latitude_deg, origin.longitude_deg, origin.height_m])
    step = np.array([1e-5, 1e-5, 1.0])
    for _ in range(5):
        here, *moved = east_north_up_m([Gps(*at), *(Gps(*(at + d)) for d in np.diag(step))], origin)
        J = (np.array(moved) - here).T / step
        at = at + np.linalg.solve(J, np.asarray(enu_m) - here)
    return Gps(*at)


def write_tagged(target, pixels, gps=None, orientation=1, focal_35_mm=None, xmp=None, error_m=None):
    """``pixels``: an (H, W, 3) RGB array, or a file whose pixels they are. JPEG; ``gps`` None
    leaves the tags out."""
    image = Image.fromarray(pixels) if isinstance(pixels, np.ndarray) else Image.open(pixels)
    exif = Image.Exif()
    exif[0x010F], exif[0x0110], exif[0x0112] = "Maker", "Flyer 1", orientation
    if focal_35_mm:
        exif.get_ifd(0x8769)[0xA405] = round(focal_35_mm)
    if gps is not None:
        tags = exif.get_ifd(0x8825)
        tags[1], tags[2] = "S" if gps.latitude_deg < 0 else "N", _sexagesimal(gps.latitude_deg)
        tags[3], tags[4] = "W" if gps.longitude_deg < 0 else "E", _sexagesimal(gps.longitude_deg)
        tags[5], tags[6] = bytes([int(gps.height_m < 0)]), _ratio(abs(gps.height_m), 1000)
        if error_m:
            tags[31] = _ratio(error_m, 1000)
    image.save(target, "JPEG", quality=95, exif=exif, **({"xmp": xmp.encode()} if xmp else {}))


def _sexagesimal(degrees):
    degrees = abs(degrees)
    minutes = (degrees % 1) * 60
    return (_ratio(int(degrees), 1), _ratio(int(minutes), 1), _ratio((minutes % 1) * 60, 1000000))


def _ratio(value, of):
    return TiffImagePlugin.IFDRational(round(value * of), of)

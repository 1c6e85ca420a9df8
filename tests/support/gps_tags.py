# SPDX-License-Identifier: Apache-2.0
"""Photographs with GPS tags as cameras write them: pixels of a file or of a scene, tags written here."""

import numpy as np
from PIL import Image, TiffImagePlugin

from fcsv_stereo.photos.earth import east_north_up_m
from fcsv_stereo.photos.tags import Gps

ORIGIN = Gps(48.1371, 11.5754, 520.0)


def gps_at(enu_m, origin=ORIGIN):
    """The place that lies at ``enu_m`` of the origin, to a tenth of a millimetre, by Newton's method."""
    at = np.array([origin.latitude_deg, origin.longitude_deg, origin.height_m])
    step = np.array([1e-5, 1e-5, 1.0])
    for _ in range(5):
        here, *moved = east_north_up_m([Gps(*at), *(Gps(*(at + d)) for d in np.diag(step))], origin)
        J = (np.array(moved) - here).T / step
        at = at + np.linalg.solve(J, np.asarray(enu_m) - here)
    return Gps(*at)


def write_tagged(target, pixels, gps=None, orientation=1, focal_35_mm=None, xmp=None, error_m=None):
    """``pixels``: an (H, W, 3) RGB array, or a file whose pixels they are. JPEG; ``gps`` None leaves the tags out."""
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
